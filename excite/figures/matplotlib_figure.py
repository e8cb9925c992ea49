"""A figure as a matplotlib figure: for pictures in files, and for notebooks.

Nothing of pyplot is imported and no window opened; matplotlib's settings are as before afterwards.
"""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.figures.figure import Axis, Band, Bars, Figure, Line, Mark, Panel, Points, Rule, Span, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

WIDTH = 9.0  # inches, drawn at 100 px an inch
STYLE = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "text.usetex": False,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "figure.titlesize": 10,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#888888",
    "axes.labelcolor": "#222222",
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "axes.titlelocation": "left",
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "excite",
}
# Settings that decide on looks; that of the back end is left alone, since reading it already chooses one.
LOOKS = (
    *(
        "agg.",
        "axes.",
        "figure.",
        "font.",
        "grid.",
        "hatch.",
        "legend.",
        "lines.",
        "markers.",
        "patch.",
        "path.",
        "pdf.",
    ),
    *("savefig.", "svg.", "text.", "xtick.", "ytick."),
)
STYLES = {"solid": "-", "dashed": (0, (4, 2)), "dotted": ":"}
MARKERS = {"dot": "o", "ring": "o", "cross": "x", "tick": "|", "square": "s"}
LONGEST = {"title": 110, "legend": 48, "inside": 26, "tick": 30, "text": 110}  # characters there is room for
NARROW = 0.4  # of the figure's width: a panel below that has a small title
CHARACTER = 0.58  # mean width of a character of DejaVu Sans, in font sizes
_LOCK = RLock()  # matplotlib's settings belong to the process: one drawing at a time


@contextmanager
def house_style() -> Iterator[None]:
    """Have the common look inside, whatever the user's own matplotlib settings are; these come back afterwards."""
    with _LOCK:
        matplotlib = _matplotlib()
        defaults = {k: v for k, v in dict.items(matplotlib.rcParamsDefault) if k.startswith(LOOKS)}
        with matplotlib.rc_context({**defaults, **STYLE}):
            yield


def _matplotlib() -> Any:
    """Import matplotlib, which fails where MPLBACKEND names a back end that does not exist; none is needed here."""
    asked = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
    finally:
        if asked is not None:
            os.environ["MPLBACKEND"] = asked
    if asked:
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = asked  # as its own import would have done
    return matplotlib


def printable(text: str, longest: int | None = None) -> str:
    """Return text with its control characters replaced, and cut where it is too long."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    return text if longest is None or len(text) <= longest else f"{text[: longest - 1]}…"


def to_matplotlib(figure: Figure) -> "MatplotlibFigure":
    """Return the figure as a matplotlib figure with an Agg canvas; `figure.savefig`, axes and artists are the caller's."""
    with house_style():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as MatplotlibFigure

        drawing = MatplotlibFigure(figsize=(WIDTH, figure.height), dpi=100, layout="constrained")
        FigureCanvasAgg(drawing)
        drawing.suptitle(printable(figure.title, LONGEST["title"]), x=0.01, ha="left", fontweight="bold")
        grid = drawing.add_gridspec(
            *figure.grid, width_ratios=figure.widths or None, height_ratios=figure.heights or None
        )
        below: dict[str, Any] = {}
        for panel in figure.panels:
            place = grid[panel.row : panel.row + panel.rows, panel.column : panel.column + panel.columns]
            axes = drawing.add_subplot(place)
            handles = _panel(axes, panel, figure)
            if panel.legend == "below":
                below |= {label: handle for label, handle in handles.items() if label not in below}
            elif panel.legend == "inside" and handles:
                axes.legend(handles.values(), [printable(h, LONGEST["inside"]) for h in handles], fontsize=6)
        if below:
            labels = list(below)[::-1]  # the last is drawn on top: it comes first
            texts = [printable(label, LONGEST["legend"]) for label in labels]
            drawing.legend([below[k] for k in labels], texts, loc="outside lower center", ncols=min(6, len(labels)))
    return drawing


def _panel(axes: "Axes", panel: Panel, figure: Figure) -> dict[str, Any]:
    """Draw one panel and return its labelled artists."""
    handles: dict[str, Any] = {}
    for k, mark in enumerate(panel.marks):
        look = {
            "color": figure.colour(mark.colour),
            "alpha": mark.alpha,
            "zorder": 1 + (k + 1) / (len(panel.marks) + 1),
        }
        artist = DRAW[type(mark)](axes, mark, look)
        if mark.label:
            handles[mark.label] = artist
    widths = figure.widths or (1.0,) * figure.grid[1]
    share = sum(widths[panel.column : panel.column + panel.columns]) / sum(widths)
    size = 7.5 if share < NARROW else 9
    axes.set_title(printable(panel.title, int(share * WIDTH * 72 / (CHARACTER * size))), fontsize=size)
    _axis(axes, "x", panel.x)
    _axis(axes, "y", panel.y)
    return handles


