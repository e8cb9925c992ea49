"""Order selection on one page: singular values, information criteria, stabilisation diagram."""

import numpy as np

from excite.figures.colours import PALETTE, Role
from excite.figures.figure import Axis, Figure, Line, Mark, Panel, Points
from excite.words import capital, joined
from identify.orders.orders import OrderTable, StablePole

CAPTION = (
    "Above left: singular values relative to the largest; a clear drop after the order is a good sign. Below: information "
    "criteria above their best; the smallest is preferred. Right: modes over the order; those that stay from one order to "
    "the next are likely those of the system."
)
LOOKS = {  # how a mode is drawn: by what of it the next lower order has too
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
    values, criteria = _singular_values(table), _criteria(table)
    return Figure(
        name="orders",
        title=f"{method}: which order?",
        panels=(values, criteria, _stabilisation(table)),
        caption=CAPTION,
        verdict=_verdict(table),
        height=4.6,
        widths=(1, 1.6),
        colours={**COLOURS, **{name: PALETTE[k + 1] for k, name in enumerate(CRITERIA.values())}},
    )


def _orders(table: OrderTable) -> np.ndarray:
    return np.array([row.order for row in table.rows if row.estimate is not None])


def _singular_values(table: OrderTable) -> Panel:
    orders = _orders(table)
    s = next((r.estimate.singular_values for r in reversed(table.rows) if r.estimate is not None), None)
    marks: list[Mark] = []
    longest = 1
    if s is not None and len(s):
        shown = np.maximum(s[: max(2 * orders.max(), 10)] / s[0], 1e-14)
        longest = len(shown)
        marks.append(Line(np.arange(1, longest + 1), shown, marker="dot", size=3, colour=Role.SIGNAL))
    index = Axis("order", "", limits=_order_limits(orders, longest), shared=True)
    return Panel(marks, index, Axis("relative", "", "log"), "singular values")


def _order_limits(orders: np.ndarray, longest: int) -> tuple[float, float]:
    return 0.5, max(int(orders.max()), longest) + 0.5


def _criteria(table: OrderTable) -> Panel:
    fitted, orders = [row for row in table.rows if row.estimate is not None], _orders(table)
    s = fitted[-1].estimate.singular_values
    longest = 1 if s is None else len(s[: max(2 * orders.max(), 10)])
    marks: list[Mark] = []
    top = 10.0
    for name, label in CRITERIA.items():
        values = np.array([getattr(row.criteria, name) for row in fitted], float)
        values[~np.isfinite(values)] = np.nan
        if np.isfinite(values).any():
            above = values - np.nanmin(values)
            top = max(top, np.nanmax(above))
            marks.append(Line(orders, above, style="dashed", marker="square", size=3, label=label, colour=label))
    x = Axis("order", "", limits=_order_limits(orders, longest))
    y = Axis("above best", "", "symlog", limits=(-5.0, 3 * top), linear_within=10.0)
    return Panel(marks, x, y, "criteria", row=1, legend="inside")


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
