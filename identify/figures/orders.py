"""Order selection on one page: singular values, information criteria, stabilisation diagram."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from excite.figures.colours import PALETTE, Role
from excite.figures.figure import Axis, Figure, Line, Mark, Panel, Points, Range
from excite.words import capital, joined
from identify.orders.stabilisation import StablePole
from identify.orders.table import OrderRow, OrderTable

CAPTION = (
    "Above left: singular values relative to the largest; a clear drop after the order is a good sign. Below: information "
    "criteria above their best; the smallest is preferred. Right: modes over the order; those that stay from one order to "
    "the next are likely those of the system."
)
LOOKS: dict[str, dict[str, Any]] = {  # how a mode is drawn: by what of it the next lower order has too
    "new": {"marker": "cross", "size": 5, "colour": Role.MEASURED},
    "frequency stays": {"marker": "ring", "size": 4.5},
    "frequency and damping or shape stay": {"size": 5},
    "all three stay": {"size": 6},
}
COLOURS = dict(zip(LOOKS, (PALETTE[4], PALETTE[4], PALETTE[5], PALETTE[0]), strict=True))
CRITERIA = {"aic": "AIC", "bic": "BIC"}
NAMES = {"gap": "the widest gap", **CRITERIA}


def order_figure(method: str, table: OrderTable) -> Figure:
    """Return singular values with the largest gap, AIC and BIC above their best, and poles over frequency and order.

    table : of `identify.orders.order_table`, at least one of whose orders was fitted.
    """
    fitted = [row for row in table.rows if row.estimate is not None]
    s = _relative(fitted)
    limits = 0.5, max(fitted[-1].order, len(s)) + 0.5
    return Figure(
        name="orders",
        title=f"{method}: which order?",
        panels=(_singular_values(s, limits), _criteria(fitted, limits), _stabilisation(table)),
        caption=CAPTION,
        verdict=_verdict(table),
        height=4.6,
        widths=(1, 1.6),
        colours={**COLOURS, **{name: PALETTE[k + 1] for k, name in enumerate(CRITERIA.values())}},
    )


def _relative(fitted: Sequence[OrderRow]) -> np.ndarray:
    """Singular values of the largest order, relative to the first: twice as many as the order; none where it has none."""
    estimate = fitted[-1].estimate
    if estimate is None or estimate.singular_values is None or not len(estimate.singular_values):
        return np.empty(0)
    s = np.asarray(estimate.singular_values, float)[: max(2 * fitted[-1].order, 10)]
    return np.maximum(s / s[0], 1e-14)


def _singular_values(s: np.ndarray, limits: Range) -> Panel:
    line = Line(np.arange(1, len(s) + 1), s, marker="dot", size=3, colour=Role.SIGNAL)
    index = Axis("order", "", limits=limits, shared=True)
    return Panel((line,) if len(s) else (), index, Axis("relative", "", "log"), "singular values")


def _criteria(fitted: Sequence[OrderRow], limits: Range) -> Panel:
    orders, top = np.array([row.order for row in fitted]), 10.0
    marks: list[Mark] = []
    for name, label in CRITERIA.items():
        values = np.array([getattr(row.criteria, name, np.nan) for row in fitted], float)
        values[~np.isfinite(values)] = np.nan
        if np.isfinite(values).any():
            above = values - np.nanmin(values)
            top = max(top, np.nanmax(above))
            marks.append(Line(orders, above, style="dashed", marker="square", size=3, label=label, colour=label))
    y = Axis("above best", "", "symlog", limits=(-5.0, 3 * top), linear_within=10.0)
    return Panel(marks, Axis("order", "", limits=limits), y, "criteria", row=1, legend="inside")


def _stabilisation(table: OrderTable) -> Panel:
    poles = [pole for pole in table.poles if pole.mode.f_hz > 0]
    f = np.array([pole.mode.f_hz for pole in poles])
    marks: list[Mark] = []
    for k, (label, look) in enumerate(LOOKS.items()):
        mine = [pole for pole in poles if _level(pole) == k]
        numbers = [pole.mode.f_hz for pole in mine], [pole.order for pole in mine]
        marks.append(Points(*numbers, **{"colour": label, **look}, label=label))
    limits = (f.min() / 1.2, f.max() * 1.2) if f.size else (0.1, 10.0)
    x = Axis("natural frequency", "Hz", "log", limits=limits)
    return Panel(marks, x, Axis("order", ""), "stabilisation diagram", column=1, rows=2)


def _level(pole: StablePole) -> int:
    return 0 if not pole.frequency else 3 if pole.damping and pole.shape else 2 if pole.damping or pole.shape else 1


def _verdict(table: OrderTable) -> str:
    """Say which order each criterion prefers, those that agree together."""
    preferred: dict[int, list[str]] = {}
    for criterion, order in table.chosen.items():
        preferred.setdefault(order, []).append(NAMES.get(criterion, criterion))
    told = [
        f"{joined(names)} {'speak' if len(names) > 1 else 'speaks'} for order {n}" for n, names in preferred.items()
    ]
    return capital("; ".join(told)) + "." if told else "Nothing speaks for one order more than for another."