def _axis(axes: "Axes", which: str, axis: Axis) -> None:
    mine = axes.xaxis if which == "x" else axes.yaxis
    limits = axes.set_xlim if which == "x" else axes.set_ylim
    if axis.scale == "symlog":
        (axes.set_xscale if which == "x" else axes.set_yscale)("symlog", linthresh=axis.linear_within)
    if axis.scale == "log":
        (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    if axis.limits is not None:
        limits(*axis.limits)
    if axis.scale != "linear":
        _few_ticks(axes, which, axis)
    if axis.ticks is not None:
        mine.set_ticks([at for at, _ in axis.ticks], [printable(text, LONGEST["tick"]) for _, text in axis.ticks])
        mine.grid(False)
    if axis.shared:
        mine.set_tick_params(labelleft=False, labelbottom=False)
    elif axis.text:
        mine.set_label_text(printable(axis.text))


def _few_ticks(axes: "Axes", which: str, axis: Axis) -> None:
    """Give an axis that is not linear few ticks, in plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    mine = axes.xaxis if which == "x" else axes.yaxis
    if axis.scale == "log":
        low, high = sorted(axes.get_xlim() if which == "x" else axes.get_ylim())
        decades = np.log10(high / low)
        subs = (1, 2, 5) if decades < 1.3 else (1, 3) if decades < 2.6 else (1,)
        mine.set_major_locator(LogLocator(subs=subs, numticks=8))
    mine.set_minor_locator(NullLocator())
    mine.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _line(axes: "Axes", mark: Line, look: dict[str, Any]) -> Any:
    steps: dict[str, Any] = {"drawstyle": "steps-post"} if mark.steps else {}
    marker = {} if mark.marker is None else _marker(mark.marker, mark.size, 0.0, look)
    return axes.plot(mark.x, mark.y, lw=mark.width, ls=STYLES[mark.style], **steps, **marker, **look)[0]


def _points(axes: "Axes", mark: Points, look: dict[str, Any]) -> Any:
    return axes.plot(mark.x, mark.y, ls="", **_marker(mark.marker, mark.size, mark.width, look), **look)[0]


def _marker(marker: str, size: float, width: float, look: dict[str, Any]) -> dict[str, Any]:
    filled = marker in ("dot", "square")
    face = look["color"] if filled else "none"
    return {"marker": MARKERS[marker], "ms": size, "mew": 0 if filled else width, "mfc": face}


def _band(axes: "Axes", mark: Band, look: dict[str, Any]) -> Any:
    return axes.fill_between(mark.x, mark.y_low, mark.y_high, lw=0, **look)


def _bars(axes: "Axes", mark: Bars, look: dict[str, Any]) -> Any:
    height = np.subtract(mark.y_high, mark.y_low)
    return axes.barh(
        mark.y_low, np.subtract(mark.x_high, mark.x_low), height, left=mark.x_low, align="edge", lw=0, **look
    )


def _span(axes: "Axes", mark: Span, look: dict[str, Any]) -> Any:
    return axes.axvspan(mark.x_low, mark.x_high, lw=0, **look)


def _rule(axes: "Axes", mark: Rule, look: dict[str, Any]) -> Any:
    look = {"lw": mark.width, "ls": STYLES[mark.style], **look}
    return axes.axvline(mark.x, **look) if mark.x is not None else axes.axhline(mark.y or 0.0, **look)


def _text(axes: "Axes", mark: Text, look: dict[str, Any]) -> Any:
    frame = {"data": "data", "panel": "axes fraction"}[mark.frame]
    place = {"xycoords": frame, "textcoords": "offset points", "ha": mark.across, "va": mark.up}
    words = printable(mark.text, LONGEST["text"])
    look = {"fontsize": mark.size, "annotation_clip": False, "in_layout": False, **place, **look}
    return axes.annotate(words, (mark.x, mark.y), mark.offset, **look)


DRAW: dict[type[Mark], Callable[..., Any]] = {
    Line: _line,
    Points: _points,
    Band: _band,
    Bars: _bars,
    Span: _span,
    Rule: _rule,
    Text: _text,
}
