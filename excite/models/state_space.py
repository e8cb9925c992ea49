"""State-space models in innovation form."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.continuous import ContinuousModel, invert_hold
from excite.models.model import Predictor, Record
from excite.models.modes import Mode, modal_basis, modes_of
from excite.numerics.kalman import kalman_gain
from excite.numerics.simulate import fir, markov, observability, simulate, states
from excite.types.channel import Channel, channels_for, positive

if TYPE_CHECKING:
    import control


def _matrix(value: object, shape: tuple[int, int], place: str) -> np.ndarray:
    array = np.array(value, dtype=np.float64, ndmin=2)
    if array.shape != shape or not np.isfinite(array).all():
        raise ExciteError(f"{place}: shape {array.shape}, expected {shape} with finite values")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class StateSpaceModel(Predictor):
    """Discrete state-space model in innovation form, seed 000 eq. (2.4).

    x(k+1) = A x(k) + B (u(k) - u0) + K e(k),   y(k) - y0 = C x(k) + D (u(k) - u0) + e(k)

    A (n, n), B (n, nu), C (ny, n), D (ny, nu), dt in s; K (n, ny) and innovation_cov (ny, ny) or None when the model
    has no noise part; input_offset u0 (nu,), output_offset y0 (ny,), zero unless an estimator removed an offset.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    K: np.ndarray | None = None
    innovation_cov: np.ndarray | None = None
    inputs: Sequence[Channel | str] | None = None
    outputs: Sequence[Channel | str] | None = None
    input_offset: np.ndarray | None = None
    output_offset: np.ndarray | None = None

    def __post_init__(self) -> None:
        n = len(np.atleast_2d(self.A)) if np.size(self.A) else 0
        nu, ny = np.atleast_2d(self.D).shape[1], np.atleast_2d(self.D).shape[0]
        shapes = {"A": (n, n), "B": (n, nu), "C": (ny, n), "D": (ny, nu), "K": (n, ny), "innovation_cov": (ny, ny)}
        for key, shape in shapes.items():
            value = getattr(self, key)
            if value is not None:
                value = np.reshape(value, shape) if np.size(value) == 0 else value
                object.__setattr__(self, key, _matrix(value, shape, f"StateSpaceModel.{key}"))
        for key, size in (("input_offset", nu), ("output_offset", ny)):
            value = np.zeros(size) if getattr(self, key) is None else getattr(self, key)
            object.__setattr__(self, key, _matrix(value, (1, size), f"StateSpaceModel.{key}")[0])
        object.__setattr__(self, "dt", positive(self.dt, "StateSpaceModel.dt"))
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    def poles(self) -> np.ndarray:
        """Eigenvalues of A (z-plane), sorted by argument and modulus."""
        poles = la.eigvals(self.A) if self.order else np.empty(0, complex)
        return poles[np.lexsort((poles.imag, np.abs(poles), np.abs(np.angle(poles)).round(12)))]

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response G(e^{j 2 pi f dt}) as (F, ny, nu) complex."""
        z = np.exp(2j * np.pi * np.atleast_1d(f_hz) * self.dt)
        resolvent = z[:, None, None] * np.eye(self.order) - self.A
        return self.C @ np.linalg.solve(resolvent, np.broadcast_to(self.B, (len(z), *self.B.shape))) + self.D

    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters D, CB, CAB, … as (count, ny, nu)."""
        return markov(self.A, self.B, self.C, self.D, count)

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from state x0."""
        return simulate(self.A, self.B, self.C, self.D, u - self.input_offset, x0) + self.output_offset

    def predictor(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A - K C and [B - K D, K], the one-step predictor driven by [u, y]."""
        if self.K is None:
            raise ExciteError("this model has no noise part (K), so it cannot predict; use simulate")
        return self.A - self.K @ self.C, np.hstack([self.B - self.K @ self.D, self.K])

    def predict(self, experiment: Record, horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny), from state x0 at the first sample.

        The one-step predictor runs on measured u and y; the remaining horizon - 1 steps use u alone. The first
        horizon - 1 samples are simulated from x0.
        """
        if horizon < 1:
            raise ExciteError(f"predict: horizon {horizon}; it must be at least 1 sample")
        u, y = experiment.u - self.input_offset, experiment.y - self.output_offset
        Ak, Bk = self.predictor()
        x = states(Ak, Bk, np.hstack([u, y]), x0)
        if horizon == 1:
            return x @ self.C.T + u @ self.D.T + self.output_offset
        lead = min(horizon - 1, len(u))
        yhat = np.empty_like(y)
        yhat[:lead] = simulate(self.A, self.B, self.C, self.D, u[:lead], x0)
        response = fir(self.impulse(horizon), u)
        onward = self.C @ np.linalg.matrix_power(self.A, horizon - 1)
        yhat[lead:] = response[lead:] + x[: len(u) - lead] @ onward.T
        return yhat + self.output_offset

    def to_state_space(self) -> "StateSpaceModel":
        """Return this model."""
        return self

    def to_control(self) -> "control.StateSpace":
        """Return the deterministic part as a python-control system."""
        import control

        names = [c.name for c in self.inputs], [c.name for c in self.outputs]
        return control.StateSpace(self.A, self.B, self.C, self.D, self.dt, inputs=names[0], outputs=names[1])

    def to_continuous(self) -> ContinuousModel:
        """Return the deterministic part in continuous time, for an input held between samples; offsets stay what they are.

        Raises ExciteError for a pole that no continuous-time model has (`continuous.invert_hold`).
        """
        A, B = invert_hold(self.A, self.B, self.dt)
        return ContinuousModel(A, B, self.C, self.D, self.inputs, self.outputs)

    def modes(self) -> tuple[Mode, ...]:
        """Natural frequencies, dampings, time constants and mode shapes, slowest first."""
        return modes_of(self.A, self.C, self.dt)

    def to_modal(self) -> "StateSpaceModel":
        """Return the model with A block-diagonal, one block a mode, slowest first, and the mode shapes as columns of C."""
        T, A = modal_basis(self.A, self.C)
        K = None if self.K is None else la.solve(T, self.K)
        return replace(self, A=A, B=la.solve(T, self.B), C=self.C @ T, K=K)

    def select(self, outputs: Sequence[str]) -> "StateSpaceModel":
        """Return the model of the named outputs alone; K is then the steady Kalman gain for what they show."""
        known = [c.name for c in self.outputs]
        keep = [known.index(name) for name in outputs]
        K, cov = self.K, self.innovation_cov
        if K is not None and cov is not None and len(keep) < len(known):
            K, cov = kalman_gain(self.A, self.C[keep], K @ cov @ K.T, cov[np.ix_(keep, keep)], K @ cov[:, keep])
        elif K is not None:
            K, cov = K[:, keep], None if cov is None else cov[np.ix_(keep, keep)]
        return replace(
            self,
            C=self.C[keep],
            D=self.D[keep],
            K=K,
            innovation_cov=cov,
            outputs=[self.outputs[i] for i in keep],
            output_offset=self.output_offset[keep],
        )

    def delayed(self, samples: int) -> "StateSpaceModel":
        """Return the model behind a dead time on all inputs: nu * samples more states, poles at the origin, hold u meanwhile."""
        if samples == 0:
            return self
        n, nu, ny = self.order, *self.D.shape[::-1]
        held = nu * samples
        A = np.block(
            [
                [self.A, np.zeros((n, held - nu)), self.B],
                [np.zeros((nu, n + held))],
                [np.zeros((held - nu, n)), np.eye(held - nu, held)],
            ]
        )
        return replace(
            self,
            A=A,
            B=np.vstack([np.zeros((n, nu)), np.eye(held, nu)]),
            D=np.zeros((ny, nu)),
            C=np.hstack([self.C, np.zeros((ny, held - nu)), self.D]),
            K=None if self.K is None else np.vstack([self.K, np.zeros((held, ny))]),
        )

    def lift(self, every: int) -> "StateSpaceModel":
        """Return the model at dt * every, for an input held over each longer interval of `every` samples.

        A_q = A^q, B_q = (I + A + … + A^(q-1)) B. The innovations of the q samples reach the state as
        sum_i A^(q-1-i) K e_i, correlated with y through e_0; the new K is the steady Kalman gain for that noise.
        """
        if every == 1:
            return self
        powers = observability(self.A, np.eye(self.order), every)
        A = self.A @ powers[-1]
        K, cov = self.K, self.innovation_cov
        if K is not None and cov is not None and np.any(cov):
            reach = powers @ K
            K, cov = kalman_gain(A, self.C, np.einsum("iab,bc,idc->ad", reach, cov, reach), cov, reach[-1] @ cov)
        else:
            K = cov = None
        return replace(self, A=A, B=powers.sum(0) @ self.B, dt=self.dt * every, K=K, innovation_cov=cov)
