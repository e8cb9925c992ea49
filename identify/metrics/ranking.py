"""Ranking: one number from the metrics that a comparison is ranked by."""

from collections.abc import Mapping, Sequence

import numpy as np

from identify.metrics.registry import load_metric

LEAST = 1e-300  # a loss of 0 counts as this, so that it has a logarithm


def ranking_value(
    medians: Mapping[str, float], reasons: Mapping[str, str], rank_by: Sequence[str]
) -> tuple[float, str | None]:
    """Return what rows are ranked by, smaller is better, and why a row has no such value.

    It is the geometric mean of the losses of the ranking metrics, where the loss of a metric is how far its median over
    the runs is from the value of a perfect model (`Metric.loss`).

    Parameters
    ----------
    medians : metric -> median over the runs; absent or NaN where it has no value in some run.
    reasons : metric -> why it has none.
    rank_by : names of metrics.

    Returns
    -------
    value : inf where a ranking metric has no value.
    reason : which metric that is, and why; else None.
    """
    losses = []
    for name in rank_by:
        metric, median = load_metric(name), medians.get(name, np.nan)
        if np.isnan(median):
            return np.inf, f"{metric.words()}: {reasons.get(name, 'no value')}"
        losses.append(metric.loss(median))
    return float(np.exp(np.mean(np.log(np.maximum(losses, LEAST))))), None
