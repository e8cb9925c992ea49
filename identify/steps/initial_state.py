"""Initial state of a given model on a record."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.models.model import Dynamic, Predictor
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import observability
from excite.types.experiment import Experiment

LONGEST = 20_000  # samples that the response to x0 is looked for in
HEAD_VALUES = 10_000_000  # doubles that this response would fill, 80 MB
LEAF = 32  # samples of the response that are decomposed at once
HIDDEN = 1e-10  # singular values of the response, relative to the largest, below which y does not show a state


def initial_state(model: Dynamic, experiment: Experiment, predictor: bool) -> np.ndarray:
    """Return the x0 (n,) that makes the model's simulation (or one-step prediction) fit the record best.

    Least squares on y - yhat(x0 = 0) = C A^t x0, with A - K C for the predictor; minimum norm where y does not show a
    state. The response to x0 is used for as long as it neither dies out nor explodes.
    """
    if predictor and isinstance(model, PolynomialModel) and model.is_arx:
        return _of_arx(model, experiment)
    if model.dt is None and experiment.dt is None:
        return _of_instants(model, experiment)
    to_space: Callable[..., StateSpaceModel] = model.to_state_space  # takes a sampling time in continuous time
    space = to_space() if model.dt is not None else to_space(experiment.dt)
    A = space.predictor()[0] if predictor else space.A
    radius = np.abs(la.eigvals(A) if predictor else space.poles()).max(initial=0.0)
    head = experiment.window(0, _seen(radius, space.C))
    residual = model.innovations(head) if predictor and isinstance(model, Predictor) else head.y - model.response(head)
    length = int(np.argmin(np.isfinite(residual).all(1))) or len(residual)
    return free_response_fit(A, space.C, residual[:length])


def _seen(radius: float, C: np.ndarray) -> int:
    """Return the samples that the response to x0 is looked for in: until e^-20 (or e^20), but five equations a state."""
    fading = abs(np.log(max(radius, 1e-8)))
    fewest = 5 * -(-C.shape[1] // len(C))
    most = max(fewest, min(LONGEST, HEAD_VALUES // max(1, C.size)))
    return int(np.clip(20 / max(fading, 1e-12), fewest, most))


def _of_arx(model: PolynomialModel, experiment: Experiment) -> np.ndarray:
    """The state of an ARX model adds to the right side of the first `lags` samples alone: it takes their residuals away."""
    x0 = np.zeros((model.lags, len(model.outputs)))
    head = experiment.window(0, max(model.lags, 1))
    x0[: len(head)] = model.innovations(head)[: model.lags]
    return x0.ravel()


def _of_instants(model: Any, experiment: Experiment) -> np.ndarray:
    """Fit the responses to each state at instants that are not uniform, which no powers of one matrix give."""
    rest = np.broadcast_to(model.input_offset, experiment.u.shape)
    free = [model.simulate(rest, each, time_s=experiment.time_s) - model.output_offset for each in np.eye(model.order)]
    residual = experiment.y - model.response(experiment)
    return la.lstsq(np.reshape(free, (model.order, -1)).T, residual.ravel(), cond=HIDDEN)[0]


def free_response_fit(A: np.ndarray, C: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the x (n,) of least norm that minimises sum_t |y(t) - C A^t x|^2, y (T, ny).

    The matrix with rows C A^t is never built: the orthogonal factor of LEAF samples serves all of them, that of two
    neighbouring stretches, [R; R A^L] = Q R', all pairs of them, and so on by doubling. Each step is orthogonal, so that
    the result is as exact as least squares on the whole matrix, and it costs about one product of y with a leaf's factor.
    """
    (ny, n), T = C.shape, len(y)
    if n == 0:
        return np.zeros(0)
    length = max(LEAF, -(-n // ny))
    leaf = observability(A, C, min(length, T)).reshape(-1, n)
    count, rest = divmod(T, length)
    if count < 2:
        return la.lstsq(observability(A, C, T).reshape(-1, n), y.ravel(), cond=HIDDEN, check_finite=False)[0]
    power = np.linalg.matrix_power(A, length)
    rows, values = [leaf[: rest * ny] @ np.linalg.matrix_power(power, count)], [y[count * length :].ravel()]
    Q, R = la.qr(leaf, mode="economic", check_finite=False)
    z = y[: count * length].reshape(count, -1) @ Q
    while count > 1:
        if count % 2:  # a stretch without a neighbour waits for the end
            rows.append(R @ np.linalg.matrix_power(power, count - 1))
            values.append(z[-1])
        count //= 2
        Q, R = la.qr(np.vstack([R, R @ power]), mode="economic", check_finite=False)
        z = z[: 2 * count].reshape(count, -1) @ Q
        power = power @ power
    return la.lstsq(np.vstack([R, *rows]), np.concatenate([z[0], *values]), cond=HIDDEN, check_finite=False)[0]
