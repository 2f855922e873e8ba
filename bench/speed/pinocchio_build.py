"""Programs of bench/speed/pinocchio: flexarm and pinocchio in one, everything compiled with the same flags.

Compiled twice: as flexarm is shipped (-O3, for any processor of the kind; run on the widest vectors, and on AVX2) and
with -march=native. Pinocchio's headers come from the wheel `pin` of PyPI, in an environment under build/peers; Eigen is
the system's.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from peers import ROOT, python_of

# flags of the build, and vectors
RUNS = {"-O3": ("portable", None), "-O3, AVX2": ("portable", "avx2"), "-march=native": ("native", None)}
FLAGS = {"portable": "", "native": "-march=native"}


def program(flags: str, name: str) -> Path:
    """The program; compiled again where something changed."""
    python = python_of("pin", ["pin"])
    where = [python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"]
    site = subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip()
    folder = ROOT / "build" / "bench" / f"pinocchio-{flags}"
    source = ROOT / "bench" / "speed" / "pinocchio"
    configure = ["cmake", "-G", "Ninja", "-S", source, "-B", folder, "-DCMAKE_BUILD_TYPE=Release"]
    configure += [f"-DPINOCCHIO_PREFIX={site}/cmeel.prefix", f"-DCMAKE_CXX_FLAGS={FLAGS[flags]}"]
    subprocess.run(configure, check=True, stdout=subprocess.DEVNULL)
    build = ["cmake", "--build", folder, "-j", str(os.cpu_count()), "--target", name]
    subprocess.run(build, check=True, stdout=subprocess.DEVNULL)
    return folder / name
