"""The columns of the ranking table, from the table of metrics, and numbers as text."""

from excite.words import number
from identify.compare import Comparison
from identify.metrics.metric import Metric
from identify.metrics.registry import find_metric, metrics_at, table


def columns_of(found: Comparison, compact: bool = False) -> tuple[list[Metric], list[str]]:
    """Return the metrics that a comparison's table shows, those at its prediction horizons behind the others, and their headers.

    compact : only those that fit a terminal, under short headers.
    """
    names = {name for row in found.rows for s in row.scores for name in s.values}
    horizons = {m.horizon for name in names if (m := find_metric(name)) is not None and m.horizon is not None}
    ranks = set(found.rank_by)
    shown = [m for m in metrics_at(sorted(horizons)) if (m.compact if compact else m.column) or m.name in ranks]
    return shown, [m.short_title(found.dt) if compact else m.title(found.dt) for m in shown]


def legend() -> list[tuple[str, str, str]]:
    """Return rows (metrics, what they tell, what they cannot tell); metrics of the same explanation share one."""
    rows: dict[tuple[str, str], list[str]] = {}
    for metric in table():
        if metric.column:
            rows.setdefault((metric.tells, metric.cannot_tell), []).append(metric.words())
    quartiles = "Quartiles over the estimation runs.", "Errors that all runs share, such as bias or a wrong order."
    rows[quartiles] = ["[q25 q75]"]
    return [("; ".join(names), *texts) for texts, names in rows.items()]


def complex_text(s: complex) -> str:
    """Return a pole as text, with ± for the pair."""
    real = number(s.real).replace("-", "−")
    return real if abs(s.imag) < 1e-9 * max(abs(s), 1e-12) else f"{real} ± {number(abs(s.imag))}j"
