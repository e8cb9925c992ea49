"""Fit: how much of the outputs a model explains, on the measured record and on its noise-free twin."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.types.channel import Channel, listed
from excite.types.truth import Truth
from identify.metrics.judgement import Judgement, predicts
from identify.metrics.metric import Metric, Need, NotApplicable

DIVERGED = 1e150  # what errors of a diverging model are set to, so that norms stay computable
INTEGRATES = 1e-9  # closer to the unit circle than this, a pole of the truth does not forget


def fit_percent(y: np.ndarray, yhat: np.ndarray) -> np.ndarray:
    """Return the fit of each output in %, unclipped: 100 (1 - ||y - yhat|| / ||y - mean y||).

    Parameters
    ----------
    y, yhat : (N, ny) measured and modelled outputs.

    Returns
    -------
    (ny,) : 100 for a perfect model, 0 for the mean of y; NaN for a constant output.

    References
    ----------
    Mercère, Markovsky and Ramos (2016), eq. (40a).
    """
    return 100 * (1 - ratio(la.norm(bounded(y - yhat), axis=0), la.norm(y - y.mean(0), axis=0)))


def bounded(error: np.ndarray) -> np.ndarray:
    """Return errors with those beyond 1e150, of a diverging model, at 1e150."""
    return np.clip(np.nan_to_num(error, nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED), -DIVERGED, DIVERGED)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Return numerator / denominator, NaN where the denominator is 0."""
    return np.divide(numerator, denominator, out=np.full(len(denominator), np.nan), where=denominator > 0)


def varying(values: np.ndarray, outputs: Sequence[Channel]) -> np.ndarray:
    """Return the values (ny,) per output; raises NotApplicable where some are NaN because the output is constant."""
    if np.isnan(values).any():
        names = [f"'{c.name}'" for c, value in zip(outputs, values, strict=True) if np.isnan(value)]
        raise NotApplicable(f"{listed(names)} {'is' if len(names) == 1 else 'are'} constant on this record", values)
    return values


def _fit(yhat: str) -> Callable[[Judgement], np.ndarray]:
    def compute(judgement: Judgement) -> np.ndarray:
        fits = fit_percent(judgement.y, judgement.predicted[yhat])
        return varying(fits, judgement.record.outputs)

    return compute


def _clean_fit(judgement: Judgement, horizon: int | None) -> np.ndarray:
    yhat = judgement.predicted_clean["simulation" if horizon is None else f"{horizon}_step"]
    return varying(fit_percent(judgement.clean.y, yhat), judgement.clean.outputs)


def floor_horizon(truth: Truth, horizons: Sequence[int]) -> int | None:
    """Return the horizon (samples, None: simulation) at which models are compared with the truth.

    It is simulation where the truth forgets its past, and the longest prediction horizon where it integrates: a
    simulation of integrators over minutes judges luck.
    """
    forgets = np.abs(np.asarray(truth.poles)).max(initial=0) < 1 - INTEGRATES
    return None if forgets or not horizons or not predicts(truth.model) else max(horizons)


def floor_metric(truth: Truth, horizons: Sequence[int] = ()) -> str:
    """Return the name of the metric in which models are compared with the linearisation floor."""
    horizon = floor_horizon(truth, horizons)
    return "fit_clean" if horizon is None else f"fit_clean_{horizon}_step"


def _below_floor(judgement: Judgement) -> float:
    horizon = floor_horizon(judgement.truth, judgement.case.horizons)
    if horizon is not None and (reason := Need.PREDICTION.missing(judgement)):
        raise NotApplicable(reason)
    floor, own = (np.maximum(_clean_fit(each, horizon), 0).mean() for each in (judgement.case.true, judgement))
    return float(floor - own)


_DATA = frozenset({Need.RECORD, Need.SIMULATION})
_TWIN = frozenset({Need.CLEAN, Need.SIMULATION})
_PREDICTION = frozenset({Need.PREDICTION})
_PERCENT: Mapping[str, Any] = {"unit": "%", "decimals": 2, "smaller_is_better": False, "best": 100.0, "lowest": 0.0}
_AHEAD: Mapping[str, Any] = {
    "tells": "Prediction from the outputs measured up to that horizon.",
    "cannot_tell": "Whether the dynamics are right: with fast sampling the next output is nearly the last, and a poor "
    "model fits.",
}
_NOISE_FREE: Mapping[str, Any] = {
    "tells": "The same on the noise-free twin of that run, and how far it stays below the fit of the linearised truth "
    "itself (the linearisation floor): by simulation, or at the longest horizon where the truth integrates.",
    "cannot_tell": "How the model does at other amplitudes: the floor belongs to this run. Below zero means that the "
    "model suits this amplitude better than the small-signal truth does.",
}

FIT_SIMULATION = Metric(
    "fit_simulation",
    "fit of the simulated output on the validation record, %",
    _fit("simulation"),
    tells="How well the measured validation output is simulated from its input alone (unlimited horizon).",
    cannot_tell="Which model is nearer the truth: noise bounds it, and in closed loop the input carries the noise, so "
    "that fit against measured closed-loop output rewards bias. It is not used for ranking unless the scenario asks.",
    header="fit simulation, measured",
    short="fit sim %",
    needs=_DATA,
    compact=True,
    **_PERCENT,
)

FIT_CLEAN = Metric(
    "fit_clean",
    "fit of the simulated output on the noise-free twin of the validation run, %",
    lambda judgement: _clean_fit(judgement, None),
    header="fit simulation, noise-free",
    short="fit clean %",
    needs=_TWIN,
    compact=True,
    **_NOISE_FREE,
    **_PERCENT,
)

FIT_BELOW_FLOOR = Metric(
    "fit_below_floor",
    "points by which the fit on the noise-free twin stays below that of the linearised truth",
    _below_floor,
    header="below floor",
    unit="points",
    decimals=2,
    short="below floor",
    needs=_TWIN | {Need.TRUTH, Need.TRUE_MODEL},
    compact=True,
    **_NOISE_FREE,
)

FIT_ONE_STEP = Metric(
    "fit_one_step",
    "fit of the one-step prediction on the validation record, %",
    _fit("one_step"),
    header="fit one step",
    short="1-step %",
    needs=_DATA | _PREDICTION,
    compact=True,
    **_AHEAD,
    **_PERCENT,
)


def fit_ahead(horizon: int) -> Metric:
    """Return the fit of the prediction `horizon` samples ahead on the validation record."""
    return Metric(
        f"fit_{horizon}_step",
        "fit of the prediction at that horizon on the validation record, %",
        _fit(f"{horizon}_step"),
        header="fit {ahead} ahead",
        needs=_DATA | _PREDICTION,
        horizon=horizon,
        **_AHEAD,
        **_PERCENT,
    )


def fit_clean_ahead(horizon: int) -> Metric:
    """Return the fit of the prediction `horizon` samples ahead on the noise-free twin, for the longest horizon."""
    return Metric(
        f"fit_clean_{horizon}_step",
        "fit of the prediction at the longest horizon on the noise-free twin of the validation run, %",
        lambda judgement: _clean_fit(judgement, horizon),
        header="fit {ahead} ahead, noise-free",
        short="{ahead} clean",
        needs=_TWIN | _PREDICTION,
        compact=True,
        horizon=horizon,
        longest=True,
        **_NOISE_FREE,
        **_PERCENT,
    )
