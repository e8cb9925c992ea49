"""Drawings as data: a figure is a grid of panels, a panel is marks over two axes.

Who draws something returns a `Figure`; `excite.figures.svg`, `json`, `csv` and `matplotlib_figure` make pictures and
tables of it. The caption says how to read it, the verdict what it says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from excite.errors import ExciteError
from excite.figures.colours import Role, palette
from excite.types.frozen import Frozen

Style = Literal["solid", "dashed", "dotted"]
Marker = Literal["dot", "ring", "cross", "tick", "square"]
COLUMNS = ("x", "y", "x_low", "x_high", "y_low", "y_high")  # where the numbers of every mark stand
Range = tuple[float, float]
Numbers = np.ndarray | Sequence[float]  # given as either, held as a read-only array


@dataclass(frozen=True, eq=False, kw_only=True)
class Mark:
    """What all marks share.

    Its numbers are float64: (k,) arrays of one length, read-only, or single numbers. NaN leaves a gap.

    Attributes
    ----------
    label : the legend's text; marks of one label and figure share one entry; "" has none.
    colour : a Role, or the label of whatever the mark belongs to, which has one colour in all figures of a run.
    alpha : opacity, 0 to 1.
    """

    label: str = ""
    colour: Role | str = Role.INK
    alpha: float = 1.0

    def __post_init__(self) -> None:
        lengths = {}
        for name, value in self.columns().items():
            array = np.array(value, np.float64)
            array.flags.writeable = False
            lengths[name] = array.shape
            object.__setattr__(self, name, array if array.ndim else float(array))
        if len(set(lengths.values())) > 1 or any(len(shape) > 1 for shape in lengths.values()):
            shapes = ", ".join(f"{name} {shape}" for name, shape in lengths.items())
            raise ExciteError(f"{type(self).__name__} '{self.label}': shapes {shapes}; give (k,) arrays of one length")

    def columns(self) -> dict[str, np.ndarray | float]:
        """Numbers of the mark by column, those of COLUMNS that it has."""
        return {name: value for name in COLUMNS if (value := getattr(self, name, None)) is not None}


@dataclass(frozen=True, eq=False)
class Line(Mark):
    """A line through (x, y); steps : each y is held until the next x; marker, size : at every point; width, size : pt."""

    x: Numbers
    y: Numbers
    width: float = field(default=1.1, kw_only=True)
    style: Style = field(default="solid", kw_only=True)
    steps: bool = field(default=False, kw_only=True)
    marker: Marker | None = field(default=None, kw_only=True)
    size: float = field(default=4.0, kw_only=True)


@dataclass(frozen=True, eq=False)
class Points(Mark):
    """Markers at (x, y); size : of the marker, width : of its strokes, pt."""

    x: Numbers
    y: Numbers
    marker: Marker = field(default="dot", kw_only=True)
    size: float = field(default=5.0, kw_only=True)
    width: float = field(default=1.0, kw_only=True)


@dataclass(frozen=True, eq=False)
class Band(Mark):
    """The area between y_low and y_high over x."""

    x: Numbers
    y_low: Numbers
    y_high: Numbers


@dataclass(frozen=True, eq=False)
class Bars(Mark):
    """Bars from x_low to x_high, each between y_low and y_high."""

    x_low: Numbers
    x_high: Numbers
    y_low: Numbers
    y_high: Numbers


@dataclass(frozen=True, eq=False)
class Span(Mark):
    """A stripe over the panel's whole height, from x_low to x_high."""

    x_low: float
    x_high: float


@dataclass(frozen=True, eq=False)
class Rule(Mark):
    """A line across the whole panel, at one x (upright) or at one y: one of the two is given."""

    x: float | None = None
    y: float | None = None
    width: float = field(default=0.9, kw_only=True)
    style: Style = field(default="solid", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.x is None) == (self.y is None):
            raise ExciteError(f"Rule '{self.label}': x {self.x}, y {self.y}; give one of the two")


@dataclass(frozen=True, eq=False)
class Text(Mark):
    """Words at (x, y).

    frame : what x and y count in, the axes' units ("data"), or shares of the panel from its lower left ("panel");
    across, up : which side of the text lies there; offset : (right, up) from there, pt; size : pt.
    """

    x: float
    y: float
    text: str
    frame: Literal["data", "panel"] = field(default="data", kw_only=True)
    across: Literal["left", "center", "right"] = field(default="left", kw_only=True)
    up: Literal["top", "center", "bottom"] = field(default="center", kw_only=True)
    offset: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)
    size: float = field(default=8.5, kw_only=True)


