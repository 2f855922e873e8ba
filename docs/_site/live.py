"""The page that computes, on the first page, where flexarm has its core in WebAssembly; else the picture stays."""

from pathlib import Path
from typing import Any

import flexarm as fa
from docutils import nodes
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

PICTURE, PAGE = "figures/live.png", "_static/live.html"
FRAME = (
    f'<iframe src="{PAGE}" title="an arm that computes" loading="lazy" '
    'style="width: 100%; height: 640px; border: 1px solid #ddd"></iframe>'
)


class LivePage(SphinxTransform):
    """The picture on the first page becomes the page itself."""

    default_priority = 4

    def apply(self, **_: Any) -> None:
        if self.env.docname != "index" or not getattr(self.app, "has_live", False):
            return
        for image in list(self.document.findall(nodes.image)):
            if image["uri"].endswith(PICTURE):
                whole = image.parent  # of the paragraph: the picture, and its link
                while not isinstance(whole, nodes.paragraph):
                    whole = whole.parent
                whole.replace_self(nodes.raw("", FRAME, format="html"))


def write(app: Any) -> None:
    try:
        file = Path(app.outdir) / PAGE
        file.parent.mkdir(parents=True, exist_ok=True)
        fa.live(fa.load("two_links")).save(file)
        app.has_live = True
    except RuntimeError as e:
        logging.getLogger(__name__).info("the first page has a picture alone: %s", e)


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write)
    app.add_transform(LivePage)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
