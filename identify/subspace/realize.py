"""From A, C and K to an Estimate: the last step that the subspace methods share."""

import numpy as np

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from identify.estimate import Estimate, Status
from identify.steps.compression import PastFuture
from identify.steps.initial_state import initial_state
from identify.steps.input_matrices import input_matrices
from identify.steps.kalman import spectral_radius


def complete(
    name: str,
    data: PastFuture,
    A: np.ndarray,
    C: np.ndarray,
    K: np.ndarray,
    E: np.ndarray,
    *,
    feedthrough: bool,
    predictor: bool,
    singular_values: np.ndarray,
    warnings: tuple[str, ...] = (),
    fitted: tuple[np.ndarray, np.ndarray] | None = None,
) -> Estimate:
    """Return the estimate with B, D and x0 fitted on all samples (B and D unless the method has `fitted` them itself).

    predictor : fit them through the one-step predictor (A - K C); else by simulation, which only open-loop data and a
    stable A allow. E (ny, …) : compressed innovation rows, whose covariance guards K.
    """
    warnings = list(warnings)
    noisy = np.any(K)
    radius = spectral_radius(A - K @ C)
    if noisy and radius >= 1:
        cov = E @ E.T / data.factor.columns
        K, _ = kalman_gain(A, C, K @ cov @ K.T, cov, K @ cov)
        warnings.append(
            f"the estimated predictor A - KC was unstable (spectral radius {radius:.4f}); replaced by the stabilising "
            f"Kalman gain of the same spectrum (now {spectral_radius(A - K @ C):.4f})"
        )
    if not predictor and spectral_radius(A) >= 1:
        predictor = True
        warnings.append("A is not stable, so B, D and x0 were fitted through the one-step predictor, not by simulation")
    first = data.experiments[0]
    noise = {"K": K, "innovation_cov": E @ E.T / data.factor.columns}
    channels = {"inputs": first.inputs, "outputs": first.outputs}
    if fitted is None:
        gain = K if predictor else np.zeros_like(K)
        found = input_matrices(data.experiments, A, C, gain, feedthrough, data.circular)
        if not all(np.isfinite(m).all() for m in (found.B, found.D)):
            raise ExciteError(
                f"{name}: the fit of B and D overflowed (A has radius {spectral_radius(A):.3f}); lower the order"
            )
        model = StateSpaceModel(A, found.B, C, found.D, first.dt, **noise, **channels)
        x0 = found.x0
    else:
        model = StateSpaceModel(A, fitted[0], C, fitted[1], first.dt, **noise, **channels)
        x0 = tuple(initial_state(model, e, predictor) for e in data.experiments)
    return Estimate(
        model,
        name,
        len(A),
        x0=x0,
        singular_values=singular_values,
        status=Status.SUSPECT if warnings and noisy and radius >= 1 else Status.OK,
        warnings=tuple(warnings),
        condition=data.factor.condition,
        path=data.factor.path,
    )
