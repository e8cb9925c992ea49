"""What a model can do is its type: Model < Dynamic < Predictor, and Parametric beside them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from excite.errors import ExciteError
from excite.models.arrays import read_only
from excite.types.channel import Channels
from excite.types.checked import OptionalArray
from excite.types.frozen import ReadOnlyArrays


class Record(Protocol):
    """What a model needs of a record: an Experiment, or anything with inputs u (N, nu), outputs y (N, ny), time_s (N,)."""

    @property
    def u(self) -> np.ndarray:
        """Inputs (N, nu)."""

    @property
    def y(self) -> np.ndarray:
        """Outputs (N, ny)."""

    @property
    def time_s(self) -> np.ndarray:
        """Instants (N,), s."""


class Model(ReadOnlyArrays, ABC):
    """Whatever an estimate or a truth may be: it has inputs, outputs and a frequency response.

    dt : sampling time in s, None in continuous time.
    """

    inputs: Channels
    outputs: Channels

    if TYPE_CHECKING:  # a field or a property of each model

        @property
        def dt(self) -> float | None:
            """Sampling time in s, None in continuous time."""

    @abstractmethod
    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu), complex, at f_hz (F,)."""

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Take over a pickled or copied state, its arrays read-only as they were."""
        for value in state.values():
            if isinstance(value, np.ndarray):
                read_only(value)
        self.__dict__.update(state)


class Dynamic(Model):
    """A model with poles that can be simulated.

    In continuous time, `simulate` takes the instants (time_s=) and `impulse` and `to_state_space` a sampling time (dt=).
    """

    @abstractmethod
    def poles(self) -> np.ndarray:
        """Poles: z-plane where dt is a number, else s-plane in rad/s."""

    @abstractmethod
    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters h_0, h_1, … as (count, ny, nu)."""

    @abstractmethod
    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from the state x0."""

    @abstractmethod
    def to_state_space(self) -> Any:  # a StateSpaceModel, which is one of these itself
        """The same model as a StateSpaceModel, exact."""

    def response(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to the inputs of a record, at its instants, from the state x0."""
        return self.simulate(record.u, x0)


class Predictor(Dynamic):
    """A model of the noise too, y = G u + H e, which predicts the next outputs from the measured ones.

    innovation_cov : covariance of e (ny, ny), or None where it is not known.
    """

    innovation_cov: OptionalArray

    @property
    def predicts(self) -> bool:
        """Whether the noise is described, so that the model can predict."""
        return True

    @abstractmethod
    def innovations(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Return the one-step prediction errors e = y - yhat(t | t - 1) as (N, ny), from the state x0 at the first sample."""

    @abstractmethod
    def noise_impulse(self, count: int) -> np.ndarray:
        """Impulse response I, H_1, … of the noise model H as (count, ny, ny)."""

    @abstractmethod
    def noise_frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, ny) of the noise model H, complex, at f_hz (F,)."""

    @abstractmethod
    def predictions(
        self, record: Record, horizons: Sequence[int], x0: np.ndarray | None = None
    ) -> tuple[np.ndarray, ...]:
        """Return yhat(t | t - h) as (N, ny) for each h of `horizons`, which share the work of the first step."""

    def predict(self, record: Record, horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny), from the state x0 at the first sample.

        The first horizon - 1 samples are simulated from x0. Raises ExciteError for a horizon below one sample.
        """
        return self.predictions(record, (horizon,), x0)[0]


def check_horizons(horizons: Sequence[int]) -> None:
    """Refuse prediction horizons below one sample."""
    for horizon in horizons:
        if horizon < 1:
            raise ExciteError(f"predict: horizon {horizon}; it must be at least 1 sample")


class Parametric(Dynamic):
    """A model with a vector of parameters, of which it is a smooth function."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Number of states of `to_state_space`, entries of x0."""

    @abstractmethod
    def theta(self) -> np.ndarray:
        """Parameters (p,)."""

    @abstractmethod
    def at(self, theta: np.ndarray) -> Self:
        """Return the model of the same structure with other parameters."""
