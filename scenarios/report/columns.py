"""The columns of the ranking table, from the table of metrics, and numbers as text."""

import numpy as np

from identify.metrics.metric import Metric
from identify.metrics.registry import find_metric, metrics_at, table
from scenarios.run.results import ViewResult

NONE = "–"


def columns_of(view: ViewResult, compact: bool = False) -> tuple[list[Metric], list[str]]:
    """Return the metrics that a view's table shows, those at its prediction horizons behind the others, and their headers.

    compact : only those that fit a terminal, under short headers.
    """
    names = {name for row in view.rows for s in row.scores for name in s.values}
    horizons = {m.horizon for name in names if (m := find_metric(name)) is not None and m.horizon is not None}
    shown = [m for m in metrics_at(sorted(horizons)) if (m.compact if compact else m.column)]
    return shown, [m.short_title(view.dt) if compact else m.title(view.dt) for m in shown]


def legend() -> list[tuple[str, str, str]]:
    """Return rows (metrics, what they tell, what they cannot tell); metrics of the same explanation share one."""
    rows: dict[tuple[str, str], list[str]] = {}
    for metric in table():
        if metric.column:
            rows.setdefault((metric.tells, metric.cannot_tell), []).append(metric.words())
    quartiles = "Quartiles over the estimation runs.", "Errors that all runs share, such as bias or a wrong order."
    rows[quartiles] = ["[q25 q75]"]
    return [("; ".join(names), *texts) for texts, names in rows.items()]


def number(value: float, decimals: int | None = None) -> str:
    """Return a number as text: fixed decimals, or three digits without needless powers of ten."""
    if not np.isfinite(value):
        return NONE if np.isnan(value) else "∞" if value > 0 else "−∞"
    if decimals is not None:
        return f"{value:.{decimals}f}"
    if value == 0 or 1e-4 <= abs(value) < 999.5:
        return f"{value:.3g}"
    return f"{value:.0f}" if 1 <= abs(value) < 1e5 else f"{value:.1e}"


def complex_text(s: complex) -> str:
    """Return a pole as text, with ± for the pair."""
    real = number(s.real).replace("-", "−")
    return real if abs(s.imag) < 1e-9 * max(abs(s), 1e-12) else f"{real} ± {number(abs(s.imag))}j"
