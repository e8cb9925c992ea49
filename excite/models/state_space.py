"""State-space models: sampled, in innovation form, and in continuous time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.arrays import finite, input_samples, offset
from excite.models.continuous import hold, instants, invert_hold, sampling_time, uniform_step
from excite.models.model import Dynamic, Parametric, Predictor, Record, check_horizons
from excite.models.modes import Mode, modal_basis, modes_of
from excite.numerics.kalman import kalman_gain
from excite.numerics.simulate import fir, markov, observability, simulate, states
from excite.types.channel import Channels, channels_for, positive
from excite.types.checked import NOT_GIVEN, ArrayByDefault, OptionalArray

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False)
class StateSpaceModel(Predictor, Parametric):
    """Discrete state-space model in innovation form (Ljung, System Identification, 2nd ed. 1999, eq. 4.92).

    x(k+1) = A x(k) + B (u(k) - u0) + K e(k),   y(k) - y0 = C x(k) + D (u(k) - u0) + e(k)

    A (n, n), B (n, nu), C (ny, n), D (ny, nu), dt in s; K (n, ny) and innovation_cov (ny, ny) or None when the model
    has no noise part; input_offset u0 (nu,), output_offset y0 (ny,), zero unless an estimator removed an offset.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    K: OptionalArray = NOT_GIVEN
    innovation_cov: OptionalArray = NOT_GIVEN
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    input_offset: ArrayByDefault = NOT_GIVEN
    output_offset: ArrayByDefault = NOT_GIVEN

    def __post_init__(self) -> None:
        n = len(np.atleast_2d(self.A)) if np.size(self.A) else 0
        ny, nu = np.atleast_2d(self.D).shape
        shapes = {"A": (n, n), "B": (n, nu), "C": (ny, n), "D": (ny, nu), "K": (n, ny), "innovation_cov": (ny, ny)}
        for key, shape in shapes.items():
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, finite(np.atleast_2d(value), shape, f"StateSpaceModel.{key}"))
        for key, size in (("input_offset", nu), ("output_offset", ny)):
            object.__setattr__(self, key, offset(getattr(self, key), size, f"StateSpaceModel.{key}"))
        object.__setattr__(self, "dt", positive(self.dt, "StateSpaceModel.dt"))
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    def poles(self) -> np.ndarray:
        """Eigenvalues of A (z-plane), sorted by argument and modulus."""
        return self._poles.copy()

    @cached_property
    def _poles(self) -> np.ndarray:
        return poles_of(self.A)

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response G(e^{j 2 pi f dt}) as (F, ny, nu) complex."""
        return _transfer(np.exp(2j * np.pi * np.atleast_1d(f_hz) * self.dt), self.A, self.B, self.C, self.D)

    def noise_frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, ny) of the noise model."""
        z = np.exp(2j * np.pi * np.atleast_1d(f_hz) * self.dt)
        return _transfer(z, self.A, self._gain(), self.C, np.eye(len(self.C)))

    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters D, CB, CAB, … as (count, ny, nu)."""
        return markov(self.A, self.B, self.C, self.D, count)

    def noise_impulse(self, count: int) -> np.ndarray:
        """Impulse response I, CK, CAK, … of the noise model as (count, ny, ny)."""
        return markov(self.A, self._gain(), self.C, np.eye(len(self.C)), count)

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from state x0."""
        u = input_samples(u, len(self.inputs), "StateSpaceModel.simulate")
        return simulate(self.A, self.B, self.C, self.D, u - self.input_offset, x0) + self.output_offset

    @property
    def predicts(self) -> bool:
        """Whether the model has a noise part."""
        return self.K is not None

    def _gain(self) -> np.ndarray:
        if self.K is None:
            raise ExciteError("this model has no noise part (K), so it cannot predict; use simulate")
        return self.K

    def predictor(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A - K C and [B - K D, K], the one-step predictor driven by [u, y]."""
        K = self._gain()
        return self.A - K @ self.C, np.hstack([self.B - K @ self.D, K])

    def innovations(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Return the one-step prediction errors (N, ny), from the state x0 at the first sample."""
        A, B = self.predictor()
        measured = np.hstack([record.u - self.input_offset, record.y - self.output_offset])
        return simulate(A, B, -self.C, np.hstack([-self.D, np.eye(len(self.C))]), measured, x0)

    def predictions(
        self, record: Record, horizons: Sequence[int], x0: np.ndarray | None = None
    ) -> tuple[np.ndarray, ...]:
        """Return yhat(t | t - h) as (N, ny) for each h of `horizons`, from state x0 at the first sample.

        The one-step predictor runs on measured u and y; the remaining h - 1 steps use u alone. The first h - 1 samples are
        simulated from x0.
        """
        check_horizons(horizons)
        A, B = self.predictor()
        u, y = record.u - self.input_offset, record.y - self.output_offset
        x, ahead = states(A, B, np.hstack([u, y]), x0), []
        for horizon in horizons:
            if horizon == 1:
                yhat = x @ self.C.T + u @ self.D.T
            else:
                lead = min(horizon - 1, len(u))
                yhat = fir(self.impulse(horizon), u)
                yhat[:lead] = simulate(self.A, self.B, self.C, self.D, u[:lead], x0)
                yhat[lead:] += x[: len(u) - lead] @ (self.C @ np.linalg.matrix_power(self.A, horizon - 1)).T
            ahead.append(yhat + self.output_offset)
        return tuple(ahead)

    def theta(self) -> np.ndarray:
        """Return the entries of A, B, C, D, K, row by row; D and K that are zero throughout are structure and left out."""
        return np.concatenate([getattr(self, key).ravel() for key in self.free()])

    def free(self) -> tuple[str, ...]:
        """Return the names of the matrices that theta holds."""
        return ("A", "B", "C", *(key for key in ("D", "K") if self._holds(key)))

    def _holds(self, key: str) -> bool:
        return getattr(self, key) is not None and bool(np.any(getattr(self, key)))

    def at(self, theta: np.ndarray) -> Self:
        """Return the model with other entries of A, B, C, and of D and K where theta holds them."""
        keys = self.free()
        ends = np.cumsum([getattr(self, key).size for key in keys])
        theta = finite(theta, (int(ends[-1]),), "StateSpaceModel.at: theta")
        blocks = np.split(theta, ends[:-1])
        held: dict[str, Any] = {k: v.reshape(getattr(self, k).shape) for k, v in zip(keys, blocks, strict=True)}
        return replace(self, **held)

    def to_state_space(self) -> "StateSpaceModel":
        """Return this model."""
        return self

    def to_control(self) -> "control.StateSpace":
        """Return the deterministic part as a python-control system."""
        import control

        names = [c.name for c in self.inputs], [c.name for c in self.outputs]
        return control.StateSpace(self.A, self.B, self.C, self.D, self.dt, inputs=names[0], outputs=names[1])

    def to_continuous(self) -> "ContinuousModel":
        """Return the deterministic part in continuous time, for an input held between samples; offsets stay what they are.

        Raises ExciteError for a pole that no continuous-time model has (`continuous.invert_hold`).
        """
        A, B = invert_hold(self.A, self.B, self.dt)
        offsets = {"input_offset": self.input_offset, "output_offset": self.output_offset}
        return ContinuousModel(A, B, self.C, self.D, self.inputs, self.outputs, **offsets)

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


@dataclass(frozen=True, eq=False)
class ContinuousModel(Dynamic):
    """Deterministic continuous-time model dx/dt = A x + B (u - u0), y - y0 = C x + D (u - u0); rad and s.

    A (n, n), B (n, nu), C (ny, n), D (ny, nu); input_offset u0 (nu,), output_offset y0 (ny,). Between instants the input
    is held.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    input_offset: ArrayByDefault = NOT_GIVEN
    output_offset: ArrayByDefault = NOT_GIVEN

    def __post_init__(self) -> None:
        n = len(np.atleast_2d(self.A)) if np.size(self.A) else 0
        ny, nu = np.atleast_2d(self.D).shape
        for key, shape in {"A": (n, n), "B": (n, nu), "C": (ny, n), "D": (ny, nu)}.items():
            value = finite(np.atleast_2d(getattr(self, key)), shape, f"ContinuousModel.{key}")
            object.__setattr__(self, key, value)
        for key, size in (("input_offset", nu), ("output_offset", ny)):
            object.__setattr__(self, key, offset(getattr(self, key), size, f"ContinuousModel.{key}"))
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))

    @property
    def dt(self) -> None:
        """None: the model is in continuous time."""
        return None

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, rad/s."""
        return la.eigvals(self.A) if len(self.A) else np.empty(0, complex)

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response G(j 2 pi f) as (F, ny, nu) complex."""
        return _transfer(2j * np.pi * np.atleast_1d(f_hz), self.A, self.B, self.C, self.D)

    def impulse(self, count: int, dt: float | None = None) -> np.ndarray:
        """Markov parameters (count, ny, nu) of the model sampled at dt s."""
        return self.to_state_space(dt).impulse(count)

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None, *, time_s: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu), each held from its instant in time_s (N,) to the next, from x0."""
        time_s = instants(time_s, len(u), "ContinuousModel")
        if (step := uniform_step(time_s)) is not None:
            return self.to_state_space(step).simulate(u, x0)
        u = input_samples(u, len(self.inputs), "ContinuousModel.simulate") - self.input_offset
        steps, which = np.unique(np.diff(time_s), return_inverse=True)
        A, B = hold(self.A, self.B, steps)
        x = np.zeros((len(u), len(self.A)))
        x[0] = 0.0 if x0 is None else x0
        for k, i in enumerate(which):
            x[k + 1] = A[i] @ x[k] + B[i] @ u[k]
        return x @ self.C.T + u @ self.D.T + self.output_offset

    def response(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to the inputs of a record, at its instants, from the state x0."""
        return self.simulate(record.u, x0, time_s=record.time_s)

    def to_state_space(self, dt: float | None = None) -> StateSpaceModel:
        """Return the model sampled at dt s, for an input held between samples."""
        dt = sampling_time(dt, "ContinuousModel")
        A, B = hold(self.A, self.B, dt)
        offsets = {"input_offset": self.input_offset, "output_offset": self.output_offset}
        return StateSpaceModel(A, B, self.C, self.D, dt, inputs=self.inputs, outputs=self.outputs, **offsets)

    def to_control(self) -> "control.StateSpace":
        """Return the python-control system."""
        import control

        names = [c.name for c in self.inputs], [c.name for c in self.outputs]
        return control.StateSpace(self.A, self.B, self.C, self.D, inputs=names[0], outputs=names[1])


def poles_of(A: np.ndarray) -> np.ndarray:
    """Eigenvalues of A, sorted by argument and modulus."""
    poles = la.eigvals(A) if len(A) else np.empty(0, complex)
    return poles[np.lexsort((poles.imag, np.abs(poles), np.abs(np.angle(poles)).round(12)))]


def _transfer(s: np.ndarray, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return C (s I - A)^-1 B + D for each s (F,), as (F, rows, columns)."""
    resolvent = s[:, None, None] * np.eye(len(A)) - A
    return C @ np.linalg.solve(resolvent, np.broadcast_to(B, (len(s), *B.shape))) + D
