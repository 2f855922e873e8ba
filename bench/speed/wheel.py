"""What a wheel holds, and how long `pip install` of it takes: the table of docs/contributing.md.

    python bench/speed/wheel.py dist/flexarm-*.whl

Each file of the wheel falls into one row. The installation is timed in a new environment, with all that flexarm needs,
from the package index; its time depends on the network and on pip's cache.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).parents[1]))
from reporting import replace_table

PAGE = Path(__file__).parents[2] / "docs" / "contributing.md"
#: What it is, and the patterns of its files; the first that fits counts.
ROWS = {
    "the extension `_core`: the whole library, with SUNDIALS": ["flexarm/_core.*.so", "flexarm/_core.*.pyd"],
    "examples": ["flexarm/examples/*"],
    "Python, with the stubs of `_core`": ["flexarm/*.py", "flexarm/*.pyi", "flexarm/py.typed"],
    "the core in WebAssembly": ["flexarm/live/*.wasm"],
    "scenes, measured data, the viewer's page": [
        "flexarm/scenes/*", "flexarm/identify/validate/*", "flexarm/view/*", "flexarm/live/*",
    ],
    "C++: the static libraries": ["flexarm/*.a", "flexarm/*.lib"],
    "C: `libflexarm_c`": ["flexarm/*flexarm_c*"],
    "C++ and C: headers": ["flexarm/include/*"],
    "the CMake package": ["flexarm/*.cmake"],
    "licences and metadata": ["flexarm-*.dist-info/*"],
    "libraries of the system that auditwheel added": ["flexarm.libs/*"],
}


def contents(wheel: Path) -> list[str]:
    """A row for each kind of file: files, size unpacked and in the wheel (kB)."""
    rows: dict[str, list[int]] = {name: [0, 0, 0] for name in ROWS}
    with zipfile.ZipFile(wheel) as whole:
        for file in (x for x in whole.infolist() if not x.is_dir()):
            fits = [name for name, patterns in ROWS.items() if any(fnmatch.fnmatch(file.filename, p) for p in patterns)]
            if not fits:
                raise SystemExit(f"{file.filename}: falls into no row")
            for k, more in enumerate((1, file.file_size, file.compress_size)):
                rows[fits[0]][k] += more
    total = [sum(row[k] for row in rows.values()) for k in range(3)]
    return [f"| {name} | {n} | {size / 1e3:.0f} | {packed / 1e3:.0f} |"
            for name, (n, size, packed) in [*rows.items(), ("**all**", total)] if n]  # fmt: skip


def install(wheel: Path) -> tuple[float, float, int]:
    """Seconds of pip in a new environment, on the clock and of the processor; and how many packages it brings."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = [str(Path(folder) / "bin" / "python"), "-m", "pip", "--disable-pip-version-check"]
        began, used = perf_counter(), process_times()
        subprocess.run([*pip, "install", "-q", str(wheel)], check=True)
        seconds, used = perf_counter() - began, process_times() - used
        subprocess.run([pip[0], "-c", "import flexarm; flexarm.load('ist')"], check=True)
        listed = subprocess.run([*pip, "list", "--format=freeze"], check=True, capture_output=True, text=True).stdout
        packages = [x for x in re.findall(r"^([\w.-]+)==", listed, re.M) if x not in ("pip", "setuptools", "flexarm")]
        return seconds, used, len(packages)


def process_times() -> float:
    """Of the processes that this one has started and that have ended (s)."""
    now = os.times()
    return now.children_user + now.children_system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    wheel = parser.parse_args().wheel.resolve()
    rows = contents(wheel)
    seconds, used, others = install(wheel)
    tags = wheel.name.split("-", 2)[2].removesuffix(".whl")
    size = f"`{tags}`: {wheel.stat().st_size / 1e6:.1f} MB"
    told = f"{size}, installed with {others} packages of others in {seconds:.0f} s, {used:.0f} s of a processor."
    head = ["| what | files | unpacked (kB) | in the wheel (kB) |", "|-|-|-|-|"]
    replace_table(PAGE, "bench/speed/wheel.py", "\n".join([*head, *rows, "", told]))


if __name__ == "__main__":
    main()