@dataclass(frozen=True)
class Axis:
    """One axis of a panel.

    Attributes
    ----------
    label : what is drawn along it; may be "" where the panel's title says so.
    unit : None without one (places of a list), "" of a pure number.
    scale : "symlog" is linear from -linear_within to linear_within and logarithmic beyond.
    limits : from, to; None fits them to the data.
    ticks : (position, text); None chooses them: plain numbers, few of them on a logarithmic axis.
    shared : another panel of the grid, below or to the left, shows the same axis: neither label nor numbers are drawn.
    """

    label: str = ""
    unit: str | None = None
    scale: Literal["linear", "log", "symlog"] = "linear"
    limits: Range | None = None
    ticks: tuple[tuple[float, str], ...] | None = None
    shared: bool = False
    linear_within: float = 1.0

    def __post_init__(self) -> None:
        if self.limits is not None:
            low, high = map(float, self.limits)
            if not np.isfinite([low, high]).all() or low == high or (self.scale == "log" and min(low, high) <= 0):
                raise ExciteError(
                    f"Axis '{self.text}': limits {self.limits} of a {self.scale} axis; give two different finite "
                    "numbers, positive ones where it is logarithmic"
                )
            object.__setattr__(self, "limits", (low, high))

    @property
    def text(self) -> str:
        """Label with its unit in brackets."""
        return " ".join(filter(None, (self.label, "" if self.unit is None else f"[{self.unit or '–'}]")))


@dataclass(frozen=True, eq=False)
class Panel:
    """Marks over two axes, drawn in their order, at a place of the figure's grid.

    Attributes
    ----------
    row, column, rows, columns : first row and column, and how many of each it fills.
    legend : where labels are explained: below the figure, inside the panel, or nowhere.
    """

    marks: Sequence[Mark]
    x: Axis
    y: Axis
    title: str = ""
    row: int = 0
    column: int = 0
    rows: int = 1
    columns: int = 1
    legend: Literal["below", "inside", "none"] = "below"

    def __post_init__(self) -> None:
        object.__setattr__(self, "marks", tuple(self.marks))


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawing, as data.

    Attributes
    ----------
    name : what its files are called, "poles".
    title : one line above the panels.
    caption : how to read it.
    verdict : one plain sentence, computed from the data: what it says.
    height : of the whole at a width of 9, inches.
    widths, heights : of columns and rows relative to each other; all alike when not given.
    colours : label -> "#rrggbb"; labels without one get it from the palette.

    Examples
    --------
    >>> line = Line([0, 1, 2], [0, 1, 4], label="squares", colour="squares")
    >>> panel = Panel((line,), Axis("time", "s"), Axis("distance", "m"))
    >>> Figure("squares", "Squares", (panel,)).colour("squares")
    '#0072B2'
    """

    name: str
    title: str
    panels: Sequence[Panel]
    caption: str = ""
    verdict: str = ""
    height: float = 4.2
    widths: Sequence[float] = ()
    heights: Sequence[float] = ()
    colours: Mapping[str, str] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        object.__setattr__(self, "panels", tuple(self.panels))
        if not self.panels:
            raise ExciteError(f"Figure '{self.name}': no panels; give at least one")
        rows, columns = self.grid
        for key, count in (("widths", columns), ("heights", rows)):
            ratios = tuple(getattr(self, key))
            if len(ratios) not in (0, count):
                raise ExciteError(f"Figure '{self.name}': {len(ratios)} {key} for {count}; give one for each")
            object.__setattr__(self, key, ratios)
        known = palette(m.colour for panel in self.panels for m in panel.marks if isinstance(m.colour, str))
        object.__setattr__(self, "colours", Frozen({**known, **self.colours}))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return max(p.row + p.rows for p in self.panels), max(p.column + p.columns for p in self.panels)

    def colour(self, key: Role | str) -> str:
        """Return the colour of a role or a label, "#rrggbb"."""
        return key.value if isinstance(key, Role) else self.colours[key]
