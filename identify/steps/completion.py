"""From A and C to an Estimate: the one last step of all state-space methods."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from excite.types.experiment import Experiment
from identify.estimate import Estimate, Status
from identify.steps.initial_state import initial_state
from identify.steps.input_matrices import input_matrices
from identify.steps.kalman import spectral_radius
from identify.uncertainty.uncertainty import Uncertainty

X0 = tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise part of a model: gain K (n, ny) and innovation covariance (ny, ny)."""

    K: np.ndarray
    cov: np.ndarray


@dataclass(frozen=True, eq=False)
class Inputs:
    """The input part of a model: B (n, nu), D (ny, nu), and the initial state of each record where it came with them."""

    B: np.ndarray
    D: np.ndarray
    x0: X0 | None = None


def complete(
    name: str,
    parts: tuple[Experiment, ...],
    A: np.ndarray,
    C: np.ndarray,
    *,
    noise: Noise | None = None,
    inputs: Inputs | None = None,
    feedthrough: bool = False,
    predictor: bool = False,
    circular: np.ndarray | None = None,
    uncertainty: Callable[[StateSpaceModel, X0], Uncertainty] | None = None,
    warnings: tuple[str, ...] = (),
    **found: Any,
) -> Estimate:
    """Return the estimate of a method that has found A (n, n) and C (ny, n) on gap-free parts of the records.

    Parameters
    ----------
    noise : K and innovation covariance; K is replaced where A - K C is unstable. None: the model has no noise part.
    inputs : B and D; None: they and x0 are fitted to all samples, with `feedthrough` D as well.
    predictor : fit B, D and x0 through the one-step predictor, the only consistent way where the loop is closed; else
        by simulation, which only open-loop data and a stable A allow.
    circular : circular correlation of [u, y], where it is known.
    uncertainty : made from the model and the initial states.
    found : fields of the Estimate that the method knows: singular_values, condition, route, status.
    """
    notes, status = list(warnings), found.pop("status", Status.OK)
    if noise is not None and np.any(noise.K) and (radius := spectral_radius(A - noise.K @ C)) >= 1:
        noise, status = _stabilised(A, C, noise), Status.SUSPECT
        notes.append(
            f"the estimated predictor A - KC was unstable (spectral radius {radius:.4f}); replaced by the stabilising "
            f"Kalman gain of the same spectrum (now {spectral_radius(A - noise.K @ C):.4f})"
        )
    if noise is not None and not predictor and spectral_radius(A) >= 1:
        predictor = True
        notes.append("A is not stable, so B, D and x0 were fitted through the one-step predictor, not by simulation")
    if inputs is None:
        gain = noise.K if predictor and noise is not None else np.zeros(C.T.shape)
        fitted = input_matrices(parts, A, C, gain, feedthrough, circular)
        if not all(np.isfinite(m).all() for m in (fitted.B, fitted.D)):
            raise ExciteError(
                f"{name}: the fit of B and D overflowed (A has radius {spectral_radius(A):.3f}); lower the order"
            )
        inputs = Inputs(fitted.B, fitted.D, fitted.x0)
    first = parts[0]
    model = StateSpaceModel(
        A,
        inputs.B,
        C,
        inputs.D,
        first.uniform_dt,
        K=None if noise is None else noise.K,
        innovation_cov=None if noise is None else noise.cov,
        inputs=first.inputs if inputs.B.shape[1] else (),
        outputs=first.outputs,
    )
    x0 = inputs.x0 or tuple(initial_state(model, part, predictor) for part in parts)
    known = None if uncertainty is None else uncertainty(model, x0)
    return Estimate(model, name, len(A), x0=x0, uncertainty=known, status=status, warnings=tuple(notes), **found)


def _stabilised(A: np.ndarray, C: np.ndarray, noise: Noise) -> Noise:
    """Return the stabilising Kalman gain of noise with the same spectrum; the covariance stays that of the residuals."""
    K, _ = kalman_gain(A, C, noise.K @ noise.cov @ noise.K.T, noise.cov, noise.K @ noise.cov)
    return replace(noise, K=K)
