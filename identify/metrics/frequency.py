"""Errors of the frequency response against the truth."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from excite.models.model import Dynamic, Model
from excite.models.modes import continuous_poles
from identify.metrics.judgement import Case, Judgement
from identify.metrics.metric import Metric, Need, NotApplicable
from identify.metrics.poles import INTEGRATOR

POINTS = 400  # frequencies of the band, logarithmically spaced


def frf_errors(model: Model, truth: Model, band_hz: tuple[float, float], points: int = POINTS) -> tuple[float, float]:
    """Return the relative H2-type and the relative peak error of the frequency response over a band.

    Parameters
    ----------
    model, truth : with the same inputs and outputs.
    band_hz : low and high frequency in Hz.
    points : frequencies in it, logarithmically spaced.

    Returns
    -------
    H2-type : sqrt(int |Ghat - G|_F^2 df / int |G|_F^2 df), with Frobenius norms.
    peak : max over f of |Ghat - G|_2 / |G|_2, with spectral norms.

    Examples
    --------
    >>> from excite import StateSpaceModel
    >>> truth, model = (StateSpaceModel([[0.9]], [[gain]], [[1]], [[0]], 0.1) for gain in (1.0, 1.1))
    >>> [round(error, 3) for error in frf_errors(model, truth, (0.1, 4.0))]
    [0.1, 0.1]
    """
    f = np.geomspace(*band_hz, points)
    return response_errors(f, model.frf(f), truth.frf(f))


def response_errors(f_hz: np.ndarray, estimated: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return the errors of `frf_errors` for responses (F, ny, nu) at f_hz (F,)."""
    error = estimated - true
    with np.errstate(divide="ignore", invalid="ignore"):
        power = [np.trapezoid((np.abs(m) ** 2).sum((1, 2)), f_hz) for m in (error, true)]
        peak = np.linalg.norm(error, 2, axis=(1, 2)) / np.linalg.norm(true, 2, axis=(1, 2))
        return float(np.sqrt(power[0] / power[1])), float(peak.max())


def default_band(poles: np.ndarray, dt: float) -> tuple[float, float]:
    """Return the band (Hz) for `frf_errors` when none is given.

    It goes from a third of the slowest z-plane pole that is no integrator to 0.4 of the sampling rate 1 / dt.
    """
    s = np.abs(continuous_poles(poles, dt)) / (2 * np.pi)
    s = s[s * dt > INTEGRATOR]
    high = 0.4 / dt
    return min(s.min(initial=high) / 3, high / 10), high


def band_of(case: Case) -> tuple[float, float]:
    """Return the band (Hz) of a case: the one given, else that of the truth's poles or of its measured response."""
    if case.band_hz is not None:
        return case.band_hz
    true, dt = case.true, case.true.model.dt
    if not isinstance(true.model, Dynamic) or dt is None:
        low, high = _known(true.model)
        if not np.isfinite(high):
            raise NotApplicable("no sampled poles of the truth choose a band; give band_hz")
        return low, high
    return default_band(np.asarray(true.truth.poles), dt)


def _true_response(case: Case) -> tuple[np.ndarray, np.ndarray]:
    f = np.geomspace(*band_of(case), POINTS)
    low, high = _known(case.true.model)
    f = f[(f >= low) & (f <= high)]
    return f, case.true.model.frf(f)


def _known(model: Model) -> tuple[float, float]:
    """Return the lowest frequency above 0 and the highest one (Hz) at which a response is known."""
    f = getattr(model, "f_hz", None)  # of a measured response; a model of any other kind knows it everywhere
    return (0.0, np.inf) if f is None else (float(np.min(f[f > 0], initial=np.max(f))), float(np.max(f)))


def _errors(judgement: Judgement) -> tuple[float, float]:
    f, true = judgement.case.once(_true_response)
    low, high = _known(judgement.model)
    inside = (f >= low) & (f <= high)
    if inside.sum() < 2:
        raise NotApplicable(f"the response is known from {low:.3g} to {high:.3g} Hz, outside the band")
    return response_errors(f[inside], judgement.model.frf(f[inside]), true[inside])


def _error(which: int) -> Callable[[Judgement], float]:
    return lambda judgement: judgement.once(_errors)[which]


_COMMON: Mapping[str, Any] = {
    "tells": "Error of the frequency response over the band: in the mean square, and at the worst frequency.",
    "cannot_tell": "Anything outside the band, or where a measured response does not reach. Large responses govern H2, "
    "small ones the peak.",
    "needs": frozenset({Need.TRUTH, Need.INPUT}),
    "unit": "%",
    "scale": 100.0,
}

FRF_ERROR_H2 = Metric(
    "frf_error_h2",
    "relative H2-type error of the frequency response over the band",
    _error(0),
    header="FRF error H2",
    short="FRF H2 %",
    quartiles=True,
    compact=True,
    **_COMMON,
)

FRF_ERROR_PEAK = Metric(
    "frf_error_peak",
    "worst relative error of the frequency response over the band",
    _error(1),
    header="FRF error peak",
    **_COMMON,
)
