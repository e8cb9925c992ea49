"""Singular values, from which the order can be judged."""

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Figure, Line, Mark, Panel, Points, Rule
from excite.words import capital, joined, number
from identify.compare import Comparison, Row
from identify.figures.rows import best_rows, colours, estimates, title
from identify.orders.gap import largest_gap

CAPTION = (
    "Singular values from which the order can be judged: a clear drop after the order is a good sign, a gentle slope "
    "means that the data do not tell it."
)


def _order(row: Row) -> int:
    """Return the order of a row that was asked for as a number, else 0."""
    return row.order if isinstance(row.order, int) else 0


def singular_values(comparison: Comparison) -> Figure | None:
    """Return the singular values of each label's first run, relative to the largest, with the order that was used."""
    rows = {row: s for row in best_rows(comparison) if (s := estimates(row)[0].singular_values) is not None and len(s)}
    if not rows:
        return None
    longest = max(24, *(2 * _order(row) + 4 for row in rows))
    lowest, marks = 1.0, []
    for row, values in reversed(rows.items()):
        s = np.asarray(values, float)[:longest]
        s = np.maximum(s / s[0], 1e-14)
        lowest = min(lowest, s.min())
        marks += _row(row, s)
    if (order := _true_order(comparison)) is not None:
        marks.append(Rule(x=order + 0.5, style="dashed", label="order of the truth", colour=Role.TRUTH))
    index = Axis("index", "", limits=(0.5, longest + 0.5))
    relative = Axis("singular value / largest", "", "log", limits=(lowest / 2, 2))
    return Figure(
        name="singular-values",
        title=f"{comparison.name}: singular values (first run); the ring marks the order used",
        panels=(Panel(marks, index, relative),),
        caption=CAPTION,
        verdict=_verdict(rows, comparison),
        height=3.2,
        colours=colours(comparison),
    )


def _true_order(comparison: Comparison) -> int | None:
    return None if comparison.truth is None else getattr(comparison.truth.model, "order", None)


def _row(row: Row, s: np.ndarray) -> list[Mark]:
    marks: list[Mark] = [
        Line(np.arange(1, len(s) + 1), s, width=0.9, marker="dot", size=3, label=title(row), colour=row.label)
    ]
    order = _order(row)
    if 0 < order <= len(s):
        marks.append(Points([order], [s[order - 1]], marker="ring", size=9, width=1.5, colour=row.label))
    return marks


def _verdict(rows: dict[Row, np.ndarray], comparison: Comparison) -> str:
    """Say after which value each row's singular values drop most."""
    told = []
    for row, s in rows.items():
        if len(s) > 1:
            after, ratio = largest_gap(s)
            told.append(f"after {after} for {title(row)} (by a factor of {number(ratio)})")
    order = _true_order(comparison)
    truth = "" if order is None else f"; the truth has order {order}"
    return f"The widest drop comes {joined(told)}{truth}." if told else capital(f"one singular value only{truth}.")
