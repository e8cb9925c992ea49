"""Finite impulse responses."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from excite.errors import ExciteError
from excite.models.arrays import covariance, finite, input_samples, offset
from excite.models.model import Parametric
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import fir
from excite.types.channel import Channels, channels_for, positive
from excite.types.checked import NOT_GIVEN, ArrayByDefault, OptionalArray


@dataclass(frozen=True, eq=False)
class FirModel(Parametric):
    """Finite impulse response y(t) - y0 = sum_k h_k (u(t - k) - u0), k = 0 … count - 1.

    Parameters
    ----------
    h : Markov parameters (count, ny, nu), from lag 0
    dt : sampling time, s
    covariance : of the taps, (p, p) in the order of `theta`, or None where it is not known
    input_offset, output_offset : operating point u0 (nu,), y0 (ny,)

    The state x0 of `simulate` is that of `to_state_space`: the inputs before the first sample (as deviations from u0),
    u(-1), u(-2), …, u(1 - count), one after the other.

    >>> FirModel([[[0.0]], [[1.0]], [[0.5]]], dt=0.1).simulate([[1.0], [0.0], [0.0]]).ravel()
    array([0. , 1. , 0.5])
    """

    h: np.ndarray
    dt: float
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    covariance: OptionalArray = NOT_GIVEN
    input_offset: ArrayByDefault = NOT_GIVEN
    output_offset: ArrayByDefault = NOT_GIVEN

    def __post_init__(self) -> None:
        h = finite(self.h, (None, None, None), "FirModel.h")
        if 0 in h.shape[:2]:
            raise ExciteError(f"FirModel.h: shape {h.shape}; expected (taps, outputs, inputs), one tap or more")
        _, ny, nu = h.shape
        object.__setattr__(self, "h", h)
        object.__setattr__(self, "dt", positive(self.dt, "FirModel.dt"))
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))
        object.__setattr__(self, "covariance", covariance(self.covariance, h.size, "FirModel.covariance"))
        object.__setattr__(self, "input_offset", offset(self.input_offset, nu, "FirModel.input_offset"))
        object.__setattr__(self, "output_offset", offset(self.output_offset, ny, "FirModel.output_offset"))

    @property
    def order(self) -> int:
        """Number of states of `to_state_space`."""
        return (len(self.h) - 1) * len(self.inputs)

    def poles(self) -> np.ndarray:
        """Poles at the origin of the z-plane, one per state."""
        return np.zeros(self.order, complex)

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response sum_k h_k exp(-j 2 pi f dt k) as (F, ny, nu) complex."""
        turns = -2j * np.pi * self.dt * np.outer(np.atleast_1d(f_hz), np.arange(len(self.h)))
        return np.tensordot(np.exp(turns), self.h, 1)

    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters (count, ny, nu): the taps, and zeros after them."""
        h = np.zeros((count, *self.h.shape[1:]))
        h[: len(self.h)] = self.h[:count]
        return h

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) after the inputs x0."""
        u, before = input_samples(u, len(self.inputs), "FirModel.simulate") - self.input_offset, len(self.h) - 1
        if x0 is None:
            return fir(self.h, u) + self.output_offset
        past = finite(x0, (self.order,), "FirModel: x0").reshape(before, len(self.inputs))[::-1]
        return fir(self.h, np.concatenate([past, u]))[before:] + self.output_offset

    def to_state_space(self) -> StateSpaceModel:
        """Return the shift register of past inputs, (count - 1) nu states, exact."""
        (_, ny, nu), n = self.h.shape, self.order
        C = self.h[1:].transpose(1, 0, 2).reshape(ny, n)
        A, B, offsets = np.eye(n, k=-nu), np.eye(n, nu), (self.input_offset, self.output_offset)
        return StateSpaceModel(A, B, C, self.h[0], self.dt, None, None, self.inputs, self.outputs, *offsets)

    def theta(self) -> np.ndarray:
        """Return the taps h (p,), lag by lag, each row by row."""
        return self.h.ravel()

    def at(self, theta: np.ndarray) -> Self:
        """Return the model with other taps; their covariance stays what it is."""
        return replace(self, h=finite(theta, (self.h.size,), "FirModel.at: theta").reshape(self.h.shape))
