"""Variance accounted for: the part of each output's variance that a model explains."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from identify.metrics.fits import bounded, ratio, varying
from identify.metrics.judgement import Judgement
from identify.metrics.metric import Metric, Need


def vaf_percent(y: np.ndarray, yhat: np.ndarray) -> np.ndarray:
    """Return the variance accounted for of each output in %, unclipped: 100 (1 - var(y - yhat) / var y).

    Parameters
    ----------
    y, yhat : (N, ny) measured and modelled outputs.

    Returns
    -------
    (ny,) : 100 for a perfect model and for one that is wrong by an offset alone; NaN for a constant output.

    References
    ----------
    Mercère, Markovsky and Ramos (2016), eq. (40b).
    """
    return 100 * (1 - ratio(np.var(bounded(y - yhat), axis=0), np.var(y, axis=0)))


def _vaf(yhat: str) -> Callable[[Judgement], np.ndarray]:
    def compute(judgement: Judgement) -> np.ndarray:
        return varying(vaf_percent(judgement.y, judgement.predicted[yhat]), judgement.record.outputs)

    return compute


_COMMON: Mapping[str, Any] = {
    "cannot_tell": "Offsets, which a variance does not see; near 100 % it tells models apart less well than the fit.",
    "unit": "%",
    "decimals": 2,
    "smaller_is_better": False,
    "best": 100.0,
    "lowest": 0.0,
}
_SIMULATION = frozenset({Need.RECORD, Need.SIMULATION})
_PREDICTION = _SIMULATION | {Need.PREDICTION}

VAF_SIMULATION = Metric(
    "vaf_simulation",
    "variance accounted for by the simulated output, %",
    _vaf("simulation"),
    tells="Variance accounted for by the simulation.",
    header="VAF simulation",
    short="VAF sim %",
    needs=_SIMULATION,
    compact=True,
    **_COMMON,
)

VAF_ONE_STEP = Metric(
    "vaf_one_step",
    "variance accounted for by the one-step prediction, %",
    _vaf("one_step"),
    tells="Variance accounted for by the one-step prediction.",
    header="VAF one step",
    needs=_PREDICTION,
    column=False,
    **_COMMON,
)


def vaf_ahead(horizon: int) -> Metric:
    """Return the variance accounted for by the prediction `horizon` samples ahead on the validation record."""
    return Metric(
        f"vaf_{horizon}_step",
        "variance accounted for by the prediction at that horizon, %",
        _vaf(f"{horizon}_step"),
        tells="Variance accounted for by the prediction from the outputs measured up to that horizon.",
        header="VAF {ahead} ahead",
        needs=_PREDICTION,
        column=False,
        horizon=horizon,
        **_COMMON,
    )
