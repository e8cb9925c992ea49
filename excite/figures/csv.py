"""A figure as a table: one row per point of every mark, with the axes and their units beside the numbers."""

import csv
import io
from collections.abc import Iterator

import numpy as np

from excite.figures.figure import COLUMNS, Figure, Mark, Text
from excite.figures.matplotlib_figure import printable

HEADER = ("panel", "mark", "label", *COLUMNS, "text", "x_axis", "y_axis")
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would execute, were it to stand first in a cell


def to_csv(figure: Figure) -> str:
    """Return the figure as CSV (comma, point, header row).

    Each row tells its panel, the kind of mark, its label, its numbers (x, y, or x_low to x_high, y_low to y_high; the
    others and missing ones are empty), its words, and what x and y are with their units. Panels are numbered where they
    have no title of their own.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    titles = [panel.title for panel in figure.panels]
    for k, panel in enumerate(figure.panels):
        distinct = panel.title and titles.count(panel.title) == 1
        name = panel.title if distinct else f"{k + 1} {panel.title}".strip()
        axes = [as_text(panel.x.text), as_text(panel.y.text)]
        for mark in panel.marks:
            start = [as_text(name), type(mark).__name__.lower(), as_text(mark.label)]
            text = as_text(mark.text if isinstance(mark, Text) else "")
            writer.writerows([*start, *numbers, text, *axes] for numbers in _rows(mark))
    return stream.getvalue()


def as_text(cell: str) -> str:
    """Return text that a spreadsheet shows and never executes, without control characters."""
    return printable(f"'{cell}" if cell.startswith(FORMULA) else cell)


def _rows(mark: Mark) -> Iterator[tuple[float | str, ...]]:
    """Yield the numbers of a mark, one tuple in the order of COLUMNS for each of its points."""
    numbers = {name: np.atleast_1d(values).tolist() for name, values in mark.columns().items()}
    count = len(next(iter(numbers.values())))
    empty = [""] * count
    columns = [[v if np.isfinite(v) else "" for v in numbers[name]] if name in numbers else empty for name in COLUMNS]
    return zip(*columns, strict=True)
