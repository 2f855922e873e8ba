"""The style of figures: colours, sizes, axes, legends."""

import io
import sys
from typing import TYPE_CHECKING, Any

# matplotlib is slow to import, and most programs draw nothing: it is imported where it is used.
if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    Axes = Figure = Any

#: Okabe and Ito's colours, distinct for colour-blind readers too.
BLUE, ORANGE, GREEN, PURPLE, SKY, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"
PALETTE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
INK = "#333333"
#: Of the order of a beam's rotation, in charts and the figures of the paper; "as given": of an arm that does not bend.
ORDER_COLOURS: dict[int | str, str] = {
    "as given": "#8C8C8C", 0: ORANGE, 1: PURPLE, 2: BLUE, 3: GREEN, "exact": RED, "mixed": SKY
}  # fmt: skip
DPI = 150
_LINES, _LETTERS = 12, 40  # of a legend beside a panel: entries in a column, letters in a line


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size (inches), which a notebook shows at the end of a cell."""
    from matplotlib.figure import Figure

    _tell_notebook(Figure)
    return Figure(figsize=(width, height), layout="constrained")


def _tell_notebook(figure: type[Figure]) -> None:
    """Tells a notebook how to show a figure: pyplot would do so, but these figures are made without it."""
    ipython = sys.modules.get("IPython")
    shell: Any = None if ipython is None else ipython.get_ipython()
    if shell is not None and not any(figure in known for known in shell.display_formatter.formatters.values()):
        shell.display_formatter.formatters["image/png"].for_type(figure, _png)


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", bbox_inches="tight")
    return file.getvalue()


def words(text: str) -> str:
    """A user's text as matplotlib shows it: no dollar begins a formula, no "_" hides it from a legend."""
    return (" " if text.startswith("_") else "") + text.replace("$", r"\$")


def label_axes(ax: Axes, ylabel: str, xlabel: str = "") -> None:
    """Names the axes, with a grid behind the curves."""
    ax.set_ylabel(words(ylabel))
    ax.set_xlabel(words(xlabel))
    ax.grid(True, color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def short(text: str, most: int) -> str:
    """A text of at most so many letters, the middle left out: names begin and end differently."""
    if len(text) <= most:
        return text
    end = (most - 1) // 2
    return f"{text[: most - 1 - end].rstrip()}…{text[len(text) - end :].lstrip()}"


def legend(ax: Axes, count: int) -> None:
    """Adds a legend beside the axes, within the size of a page; the name of a single curve stands above it. Labels
    are `words`."""
    handles, labels = ax.get_legend_handles_labels()
    if count == 1:
        ax.set_title(short(labels[0].strip(), 80), loc="left", fontsize=10)
    elif count:
        columns = 2 if count > _LINES and max(map(len, labels)) <= _LETTERS // 2 else 1
        shown = count if count <= columns * _LINES else columns * _LINES - 1
        shown_labels = [short(label, _LETTERS // columns) for label in labels[:shown]]
        if shown < count:
            handles, shown_labels = [*handles[:shown], _nothing()], [*shown_labels, f"and {count - shown} more"]
        look: dict[str, Any] = {"frameon": False, "fontsize": 9, "ncols": columns}
        ax.legend(handles[: len(shown_labels)], shown_labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), **look)


def _nothing() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="")
