"""Metrics: fit and VAF on data, pole and frequency-response error against a known truth."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy.optimize import linear_sum_assignment

from excite.models.model import Model
from excite.models.modes import DELAY, continuous_poles


def fit_percent(y: np.ndarray, yhat: np.ndarray) -> np.ndarray:
    """Best-fit percentage of each output, unclipped: 100 (1 - ||y - yhat|| / ||y - mean y||), seed 003 eq. (40a).

    y, yhat (N, ny); a constant output gives NaN, a diverging model -inf.
    """
    return 100 * (1 - _ratio(la.norm(_finite(y - yhat), axis=0), la.norm(y - y.mean(0), axis=0)))


def vaf_percent(y: np.ndarray, yhat: np.ndarray) -> np.ndarray:
    """Variance accounted for by each output, unclipped: 100 (1 - var(y - yhat) / var y), seed 003 eq. (40b)."""
    return 100 * (1 - _ratio(np.var(_finite(y - yhat), axis=0), np.var(y, axis=0)))


def _finite(error: np.ndarray) -> np.ndarray:
    """Errors beyond 1e150 (a diverging model) become 1e150, so that norms stay computable."""
    return np.clip(np.nan_to_num(error, nan=1e150, posinf=1e150, neginf=-1e150), -1e150, 1e150)


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    return np.divide(numerator, denominator, out=np.full(len(denominator), np.nan), where=denominator > 0)


@dataclass(frozen=True, eq=False)
class PoleErrors:
    """Matched poles of truth and estimate and what separates them.

    true, estimated : matched z-plane poles (k,); kind : "integrator", "real" or "oscillatory" for each true pole;
    relative : |s - shat| / |s|, integrators relative to the slowest true pole that is none; z : |lambda - lambdahat|;
    frequency_percent, damping : of oscillatory poles; time_constant_percent : of real ones; integrator_rad_s : of
    integrators (NaN elsewhere); missing, surplus : poles without a partner.
    """

    true: np.ndarray
    estimated: np.ndarray
    kind: tuple[str, ...]
    relative: np.ndarray
    z: np.ndarray
    frequency_percent: np.ndarray
    damping: np.ndarray
    time_constant_percent: np.ndarray
    integrator_rad_s: np.ndarray
    missing: int
    surplus: int


TIE = 1e-6  # weight of squared distances in the matching: far above rounding, far below what matters
INTEGRATOR = 1e-6  # |s| dt below which a true pole counts as an integrator


def pole_errors(true: np.ndarray, estimated: np.ndarray, dt: float) -> PoleErrors:
    """Match z-plane poles by optimal assignment of |s - shat| in the s-plane and return the errors.

    Frequencies and dampings are judged in the s-plane because at small dt every |lambda - lambdahat| is small. Of
    assignments of equal sum, as of real poles that all lie on one side of the true ones, the one with the smaller sum of
    squares is taken: rounding must not decide which pole an error is charged to. Poles at the origin, which only delay, are
    left out.
    """
    true, estimated = (poles[np.abs(poles) > DELAY] for poles in map(np.asarray, (true, estimated)))
    s, s_hat = continuous_poles(true, dt), continuous_poles(estimated, dt)
    distance = np.abs(s[:, None] - s_hat[None, :])
    rows, columns = linear_sum_assignment(distance + TIE * distance**2 / max(distance.max(initial=0), 1e-300))
    s, s_hat = s[rows], s_hat[columns]
    integrator = np.abs(s) * dt < INTEGRATOR
    oscillatory = ~integrator & (np.abs(s.imag) > 1e-9 * np.abs(s))
    real = ~integrator & ~oscillatory
    slowest = np.min(np.abs(s[~integrator]), initial=np.inf)
    scale = np.where(integrator, slowest if np.isfinite(slowest) else 1.0, np.maximum(np.abs(s), INTEGRATOR / dt))
    wn, wn_hat = np.abs(s), np.abs(s_hat)
    nan = np.full(len(s), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = np.abs(s_hat.real / wn_hat - s.real / wn)
        time_constant = 100 * np.abs(s.real / s_hat.real - 1)
        frequency = 100 * np.abs(wn_hat / wn - 1)
    return PoleErrors(
        true[rows],
        estimated[columns],
        tuple(
            "integrator" if i else "oscillatory" if o else "real" for i, o in zip(integrator, oscillatory, strict=True)
        ),
        np.abs(s - s_hat) / scale,
        np.abs(true[rows] - estimated[columns]),
        np.where(oscillatory, frequency, nan),
        np.where(oscillatory, damping, nan),
        np.where(real, time_constant, nan),
        np.where(integrator, wn_hat, nan),
        max(0, len(true) - len(estimated)),
        max(0, len(estimated) - len(true)),
    )


def frf_errors(model: Model, truth: Model, band_hz: tuple[float, float], points: int = 400) -> tuple[float, float]:
    """Return (relative H2-type, relative peak) error of the frequency response over a band.

    H2-type: sqrt(int |Ghat - G|_F^2 df / int |G|_F^2 df); peak: max over f of |Ghat - G|_2 / |G|_2 (spectral norms).
    """
    f = np.geomspace(*band_hz, points)
    G = truth.frf(f)
    error = model.frf(f) - G
    power = [np.trapezoid((np.abs(m) ** 2).sum((1, 2)), f) for m in (error, G)]
    peak = np.linalg.norm(error, 2, axis=(1, 2)) / np.linalg.norm(G, 2, axis=(1, 2))
    return float(np.sqrt(power[0] / power[1])), float(peak.max())


def default_band(poles: np.ndarray, dt: float) -> tuple[float, float]:
    """Band for frf_errors when none is given: from a third of the slowest pole (not an integrator) to 0.4 of the rate."""
    s = np.abs(continuous_poles(poles, dt)) / (2 * np.pi)
    s = s[s * dt > INTEGRATOR]
    high = 0.4 / dt
    return min(s.min(initial=high) / 3, high / 10), high


def impulse_error(model: Model, truth: Model, count: int = 200) -> float:
    """Relative 2-norm error of the first `count` Markov parameters, e_h of seed 003 eq. (40d)."""
    h = truth.impulse(count)
    return float(np.linalg.norm(model.impulse(count) - h) / np.linalg.norm(h))
