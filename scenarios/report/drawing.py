"""The common look of the figures: palette, canvas, thinned lines, safe text, small SVG."""

import io
import re
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from excite.types.signal import Signal
from scenarios.run.results import ViewResult

Colours = Mapping[str, str]
Draw = TypeVar("Draw", bound=Callable[..., Figure | None])

TRUTH, MEASURED, BAND = "#111111", "#b4b4b4", "#eef3f7"
# Okabe and Ito (2008) without black and yellow, continued with darker tones of Tol's "muted" scheme.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933", "#332288", "#117733")
STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "text.usetex": False,
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
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "axes.titlelocation": "left",
    "svg.fonttype": "path",
    "svg.hashsalt": "excite",
}
WIDTH = 9.0  # inches, drawn at 100 px an inch
MOST_POINTS = 2000  # a line
MOST_POINTS_FIGURE = 12_000
MOST_RUNS = 30
WINDOW_S = 20.0
FEWEST = 400  # samples that a time window holds at least
MOST_TURNS = 120  # of a drawn line: more fill the picture with ink


def styled(draw: Draw) -> Draw:
    """Let a function draw in the common look, leaving matplotlib's own settings as they were."""

    @wraps(draw)
    def inner(*args: object, **kwargs: object) -> Figure | None:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return inner


def canvas(height: float, title: str) -> Figure:
    """Return an empty figure of the common width with a title; `height` in inches."""
    figure = Figure(figsize=(WIDTH, height), dpi=100, layout="constrained")
    figure.suptitle(plain(title, 110), x=0.01, ha="left", fontweight="bold")
    return figure


def colours(methods: Iterable[str]) -> dict[str, str]:
    """Return one colour a method name, the same whatever the order in which the names come."""
    return {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(sorted(set(methods)))}


def palette_of(view: ViewResult) -> dict[str, str]:
    """Return the colours of one view's methods, for a figure drawn on its own."""
    return colours(row.method for row in view.rows)


def plain(text: object, longest: int = 48) -> str:
    """Return text that is drawn as it stands: no mathematics between dollars, no control characters, not too long."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in str(text))
    text = text if len(text) <= longest else text[: longest - 1] + "…"
    return text.replace("$", r"\$")


def thin(x: np.ndarray, y: np.ndarray, points: int, log: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest sample of each of points // 2 equal bins of x (of log x), so that peaks stay."""
    points = min(points, MOST_POINTS)
    if len(x) <= points:
        return x, y
    position = np.log(x) if log else x
    edges = np.linspace(position[0], position[-1], points // 2 + 1)[1:-1]
    bins = np.split(np.arange(len(x)), np.unique(np.searchsorted(position, edges)))
    keep = np.unique([i for b in bins if b.size for i in (b[y[b].argmin()], b[y[b].argmax()])])
    return x[keep], y[keep]


def legible(signal: Signal, most: int) -> int:
    """Samples to draw: of one period and at most `most` what holds few enough turns; more where that hides half the range."""
    u = signal.u
    longest = min(len(u), signal.period or len(u), most)
    turns = [_turns(column) for column in u[:longest].T]
    shortest = min([longest, *(int(at[MOST_TURNS]) for at in turns if len(at) > MOST_TURNS)])
    for shown in (shortest, longest) if 2 * shortest < longest else (longest,):  # a bit less would only puzzle
        if (np.ptp(u[:shown], axis=0) >= 0.5 * np.ptp(u, axis=0)).all():
            return shown
    return len(u)


def _turns(u: np.ndarray) -> np.ndarray:
    """Samples at which u (N,) begins to rise after it fell, or to fall after it rose."""
    steps = np.diff(u)
    at = np.flatnonzero(steps)
    return at[1:][np.sign(steps[at[1:]]) != np.sign(steps[at[:-1]])]


def log_scale(axes: Axes, which: str, low: float, high: float) -> None:
    """Make x or y of the Axes logarithmic from low to high, with few ticks in plain numbers."""
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    axis = axes.xaxis if which == "x" else axes.yaxis
    decades = np.log10(high / low)
    subs = (1, 2, 5) if decades < 1.3 else (1, 3) if decades < 2.6 else (1,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=8))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def legend(figure: Figure, *axes: Axes) -> None:
    """Put the legend of the given Axes below the figure; drawn last comes first, since the best is drawn on top."""
    named = {label: handle for axis in axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    if named:
        labels = list(named)[::-1]
        handles = [named[label] for label in labels]
        figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)))


def unit(name: str) -> str:
    """Return an axis label of a unit."""
    return plain(f"[{name or '–'}]")


def to_svg(figure: Figure) -> str:
    """Return the figure as an SVG element with coordinates to 0.01 pt.

    Its layout is settled the first time and then kept, so that the text is the same each time.
    """
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    figure.set_layout_engine("none")
    text = buffer.getvalue().decode("utf-8")
    text = text[text.index("<svg") :]
    return re.sub(r' (?:d|x|y)="[^"]*"', lambda attribute: re.sub(r"(\.\d\d)\d+", r"\1", attribute[0]), text)
