"""Order selection on one page: singular values, information criteria, stabilisation diagram."""

import numpy as np
from matplotlib.figure import Figure

from identify.orders.stabilisation import StablePole
from identify.orders.table import OrderTable
from scenarios.report.drawing import PALETTE, canvas, log_scale, plain, styled

LOOKS = (
    ("new", {"marker": "x", "color": "#b4b4b4", "ms": 5}),
    ("frequency stays", {"marker": "o", "color": PALETTE[4], "ms": 4, "mfc": "none"}),
    ("frequency and damping or shape stay", {"marker": "o", "color": PALETTE[5], "ms": 4}),
    ("all three stay", {"marker": "o", "color": PALETTE[0], "ms": 5}),
)


@styled
def order_figure(method: str, table: OrderTable) -> Figure:
    """Return singular values with the largest gap, AIC and BIC above their best, and poles over frequency and order."""
    figure = canvas(4.2, f"{method}: which order?")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
    fitted = [row for row in table.rows if row.estimate is not None]
    s = fitted[-1].estimate.singular_values
    orders = np.array([row.order for row in fitted])
    if s is not None:
        shown = s[: max(2 * orders.max(), 10)]
        look = {"ms": 3, "color": PALETTE[0], "label": "singular values, relative"}
        left.semilogy(np.arange(1, len(shown) + 1), shown / shown[0], "o-", **look)
    twin = left.twinx()
    for k, name in enumerate(("aic", "bic")):
        values = np.array([getattr(row.criteria, name) for row in fitted])
        if np.isfinite(values).any():
            twin.plot(
                orders,
                values - np.nanmin(values),
                "s--",
                ms=3,
                color=PALETTE[k + 1],
                label=f"{name.upper()} above best",
            )
    twin.set_yscale("symlog", linthresh=10)
    twin.grid(False)
    left.set(xlabel="order", title="singular values, criteria (right)")
    handles = [axis.get_legend_handles_labels() for axis in (left, twin)]
    left.legend(handles[0][0] + handles[1][0], handles[0][1] + handles[1][1], fontsize=6.5, loc="upper right")
    f = np.array([p.mode.f_hz for p in table.poles if p.mode.f_hz > 0])
    for k, (label, look) in enumerate(LOOKS):
        mine = [p for p in table.poles if p.mode.f_hz > 0 and _level(p) == k]
        right.plot([p.mode.f_hz for p in mine], [p.order for p in mine], ls="", label=plain(label), **look)
    if f.size:
        log_scale(right, "x", f.min() / 1.2, f.max() * 1.2)
    right.set(xlabel="natural frequency [Hz]", ylabel="order", title="stabilisation diagram")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _level(pole: StablePole) -> int:
    return 0 if not pole.frequency else 3 if pole.damping and pole.shape else 2 if pole.damping or pole.shape else 1
