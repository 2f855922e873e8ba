"""Every code block of README.md and of the documentation runs (tests/pages.py says how)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pages
import pytest
from messages import refuses
from pages import PAGES, Ran


def name(page: Path) -> str:
    return page.relative_to(pages.ROOT).as_posix()


@pytest.mark.parametrize("page", [name(page) for page in PAGES])
def test_blocks_run(page: str, page_of_docs: Callable[[str], Ran]) -> None:
    if missing := page_of_docs(page).missing:
        pytest.skip(f"SKIPPED, not passed: blocks that need {', '.join(missing)}; the others passed")


@pytest.mark.parametrize("page", [p for p in PAGES if "```cpp" in p.read_text(encoding="utf-8")], ids=name)
def test_cpp_compiles(page: Path) -> None:
    for block in pages.blocks(page):
        if block.language == "cpp" and not block.not_run:
            pages.compile_cpp(block.text)


def written(folder: Path, text: str) -> Path:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    return page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("```\nx\n```\n", "''"),
        ("```bash\nls\n```\n", "'bash'"),
        ("Run\n\n    ls\n\nnow.\n", "line 3"),
        ("<!-- not run: -->\n```sh\nls\n```\n", "reason"),
    ],
)
def test_block_of_no_known_language_is_an_error(text: str, said: str, tmp_path: Path) -> None:
    with refuses(said):
        pages.blocks(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("```python\n1 / 0\n```\n", ZeroDivisionError),
        ("```python\nimport warnings\nwarnings.warn('x')\n```\n", UserWarning),
        ("<!-- warns: UserWarning -->\n```python\n1\n```\n", AssertionError),
        ("```sh\nfalse\ntrue\n```\n", AssertionError),
        ("```sh\necho $absent\n```\n", AssertionError),
        ("```toml\n[[link]]\njoints = 1\n```\n", ValueError),
        ("```toml\n[[link]\n```\n", ValueError),
    ],
)
def test_block_that_fails_is_noticed(text: str, error: type[Exception], tmp_path: Path) -> None:
    with pytest.raises(error):
        pages.run(written(tmp_path, text), tmp_path)


def test_blocks_share_names_and_folder(tmp_path: Path) -> None:
    text = """
```toml
# numbers.toml
x = [3, 4]
```

- in a list:
  ```python
  from pathlib import Path
  a = Path("numbers.toml").read_text().count(",")
  ```

<!-- not run: it never ends -->
```sh
sleep infinity
```

<!-- needs: no_such_module -->
```python
import no_such_module
```

<!-- warns: UserWarning -->
```python
import warnings
warnings.warn("as told")
```

```sh
python -c "open('out.txt', 'w').write('1')"
```

```python
b = a + int(Path("out.txt").read_text())
```
"""
    ran = pages.run(written(tmp_path, text), tmp_path)
    assert ran.names["b"] == 2 and len(ran.states) == 3 and "b" not in ran.states[0]
    assert ran.missing == ["no_such_module"]


def test_cpp_that_does_not_compile_is_noticed() -> None:
    with refuses("no_such_thing", error=AssertionError):
        pages.compile_cpp("int main() { return no_such_thing; }\n")


def test_error_tells_the_line_of_the_page(tmp_path: Path) -> None:
    page = written(tmp_path, "# A page\n\n```python\nx = 1\ny = x / 0\n```\n")
    with pytest.raises(ZeroDivisionError) as error:
        pages.run(page, tmp_path)
    assert (error.traceback[-1].path, error.traceback[-1].lineno) == (page, 4)  # from 0
