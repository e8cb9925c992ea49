"""Initial state of a given model on a record."""

import numpy as np
import scipy.linalg as la

from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import observability
from excite.types.experiment import Experiment

LONGEST = 20_000  # samples that the response to x0 is looked for in
HEAD_VALUES = 10_000_000  # doubles of that response, 80 MB


def initial_state(model: StateSpaceModel, experiment: Experiment, predictor: bool) -> np.ndarray:
    """Return the x0 (n,) that makes the model's simulation (or one-step prediction) fit the record best.

    Least squares on y - yhat(x0 = 0) = C A^t x0, with A - K C for the predictor; minimum norm where y does not show a
    state. The response to x0 is used for as long as it neither dies out nor explodes.
    """
    A = model.predictor()[0] if predictor else model.A
    radius = np.abs(la.eigvals(A)).max(initial=0.0)
    fading = abs(np.log(max(radius, 1e-8)))
    fewest = 5 * -(-model.order // len(model.C))  # five equations a state
    most = max(fewest, min(LONGEST, HEAD_VALUES // max(1, model.C.size)))
    head = experiment.window(0, int(np.clip(20 / max(fading, 1e-12), fewest, most)))
    residual = head.y - (model.predict(head) if predictor else model.simulate(head.u))
    length = int(np.argmin(np.isfinite(residual).all(1))) or len(residual)
    response = observability(A, model.C, length).reshape(-1, model.order)
    return la.lstsq(response, residual[:length].ravel(), cond=1e-10, check_finite=False)[0]
