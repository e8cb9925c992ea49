"""What a model can do is its type: Model < Dynamic < Predictor, and Parametric beside them."""

from abc import ABC, abstractmethod
from typing import Any, Protocol, Self

import numpy as np

from excite.types.channel import Channel
from excite.types.frozen import ReadOnlyArrays


class Record(Protocol):
    """What a model needs of a record: an Experiment, or anything with inputs u (N, nu) and outputs y (N, ny)."""

    u: np.ndarray
    y: np.ndarray


class Model(ReadOnlyArrays, ABC):
    """Whatever an estimate or a truth may be: it has inputs, outputs and a frequency response.

    dt : sampling time in s, None in continuous time.
    """

    dt: float | None
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    @abstractmethod
    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu), complex, at f_hz (F,)."""


class Dynamic(Model):
    """A model with poles that can be simulated."""

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


class Predictor(Dynamic):
    """A model of the noise too, which predicts the next outputs from the measured ones.

    innovation_cov : (ny, ny), or None where it is not known.
    """

    innovation_cov: np.ndarray | None

    @abstractmethod
    def predict(self, experiment: Record, horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny)."""


class Parametric(Dynamic):
    """A model with a vector of parameters, of which it is a smooth function."""

    @abstractmethod
    def theta(self) -> np.ndarray:
        """Parameters (p,)."""

    @abstractmethod
    def at(self, theta: np.ndarray) -> Self:
        """The model of the same structure with other parameters."""
