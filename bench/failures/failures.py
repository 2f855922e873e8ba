"""The failure catalogue: measures every entry of docs/failures.md and draws its figure.

    python bench/failures/failures.py [ENTRY ...]     all of them, or those named

Each entry is one function, in a failure_*.py beside this file: it returns its figure and the rows of its
table. The figures go to docs/figures/failure_NAME.png, the rows into docs/failures.md between the entry's marks, and
both rows and where they were measured to docs/figures/failures.json. The measures are in tests/stability, where
they are judged.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys

import failure_friction  # noqa: F401  registers its entries
import failure_integrators  # noqa: F401
import failure_loops  # noqa: F401
import failure_models  # noqa: F401
import failure_steps  # noqa: F401
import flexarm as fa
import numpy as np
from failure_common import ENTRIES, ROOT, Rows
from PIL import Image


def table(rows: Rows) -> str:
    """Rows as Markdown; columns are those of all rows, in order."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = ["| " + " | ".join(c.strip() for c in columns) + " |", "|" + "-|" * len(columns)]
    lines += ["| " + " | ".join(str(row.get(c, "")) for c in columns) + " |" for row in rows]
    return "\n".join(lines)


def main(names: list[str]) -> None:
    unknown = [n for n in names if n not in ENTRIES]
    if unknown:
        sys.exit(f"unknown entry {unknown[0]!r}: must be one of {', '.join(ENTRIES)}")
    figures, page = ROOT / "docs" / "figures", ROOT / "docs" / "failures.md"
    figures.mkdir(parents=True, exist_ok=True)
    store = figures / "failures.json"
    kept = json.loads(store.read_text(encoding="utf-8")) if store.exists() else {"entries": {}}
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    where = {"machine": platform.machine(), "system": platform.system(), "python": platform.python_version()}
    where |= {"numpy": np.__version__, "flexarm": fa.__version__, "commit": commit.stdout.strip()}
    text = page.read_text(encoding="utf-8")
    for name in names or ENTRIES:
        print(name, flush=True)
        fig, rows = ENTRIES[name]()
        target = figures / f"failure_{name}.png"
        fig.savefig(target, dpi=115)
        if target.stat().st_size > 120_000:  # many lines: 64 colours are enough
            Image.open(target).convert("RGB").quantize(64).save(target, optimize=True)
        if target.stat().st_size > 120_000:
            sys.exit(f"{target.name}: {target.stat().st_size} bytes; must be below 120 kB")
        kept["entries"][name] = {"measured on": where, "rows": rows}
        begin, end = f"<!-- {name}: written by bench/failures/failures.py -->\n", f"<!-- end of {name} -->"
        head, rest = text.split(begin)
        text = head + begin + table(rows) + "\n" + end + rest.split(end)[1]
    store.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
