"""Polynomial models."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Predictor, Record
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel, channels_for, positive


@dataclass(frozen=True, eq=False)
class PolynomialModel(Predictor):
    """Matrix-fraction ARX model A(q) y = B(q) u + e with A_0 = I.

    y(t) + A_1 y(t-1) + … = B_0 u(t) + B_1 u(t-1) + … + e(t); a (na+1, ny, ny), b (nb+1, ny, nu), dt in s,
    innovation_cov (ny, ny) or None.
    """

    a: np.ndarray
    b: np.ndarray
    dt: float
    innovation_cov: np.ndarray | None = None
    inputs: Sequence[Channel | str] | None = None
    outputs: Sequence[Channel | str] | None = None

    def __post_init__(self) -> None:
        for key in ("a", "b"):
            value = np.array(getattr(self, key), dtype=np.float64)
            if value.ndim != 3 or not np.isfinite(value).all():
                raise ExciteError(f"PolynomialModel.{key}: shape {value.shape}; expected (lags, rows, columns), finite")
            value.flags.writeable = False
            object.__setattr__(self, key, value)
        if not np.array_equal(self.a[0], np.eye(self.a.shape[1])):
            raise ExciteError("PolynomialModel.a: the first coefficient must be the identity; divide by it")
        object.__setattr__(self, "dt", positive(self.dt, "PolynomialModel.dt"))
        object.__setattr__(self, "inputs", channels_for(self.b.shape[2], self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(self.b.shape[1], self.outputs, "y"))

    def to_state_space(self) -> StateSpaceModel:
        """Return the observer form with ny * max(na, nb) states, exact and in innovation form."""
        ny, nu = self.b.shape[1:]
        lags = max(len(self.a), len(self.b)) - 1
        a, b = np.zeros((lags + 1, ny, ny)), np.zeros((lags + 1, ny, nu))
        a[: len(self.a)], b[: len(self.b)] = self.a, self.b
        n = ny * lags
        A = np.zeros((n, n))
        A[:, :ny] = -a[1:].reshape(n, ny)
        A[: n - ny, ny:] = np.eye(n - ny)
        C = np.hstack([np.eye(ny), np.zeros((ny, n - ny))])
        return StateSpaceModel(
            A,
            (b[1:] - a[1:] @ b[0]).reshape(n, nu),
            C,
            b[0],
            self.dt,
            K=-a[1:].reshape(n, ny),
            innovation_cov=self.innovation_cov,
            inputs=self.inputs,
            outputs=self.outputs,
        )

    def poles(self) -> np.ndarray:
        """Poles of the observer form (z-plane); zero-padding poles at the origin included."""
        return self.to_state_space().poles()

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu) complex."""
        delay = np.exp(-2j * np.pi * np.atleast_1d(f_hz) * self.dt)
        a, b = (np.tensordot(delay[:, None] ** np.arange(len(m)), m, 1) for m in (self.a, self.b))
        return np.linalg.solve(a, b)

    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters as (count, ny, nu)."""
        return self.to_state_space().impulse(count)

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from observer state x0."""
        return self.to_state_space().simulate(u, x0)

    def predict(self, experiment: Record, horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny)."""
        return self.to_state_space().predict(experiment, horizon, x0)
