"""Foster models: sums of first-order lags in continuous time, the language of thermal impedances."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from excite.errors import ExciteError
from excite.models.arrays import finite, input_samples, offset, read_only
from excite.models.continuous import instants, sampling_time
from excite.models.model import Parametric, Record
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import recurrence
from excite.types.channel import Channels, channels_for
from excite.types.checked import NOT_GIVEN, ArrayByDefault


@dataclass(frozen=True, eq=False)
class FosterModel(Parametric):
    """Sum of first-order lags in continuous time, step response sum_i R_i (1 - exp(-t / tau_i)).

    y(t) - y0 = sum_i R_i x_i(t), tau_i dx_i/dt = -x_i + u - u0, where x_i (nu,) follows each input with the lag tau_i.
    In thermal work u is heat flow in W, y temperature rise in K, R_i are resistances in K/W and tau_i / R_i capacitances
    (Foster network; JEDEC JESD51-14, 2010).

    Parameters
    ----------
    R : (n, ny, nu), or (n, ny) for one input
    tau : time constants (n,), s, positive
    input_offset, output_offset : operating point u0 (nu,), y0 (ny,)

    It has no sampling time: `simulate` takes any instants, between which the input is held; `impulse` and
    `to_state_space` take the sampling time that they need, and raise ExciteError without one. The state x0 holds x_i at the
    first instant, (n nu,), lag by lag.

    >>> model = FosterModel([[2.0], [1.0]], [1e-3, 10.0])
    >>> model.step([0.0, 0.01, 1e3]).ravel().round(3)
    array([0.   , 2.001, 3.   ])
    """

    R: np.ndarray
    tau: np.ndarray
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    input_offset: ArrayByDefault = NOT_GIVEN
    output_offset: ArrayByDefault = NOT_GIVEN

    def __post_init__(self) -> None:
        tau = finite(self.tau, (None,), "FosterModel.tau")
        if not (tau > 0).all():
            raise ExciteError(f"FosterModel.tau: {tau[tau <= 0][0]:g} s; time constants are positive")
        R = np.asarray(self.R)
        R = finite(R[..., None] if R.ndim == 2 else R, (len(tau), None, None), "FosterModel.R")
        if 0 in R.shape:
            raise ExciteError(f"FosterModel.R: shape {R.shape}; expected (lags, outputs, inputs), one of each or more")
        _, ny, nu = R.shape
        object.__setattr__(self, "tau", tau)
        object.__setattr__(self, "R", R)
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))
        object.__setattr__(self, "input_offset", offset(self.input_offset, nu, "FosterModel.input_offset"))
        object.__setattr__(self, "output_offset", offset(self.output_offset, ny, "FosterModel.output_offset"))

    @property
    def dt(self) -> None:
        """None: the model is in continuous time."""
        return None

    @property
    def order(self) -> int:
        """Number of states of `to_state_space`: one per lag and input."""
        return len(self.tau) * len(self.inputs)

    def poles(self) -> np.ndarray:
        """Poles -1 / tau, rad/s."""
        return (-1 / self.tau).astype(complex)

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response sum_i R_i / (1 + j 2 pi f tau_i) as (F, ny, nu) complex."""
        return np.tensordot(1 / (1 + 2j * np.pi * np.outer(f_hz, self.tau)), self.R, 1)

    def step(self, time_s: np.ndarray) -> np.ndarray:
        """Response (T, ny, nu) at time_s (T,) to a unit step of each input at 0 s."""
        return np.tensordot(-np.expm1(-np.maximum(np.outer(time_s, 1 / self.tau), 0.0)), self.R, 1)

    def impulse(self, count: int, dt: float | None = None) -> np.ndarray:
        """Markov parameters (count, ny, nu) of the model sampled at dt s: 0, then the differences of the step response."""
        steps = self.step(np.arange(count) * sampling_time(dt, "FosterModel.impulse"))
        return np.diff(steps, axis=0, prepend=steps[:1])

    def states(self, u: np.ndarray, time_s: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Return the lags x_i (N, n, nu) at time_s for u (N, nu), each held from its instant to the next, from x0."""
        decay = np.exp(-np.diff(time_s)[:, None, None] / self.tau[:, None])
        drive = -np.expm1(-np.diff(time_s)[:, None, None] / self.tau[:, None]) * (u[:-1, None, :] - self.input_offset)
        start = np.zeros(self.order) if x0 is None else finite(x0, (self.order,), "FosterModel: x0")
        return recurrence(decay, drive, start.reshape(len(self.tau), -1))

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None, *, time_s: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu), each held from its instant in time_s (N,) to the next, from x0."""
        u = input_samples(u, len(self.inputs), "FosterModel.simulate")
        x = self.states(u, instants(time_s, len(u), "FosterModel"), x0)
        return np.tensordot(x, self.R, ([1, 2], [0, 2])) + self.output_offset

    def response(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to the inputs of a record, at its instants, from the state x0."""
        return self.simulate(record.u, x0, time_s=record.time_s)

    def to_state_space(self, dt: float | None = None) -> StateSpaceModel:
        """Return the model sampled at dt s, exact for an input held between samples: n nu states."""
        dt = sampling_time(dt, "FosterModel.to_state_space")
        _, ny, nu = self.R.shape
        A = np.diag(np.repeat(np.exp(-dt / self.tau), nu))
        B = np.kron(-np.expm1(-dt / self.tau)[:, None], np.eye(nu))
        C = self.R.transpose(1, 0, 2).reshape(ny, self.order)
        offsets = self.input_offset, self.output_offset
        return StateSpaceModel(A, B, C, np.zeros((ny, nu)), dt, None, None, self.inputs, self.outputs, *offsets)

    def theta(self) -> np.ndarray:
        """Return R, row by row, and the natural logarithms of tau: any theta is a model, and scales do not matter."""
        return np.concatenate([self.R.ravel(), np.log(self.tau)])

    def at(self, theta: np.ndarray) -> Self:
        """Return the model with other R and tau."""
        theta = finite(theta, (self.R.size + len(self.tau),), "FosterModel.at: theta")
        R, tau = theta[: self.R.size].reshape(self.R.shape), np.exp(theta[self.R.size :])
        return replace(self, R=R, tau=read_only(tau))
