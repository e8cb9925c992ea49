"""Errors of the poles against the truth, in engineering terms."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.models.model import Model
from excite.models.modes import DELAY, continuous_poles
from identify.metrics.judgement import Judgement
from identify.metrics.metric import Metric, Need, NotApplicable


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


def matched(judgement: Judgement) -> PoleErrors:
    """Return the truth's poles matched with the model's, in the z-plane of whichever of the two is sampled."""
    truth, model = judgement.truth, judgement.dynamic
    dt = truth.model.dt or model.dt
    if dt is None:
        raise NotApplicable("neither the model nor the truth is sampled")
    return pole_errors(_sampled(np.asarray(truth.poles), truth.model, dt), _sampled(model.poles(), model, dt), dt)


def _sampled(poles: np.ndarray, model: Model, dt: float) -> np.ndarray:
    return poles if model.dt is not None else np.exp(poles * dt)


def _relative(judgement: Judgement) -> np.ndarray:
    """Return the relative error of every true pole, 1 for one that is missing."""
    errors = judgement.once(matched)
    relative = np.concatenate([errors.relative, np.ones(errors.missing)])
    if not len(relative):
        raise NotApplicable("the truth has no poles")
    return relative


def _distances(judgement: Judgement) -> np.ndarray:
    """Return the z-plane distances of the matched poles."""
    z = judgement.once(matched).z
    if not len(z):
        raise NotApplicable("no pole of the truth has a partner")
    return z


def _worst(of: str, kind: str) -> Callable[[Judgement], float]:
    """Return the computation of the largest of the errors `of`, which poles of one kind have."""

    def compute(judgement: Judgement) -> float:
        pairs = judgement.once(matched)
        errors = getattr(pairs, of)
        if np.isnan(errors).all():
            raise NotApplicable(f"{'no matched pole' if pairs.missing else 'no pole'} of the truth is {kind}")
        return float(np.nanmax(errors))

    return compute


_NEEDS = frozenset({Need.POLES, Need.TRUE_MODEL})
_RELATIVE: Mapping[str, Any] = {
    "tells": "Distance of the matched poles in the s-plane, relative to the true pole; a missing pole counts 100 %.",
    "cannot_tell": "Whether residues and zeros are right. With surplus poles the match is generous: the best are chosen.",
    "unit": "%",
    "scale": 100.0,
    "needs": _NEEDS,
}
_ENGINEERING: Mapping[str, Any] = {
    "tells": "In engineering terms: worst oscillatory pair, worst real pole, distance of integrators from s = 0.",
    "cannot_tell": "How much it matters: a heavily damped pole may be far off and hardly change the response.",
    "needs": _NEEDS,
}
_Z_PLANE: Mapping[str, Any] = {
    "tells": "Distance of the matched poles in the z-plane.",
    "cannot_tell": "Much on its own: with fast sampling all poles crowd at z = 1 and every distance looks small.",
    "unit": "–",
    "needs": _NEEDS,
}
_COUNTS: Mapping[str, Any] = {
    "tells": "Whether the order is below or above that of the truth.",
    "cannot_tell": "Whether the poles that are there are right.",
    "unit": "–",
    "needs": _NEEDS,
    "column": False,  # the notes of a row tell
}

POLE_ERROR_MAX = Metric(
    "pole_error_max",
    "relative s-plane distance of the worst matched pole (a missing pole counts 1)",
    lambda judgement: float(_relative(judgement).max()),
    header="pole error max",
    short="pole max %",
    quartiles=True,
    compact=True,
    **_RELATIVE,
)

POLE_ERROR_MEAN = Metric(
    "pole_error_mean",
    "mean relative s-plane distance of the matched poles (a missing pole counts 1)",
    lambda judgement: float(_relative(judgement).mean()),
    header="pole error mean",
    column=False,
    **_RELATIVE,
)

POLE_ERROR_FREQUENCY = Metric(
    "pole_error_frequency_percent",
    "worst natural-frequency error of the oscillatory poles, %",
    _worst("frequency_percent", "oscillatory"),
    header="frequency error",
    unit="%",
    short="freq %",
    compact=True,
    **_ENGINEERING,
)

POLE_ERROR_DAMPING = Metric(
    "pole_error_damping",
    "worst damping-ratio error of the oscillatory poles",
    _worst("damping", "oscillatory"),
    header="damping error",
    unit="–",
    short="damping",
    compact=True,
    **_ENGINEERING,
)

POLE_ERROR_TIME_CONSTANT = Metric(
    "pole_error_time_constant_percent",
    "worst time-constant error of the real poles, %",
    _worst("time_constant_percent", "real"),
    header="time-constant error",
    unit="%",
    **_ENGINEERING,
)

POLE_ERROR_INTEGRATOR = Metric(
    "pole_error_integrator_rad_s",
    "worst distance of the integrators from s = 0, rad/s",
    _worst("integrator_rad_s", "an integrator"),
    header="integrator error",
    unit="rad/s",
    **_ENGINEERING,
)

POLE_ERROR_Z_MAX = Metric(
    "pole_error_z_max",
    "worst |lambda - lambdahat|",
    lambda judgement: float(_distances(judgement).max()),
    header="|dλ| max",
    **_Z_PLANE,
)

POLE_ERROR_Z_MEAN = Metric(
    "pole_error_z_mean",
    "mean |lambda - lambdahat|",
    lambda judgement: float(_distances(judgement).mean()),
    header="|dλ| mean",
    column=False,
    **_Z_PLANE,
)

POLES_MISSING = Metric(
    "poles_missing",
    "true poles without a partner",
    lambda judgement: judgement.once(matched).missing,
    header="missing poles",
    **_COUNTS,
)

POLES_SURPLUS = Metric(
    "poles_surplus",
    "estimated poles without a partner",
    lambda judgement: judgement.once(matched).surplus,
    header="surplus poles",
    **_COUNTS,
)
