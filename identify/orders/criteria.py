"""Information criteria of one model on the data it was estimated from."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from excite.models.model import Dynamic, Model, Predictor
from excite.models.polynomial import PolynomialModel
from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.steps.initial_state import initial_state
from identify.steps.kalman import NOISE_FREE


@dataclass(frozen=True)
class Criteria:
    """Information criteria of one model: smaller is better; they compare models of the same data.

    With S the covariance of the one-step residuals over N samples of ny outputs and p parameters,

        aic = N log det S + 2 p  (Akaike 1974),    aicc = N log det S + 2 p N / (N - p / ny - 1)  (Hurvich and Tsai 1993),
        bic = N log det S + p log N  (Schwarz 1978; Rissanen's MDL is half of it).

    All are inf where the residuals overflow, and aicc where there are too few samples for it.
    """

    aic: float
    aicc: float
    bic: float
    parameters: int


def free_parameters(model: Dynamic) -> int:
    """Parameters that the data determine, whatever the basis of the state.

    n (nu + 2 ny) of the innovation form, and ny nu of D where it is not zero; the coefficients of a polynomial model.
    """
    ny, nu = len(model.outputs), len(model.inputs)
    if isinstance(model, PolynomialModel):
        return model.a[1:].size + int((model.b != 0).any(axis=(1, 2)).sum()) * ny * nu
    space = model.to_state_space()
    return space.order * (nu + 2 * ny) + (ny * nu if np.any(space.D) else 0)


def information_criteria(model: Model, data: Experiment | Iterable[Experiment] | Records) -> Criteria | None:
    """Return the criteria of a model on the data it was estimated from (gaps left out), None without a noise model.

    Residuals at rounding level count as equal, so that of noise-free models the smallest exact one is best.
    """
    if not isinstance(model, Predictor) or (system := model.to_state_space()).K is None:
        return None
    count, parts, ny = free_parameters(model), Records.of(data).parts(1), len(model.outputs)
    with np.errstate(over="ignore", invalid="ignore"):
        residual = np.concatenate([p.y - model.predict(p, x0=initial_state(system, p, predictor=True)) for p in parts])
    if not np.isfinite(residual).all():
        return Criteria(np.inf, np.inf, np.inf, count)
    N = len(residual)
    floor = NOISE_FREE * np.linalg.norm(np.concatenate([p.y for p in parts]), axis=0)
    fit = N * np.linalg.slogdet((residual.T @ residual + np.diag(floor**2)) / N)[1]
    left = N - count / ny - 1
    return Criteria(fit + 2 * count, fit + 2 * count * N / left if left > 0 else np.inf, fit + count * np.log(N), count)
