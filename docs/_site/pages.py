"""What becomes of pages: links to API pages, and to files of the repository outside docs."""

import re
from pathlib import Path
from typing import Any

import flexarm as fa
from docutils import nodes
from flexarm import _face
from sphinx import addnodes
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
SOURCE = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Source"]
OWNERS = {name: f"flexarm.{at}" for at in _face.LISTS for name in _face.public(getattr(fa, at))}
OWNERS |= dict.fromkeys(_face.public(fa), "flexarm") | dict.fromkeys(_face.LISTS, "flexarm")
NAME = re.compile(rf"fa\.(?:(?:{'|'.join(_face.LISTS)})\.)?([A-Za-z_]\w*)(?:\.([A-Za-z_]\w*))?")
NAME_ALONE = re.compile(rf"({'|'.join(OWNERS)})(?:\.(\w+))?$")  # as docstrings say `simulate`
log = logging.getLogger(__name__)


class FilesOfTheRepository(SphinxTransform):
    """`../bench/x.py` becomes an address on GitHub."""

    default_priority = 5

    def apply(self, **_: Any) -> None:
        docs = Path(self.env.srcdir)
        page = Path(self.env.doc2path(self.env.docname))
        wanted = (addnodes.download_reference, addnodes.pending_xref)
        for node in list(self.document.findall(lambda n: isinstance(n, wanted) and n.get("reftype") == "myst")):
            path, _, anchor = node["reftarget"].partition("#")
            if node.get("refdomain") == "doc":  # a name in docs, without a suffix
                path = f"/{path}.md"
            if not path:
                continue
            file = (docs / path[1:] if path[0] == "/" else page.parent / path).resolve()
            if docs in file.parents or not file.is_relative_to(ROOT):
                if re.fullmatch(r"[\w-]+\.md", node.astext()):  # a file's name says less than its title
                    node["refexplicit"] = False
                    node.children = [nodes.inline("", "", classes=["xref", "myst"])]
                continue
            if not file.exists():
                log.warning("link to a missing file: %s", path, location=node)
                continue
            kind = "tree" if file.is_dir() else "blob"
            address = f"{SOURCE}/{kind}/main/{file.relative_to(ROOT).as_posix()}{'#' * bool(anchor)}{anchor}"
            node.replace_self(nodes.reference("", "", *node.children, refuri=address))


class NamesOfTheApi(SphinxTransform):
    """`fa.Beam(...)` in a page's text becomes a link to the page of that name."""

    default_priority = 6

    def apply(self, **_: Any) -> None:
        docstring = self.env.docname.startswith("api/")
        for node in list(self.document.findall(nodes.literal)):
            found = NAME.match(node.astext()) or (docstring and NAME_ALONE.match(node.astext()))
            inside = node.parent
            while inside is not None and not isinstance(inside, (nodes.reference, addnodes.pending_xref, nodes.title)):
                inside = inside.parent
            if not found or inside is not None:
                continue
            if found[1] not in OWNERS:
                log.warning("flexarm has no name %s", found[1], location=node)
                continue
            target = f"{OWNERS[found[1]]}.{found[1]}"
            if found[2] and found[1][0].isupper():
                target += f".{found[2]}"
            link = addnodes.pending_xref(
                "", refdomain="py", reftype="obj", reftarget=target, refdoc=self.env.docname, refwarn=False
            )
            node.replace_self(link)
            link += node


def setup(app: Any) -> dict[str, bool]:
    app.add_transform(FilesOfTheRepository)
    app.add_transform(NamesOfTheApi)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
