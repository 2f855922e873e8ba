"""The chart of the shipped scene `ist` in docs/chart.md: error against wall time of models and integrators.

    python bench/choose/chart.py [-o DIR] [--budget SECONDS]

Writes chart_ist.png and chart_ist.csv into DIR/figures (DIR: docs by default) and puts the table between the marks in
DIR/chart.md. The same as `flexarm chart ist`.
"""

from __future__ import annotations

import argparse
import platform
import shutil
import tempfile
from pathlib import Path

import flexarm as fa

BEGIN, END = "<!-- table: bench/choose/chart.py -->", "<!-- end of table -->"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, default=Path(__file__).parents[2] / "docs")
    parser.add_argument("--budget", type=float, default=60.0)
    args = parser.parse_args()
    figures = args.o / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    chart = fa.chart("ist", budget=args.budget, progress=True)
    print(chart)
    with tempfile.TemporaryDirectory() as folder:
        chart.save(folder)
        for name in ("chart.png", "chart.csv"):
            shutil.copy(Path(folder) / name, figures / name.replace("chart", "chart_ist"))
    page = args.o / "chart.md"
    before, _, rest = page.read_text().partition(BEGIN) if page.exists() else ("", "", "")
    after = rest.partition(END)[2] or "\n"
    made = f"flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}"
    page.write_text(f"{before}{BEGIN}\n```text\n{chart}\n\n{made}\n```\n{END}{after}")


if __name__ == "__main__":
    main()
