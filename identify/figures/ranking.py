"""Errors against the truth, row by row."""

from typing import Any

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Bars, Figure, Line, Mark, Panel, Points, Range, Text
from excite.words import number
from identify.compare import Comparison, Row
from identify.figures.rows import colours, failed, median, quartiles, title, values

CAPTION = (
    "Median (dot), quartiles (thick line) and single runs (ticks) of the errors against the truth, on logarithmic axes, "
    "best row first."
)
METRICS = {
    "pole_error_max": ("worst pole error", "worst pole"),
    "frf_error_h2": ("frequency-response error over the band", "frequency response"),
}
MOST_ROWS = 24


def ranking(comparison: Comparison) -> Figure | None:
    """Return pole and frequency-response error of every row, best first: median, quartiles and the single runs."""
    rows = comparison.rows[:MOST_ROWS]
    metrics = [metric for metric in METRICS if any(np.isfinite(median(row, metric)) for row in rows)]
    if not metrics:
        return None
    names = tuple((float(place), title(row)) for place, row in enumerate(rows))
    panels = []
    for column, metric in enumerate(metrics):
        limits = _limits(rows, metric)
        marks = [mark for place, row in enumerate(rows) for mark in _row(row, metric, place, limits)]
        x = Axis(METRICS[metric][0], "%", "log", limits=limits)
        y = Axis(limits=(len(rows) - 0.4, -0.6), ticks=names, shared=column > 0)
        panels.append(Panel(marks, x, y, column=column, legend="none"))
    return Figure(
        name="ranking",
        title=f"{comparison.name}: errors against the truth (median, quartiles, runs)",
        panels=panels,
        caption=CAPTION,
        verdict=_verdict(rows, metrics),
        height=1.0 + 0.3 * len(rows),
        colours=colours(comparison),
    )


def _limits(rows: tuple[Row, ...], metric: str) -> Range:
    shown = 100 * np.concatenate([[*values(row, metric), median(row, metric)] for row in rows])
    positive = shown[np.isfinite(shown) & (shown > 0)]
    return (positive.min() / 2, positive.max() * 4) if positive.size else (0.1, 10.0)


def _row(row: Row, metric: str, place: int, limits: Range) -> list[Mark]:
    """Marks of one row in %, on the line `place`."""
    q25, middle, q75 = np.clip(100 * quartiles(row, metric), *limits)
    look: dict[str, Any] = {"label": title(row), "colour": row.label}
    if not np.isfinite(middle):
        words = "failed" if failed(row) else "no value"
        return [Text(limits[0] * 1.1, place, words, label=title(row), colour=Role.NOTE)]
    single = 100 * values(row, metric)
    text = Text(max([q75, *single]), place, number(100 * median(row, metric)), label=title(row), offset=(7.0, 0.0))
    return [
        Bars([limits[0]], [middle], [place - 0.3], [place + 0.3], alpha=0.3, **look),
        Points(single, np.full(len(single), place), marker="tick", size=8, width=0.8, alpha=0.6, **look),
        Line([q25, q75], [place, place], width=2.2, **look),
        Points([middle], [place], size=6, **look),
        text,
    ]


def _verdict(rows: tuple[Row, ...], metrics: list[str]) -> str:
    """Say how far the first row is off, and the second."""
    told = [row for row in rows if all(np.isfinite(median(row, metric)) for metric in metrics)]
    if not told:
        return "No row has every error."
    first = [f"{METRICS[metric][1]} off by {number(100 * median(told[0], metric))} %" for metric in metrics]
    sentence = f"{title(told[0])} comes first, {' and '.join(first)}"
    if len(told) > 1:
        second = " and ".join(f"{number(100 * median(told[1], metric))} %" for metric in metrics)
        sentence += f"; {title(told[1])} follows with {second}"
    return f"{sentence}."
