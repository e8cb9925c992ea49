"""What the output-only methods have in common: data without inputs, and a model of noise alone."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from excite.types.experiment import Experiment
from identify.estimate import Estimate
from identify.method import Data, Method, experiments
from identify.steps.initial_state import initial_state
from identify.steps.kalman import spectral_radius


@dataclass(frozen=True)
class OutputOnlyMethod(Method):
    """A method for outputs alone, whose excitation is white noise that nobody measured.

    Past and future should each span half a period of the slowest mode (Reynders and De Roeck 2008).
    """

    closed_loop: ClassVar[bool] = False
    consumes: ClassVar[str] = "outputs"
    asymptotic: ClassVar[bool] = True

    block_rows: int = field(
        default=20,
        metadata={"meaning": "r, rows of past and of future each; at least half a period of the slowest mode"},
    )

    def unsupported(self, data: Data) -> str | None:
        """Return why these data do not suit: sampling, missing samples, or inputs."""
        data = experiments(data)
        if data[0].inputs:
            return (
                f"the data have inputs ('{data[0].inputs[0].name}'), whose effect an output-only method takes for noise; name "
                "no input, or use a method for inputs and outputs"
            )
        return super().unsupported(data)

    def span(self, order: int) -> int:
        """2 r + 1, past and future and the shift."""
        return 2 * self.block_rows + 1

    def required_excitation(self, order: int) -> int:
        """None: no input is needed."""
        return 0

    def sufficient_excitation(self, order: int) -> int:
        """None: no input is needed."""
        return 0

    def largest_order(self, data: Data) -> int:
        """(r - 1) ny: one block row is lost to the shift."""
        return (self.block_rows - 1) * len(experiments(data)[0].outputs)


def noise_model(
    first: Experiment, A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray
) -> tuple[StateSpaceModel, tuple[str, ...]]:
    """Return x+ = A x + K e, y = C x + e with the steady Kalman gain of the noise, and warnings.

    Without a positive definite innovation covariance and a stable A - K C (then the covariances of the estimate are
    those of no process: they are not positive real) the model has no K.
    """
    channels = {"inputs": (), "outputs": first.outputs}
    empty = np.empty((len(A), 0)), np.empty((len(C), 0))
    try:
        K, cov = kalman_gain(A, C, Q, R, S)
        if spectral_radius(A - K @ C) >= 1 or la.eigvalsh(cov)[0] <= 0:
            raise ExciteError("the innovations' covariance is not positive definite")
    except (ExciteError, la.LinAlgError) as error:
        model = StateSpaceModel(A, empty[0], C, empty[1], first.dt, **channels)
        return model, (
            f"no Kalman gain: the estimated output covariances are not positive real ({error}); A and C stand",
        )
    return StateSpaceModel(A, empty[0], C, empty[1], first.dt, K=K, innovation_cov=cov, **channels), ()


def output_only_estimate(
    name: str,
    model: StateSpaceModel,
    data: tuple[Experiment, ...],
    values: np.ndarray,
    warnings: tuple[str, ...],
    *,
    path: str,
    condition: float | None = None,
) -> Estimate:
    """Return the estimate with the initial state of each record."""
    x0 = tuple(initial_state(model, e, predictor=model.K is not None) for e in data)
    return Estimate(
        model, name, model.order, x0=x0, singular_values=values, warnings=warnings, condition=condition, path=path
    )
