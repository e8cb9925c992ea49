"""Rows of a comparison, as figures need them: named, coloured, and the best of each label."""

import numpy as np

from excite.figures.colours import palette
from excite.models.model import Dynamic, Model
from excite.models.modes import continuous_poles
from identify.compare import Comparison, Row
from identify.estimate import Estimate

MOST_LABELS = 6  # so many lines can be told apart in one figure
MOST_RUNS = 30


def title(row: Row) -> str:
    """Name of a row in legends: its label, and its order where it has one."""
    return row.label if row.order is None else f"{row.label} n={row.order}"


def colours(comparison: Comparison) -> dict[str, str]:
    """Colour of each label of a comparison, whether or not a figure shows it."""
    return palette(row.label for row in comparison.rows)


def quartiles(row: Row, metric: str) -> np.ndarray:
    """Return lower quartile, median and upper quartile of a metric over the trials, NaN where it does not apply."""
    summary = row.summary.get(metric, {})
    return np.array([summary.get(statistic, np.nan) for statistic in ("q25", "median", "q75")], float)


def median(row: Row, metric: str) -> float:
    """Return the median of a metric over the trials, NaN where it does not apply."""
    return float(quartiles(row, metric)[1])


def values(row: Row, metric: str) -> np.ndarray:
    """Return a metric of the trials to which it applies (k,), at most MOST_RUNS."""
    found = [trial.score.values.get(metric, np.nan) for trial in row.trials if trial.score is not None]
    array = np.array(found, float)
    return array[~np.isnan(array)][:MOST_RUNS]


def estimates(row: Row) -> list[Estimate]:
    """Return the estimates of a row's trials, at most MOST_RUNS."""
    return [trial.estimate for trial in row.trials if trial.estimate is not None][:MOST_RUNS]


def failed(row: Row) -> bool:
    """Whether a trial of the row gave no estimate."""
    return any(trial.failure is not None for trial in row.trials)


def s_plane(model: Model) -> np.ndarray:
    """Return the poles of a model in the s-plane, rad/s; none where it has none."""
    if not isinstance(model, Dynamic):
        return np.empty(0, complex)
    return model.poles() if model.dt is None else continuous_poles(model.poles(), model.dt)


def true_poles(comparison: Comparison) -> np.ndarray | None:
    """Return the poles of the truth in the s-plane, rad/s; None where no truth with poles is known."""
    truth = comparison.truth
    if truth is None or not isinstance(truth.model, Dynamic):
        return None
    return continuous_poles(truth.poles, truth.model.dt)


def best_rows(comparison: Comparison, ability: type = Model) -> list[Row]:
    """Return the best row of each label that gave a model with an ability, best first, at most MOST_LABELS."""
    best: dict[str, Row] = {}
    for row in comparison.rows:
        found = estimates(row)
        if found and isinstance(found[0].model, ability):
            best.setdefault(row.label, row)
    return list(best.values())[:MOST_LABELS]
