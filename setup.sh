#!/usr/bin/env bash
# Everything from a bare Debian 12 or Ubuntu 24.04 to a running flexarm, in one command:
#   ./setup.sh demo [ARGS]   install, then run `flexarm demo ARGS`
#   ./setup.sh test [ARGS]   install, then run the C++ and Python tests (ARGS go to pytest) and the checks of lint
#   ./setup.sh live          the core in WebAssembly, which the pages of `flexarm live` hold; then install, with it
#   ./setup.sh docs          the documentation's site into build/docs (its notebooks run); warnings are errors
#   ./setup.sh lint          ruff, mypy, stubs and clang-format alone
#   ./setup.sh asan          the C++ tests, and scenes drawn at random, under the address and undefined-behaviour sanitizers
# Missing system packages come from apt (as root or through sudo); with nothing missing, apt is never called.
# FLEXARM_VENV chooses where the virtual environment goes (.venv unless set). FLEXARM_SCENES=OFF goes without
# nlohmann/json: there is then no load_scene in C++, and no `flexarm compile`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
command=${1:-}
case $command in
  demo | live) extra='' ;;
  test | lint | asan) extra='[test]' ;;
  docs) extra='[docs]' ;;
  *) sed -n '2,11s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 2 ;;
esac
shift
venv=${FLEXARM_VENV:-.venv}
[[ $venv == /* ]] || venv=$PWD/$venv
scenes=${FLEXARM_SCENES:-ON}
jobs=$(nproc 2>/dev/null || echo 2)
export CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$jobs} PIP_DISABLE_PIP_VERSION_CHECK=1

say() { printf '\n== %s\n' "$*"; }

# --- What the system must offer. Each is probed by its effect, so that other ways to install it count too. ---
python_has() { "$1" -c "$2" >/dev/null 2>&1; }
new_enough='import sys; assert sys.version_info >= (3, 10)'
has_venv='import ensurepip, venv'
has_headers='import os, sysconfig as s; assert os.path.exists(os.path.join(s.get_path("include"), "Python.h"))'

find_python() { # prints the first complete Python
  local py
  for py in python3 /usr/bin/python3 python3.{14,13,12,11,10}; do
    if python_has "$py" "$new_enough; $has_venv; $has_headers"; then command -v "$py"; return; fi
  done
  return 1
}

has_cmake_package() { # FILE DIRECTORY: a CMake package in one of the usual prefixes
  local prefixes prefix
  IFS=':;' read -ra prefixes <<<"${CMAKE_PREFIX_PATH:-}"
  for prefix in "${prefixes[@]}" ${CONDA_PREFIX:+"$CONDA_PREFIX"} /usr/local /usr; do
    compgen -G "$prefix/lib*/cmake/$2/$1" || compgen -G "$prefix/lib/*/cmake/$2/$1" ||
      compgen -G "$prefix/share/$2/cmake/$1" || compgen -G "$prefix/share/cmake/$2/$1" || continue
    return
  done >/dev/null
  return 1
}

find_missing() { # fills the array missing with Debian's package names
  missing=()
  if ! find_python >/dev/null; then
    local py=/usr/bin/python3  # the one apt can complete
    python_has $py "$new_enough" || missing+=(python3)
    python_has $py "$has_venv" || missing+=(python3-venv)
    python_has $py "$has_headers" || missing+=(python3-dev)
  fi
  ${CXX:-c++} -std=c++17 -x c++ -o /dev/null - <<<'#include <optional>
    int main() { if constexpr (true) return std::optional<int>(0).value(); }' 2>/dev/null || missing+=(g++)
  has_cmake_package Eigen3Config.cmake eigen3 || missing+=(libeigen3-dev)
  has_cmake_package SUNDIALSConfig.cmake sundials || missing+=(libsundials-dev)
  [[ $scenes == OFF ]] || has_cmake_package nlohmann_jsonConfig.cmake nlohmann_json || missing+=(nlohmann-json3-dev)
  [[ $command != live ]] || { command -v emcmake && command -v node; } >/dev/null || missing+=(emscripten node-acorn)
  [[ $extra != '[test]' ]] || has_cmake_package doctestConfig.cmake doctest || missing+=(doctest-dev)
}

install_missing() {
  local root=() apt=(apt-get -qq -o DPkg::Lock::Timeout=120 -o Dpkg::Use-Pty=0) log
  if ((EUID != 0)); then
    if sudo -n true 2>/dev/null; then root=(sudo -n); elif [[ -t 0 ]] && command -v sudo >/dev/null; then root=(sudo); else root=(false); fi
  fi
  if [[ ${root[*]} == false ]] || ! command -v apt-get >/dev/null; then
    echo "flexarm needs system packages that are missing here: ${missing[*]}" >&2
    echo "On Debian or Ubuntu, as root:  apt-get install --no-install-recommends ${missing[*]}" >&2
    echo "If they are in an unusual place, put its prefix into CMAKE_PREFIX_PATH." >&2
    [[ " ${missing[*]} " != *" nlohmann-json3-dev "* ]] ||
      echo "To go without compiled scenes, for which nlohmann-json3-dev is: FLEXARM_SCENES=OFF $0 $command" >&2
    exit 1
  fi
  say "installing ${missing[*]} (apt)"
  log=$(mktemp)
  if ! { "${root[@]}" "${apt[@]}" update &&
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive "${apt[@]}" install -y --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 20 "$log" >&2
    echo "apt could not install: ${missing[*]} (on Ubuntu, the component 'universe' must be enabled)" >&2
    exit 1
  fi
  rm -f "$log"
  find_missing
  if ((${#missing[@]})); then echo "installed, but still not usable: ${missing[*]}" >&2; exit 1; fi
}

# --- The virtual environment. A stamp of all that goes into the package tells whether anything is to be done. ---
install_flexarm() {
  local now stamp=$venv/flexarm.stamp tests=''
  [[ $command != test ]] || tests=' with tests'
  now=$(find CMakeLists.txt cmake pyproject.toml LICENSE README.md licenses cpp examples python -type f \
    ! -path '*/__pycache__/*' -print0 | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum)
  if "$venv/bin/python" -c 'import flexarm._core' 2>/dev/null; then
    if grep -qsF "$now$scenes$extra$tests" "$stamp"; then return; fi
    if [[ -z $tests ]] && grep -qsxF "$now$scenes" "$stamp"; then  # the package is here; what this command needs is not
      say "installing what flexarm$extra needs into $venv"
      "$venv/bin/pip" install -q "flexarm$extra"
      echo "$now$scenes$extra" >>"$stamp"
      return
    fi
  fi
  say "building and installing flexarm$extra into $venv"
  python_has "$venv/bin/python" 'import pip' || "$(find_python)" -m venv "$venv"
  rm -f "$stamp"
  local settings=(--config-settings=build-dir=build/setup  # an editable install has its own
    "--config-settings=cmake.define.FLEXARM_SCENES=$scenes")
  if [[ $command == test ]]; then  # the C++ tests with it, so that they try what is installed; warnings are errors for
    settings+=(--config-settings=cmake.define.FLEXARM_BUILD_TESTS=ON)  # us (CI), not for a newer compiler
    [[ -z ${CI:-} ]] || settings+=(--config-settings=cmake.define.FLEXARM_{WERROR=ON,SETS=ALL})
  fi
  rm -rf build/wheel  # what is installed, and tested, can be taken from there
  "$venv/bin/pip" wheel -q "${settings[@]}" --no-deps -w build/wheel .
  "$venv/bin/pip" uninstall -q -y flexarm 2>/dev/null  # or a wheel of the same version would stay
  "$venv/bin/pip" install -q "$(echo build/wheel/flexarm-*.whl)$extra"
  printf '%s\n' "$now$scenes$extra$tests" "$now$scenes$extra" "$now$scenes" >"$stamp"
}

core_of_pages() { # one file for all systems, into the package: not in git
  say "the core in WebAssembly"
  python_has "$venv/bin/python" 'import pip' || "$(find_python)" -m venv "$venv"
  "$venv/bin/pip" install -q cmake ninja
  emcmake cmake --preset live -DCMAKE_MAKE_PROGRAM="$venv/bin/ninja" >build/live.log 2>&1 ||
    { cat build/live.log >&2; return 1; }
  cmake --build --preset live
  cp build/live/flexarm.wasm python/flexarm/live/
}

cpp_tests() {
  say "C++ tests"
  ctest --test-dir build/setup --output-on-failure --no-tests=error -j "$jobs"
}

sanitized_tests() { # C++ tests, and the properties of drawn scenes (tests/drawn) through the Python extension
  local needed=(cmake ninja 'pybind11>=2.13' numpy scipy matplotlib rich h5py pytest hypothesis) copy=build/asan/python
  say "C++ tests under sanitizers"
  python_has "$venv/bin/python" 'import pip' || "$(find_python)" -m venv "$venv"
  "$venv/bin/pip" install -q "${needed[@]}"
  cmake --preset asan -DCMAKE_MAKE_PROGRAM="$venv/bin/ninja" -DFLEXARM_WERROR="${CI:+ON}" -DFLEXARM_SCENES="$scenes" \
    -DFLEXARM_PYTHON=ON -DPython_EXECUTABLE="$venv/bin/python" -Dpybind11_DIR="$("$venv/bin/python" -m pybind11 --cmakedir)" \
    >build/asan.log 2>&1 || { cat build/asan.log >&2; return 1; }
  cmake --build --preset asan
  ctest --preset asan -j "$jobs"
  say "Scenes drawn at random, under sanitizers"
  rm -rf $copy && mkdir -p $copy && cp -r python/flexarm build/asan/_core*.so $copy/ && mv $copy/_core*.so $copy/flexarm/
  FLEXARM_SHARE=0.25 LD_PRELOAD="$(${CXX:-c++} -print-file-name=libasan.so) $(${CXX:-c++} -print-file-name=libstdc++.so)" \
    ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1 PYTHONPATH=$PWD/$copy PYTHONDONTWRITEBYTECODE=1 \
    "$venv/bin/python" -m pytest -q -p no:cacheprovider tests/drawn
}

lint() {
  say "ruff, mypy, stubs against the binding, clang-format"
  ruff check .
  mypy
  python -m mypy.stubtest flexarm._core --ignore-missing-stub --mypy-config-file pyproject.toml \
    --allowlist <(echo 'flexarm\._core\.[A-Za-z]+')  # pybind11's metaclass, of the classes themselves
  find cpp bench python/bindings \( -name '*.[ch]pp' -o -name '*.[ch]' \) -print0 | xargs -0r clang-format --dry-run -Werror
  echo "all clean"
}

site() {
  say "the documentation's site"
  rm -rf build/docs docs/api
  python -m sphinx -W --keep-going -q -j "$jobs" -b html -d build/doctrees docs build/docs "$@"
  echo "build/docs/index.html"
}

find_missing
if ((${#missing[@]})); then install_missing; fi
export PATH=$venv/bin:$PATH
mkdir -p build
[[ $command != live ]] || core_of_pages
[[ $command == asan ]] || install_flexarm
case $command in
  demo) flexarm demo "$@" ;;
  test) cpp_tests; say "Python tests"; pytest "$@"; lint ;;
  lint) lint ;;
  live) ls -l python/flexarm/live/flexarm.wasm ;;
  docs) site "$@" ;;
  asan) sanitized_tests ;;
esac
