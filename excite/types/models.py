"""Models: what identification returns and what truth is made of, behind one small protocol."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.errors import ExciteError
from excite.types.channel import Channel, channels_for, positive
from excite.types.continuous import ContinuousModel, invert_hold
from excite.types.modes import Mode, modal_basis, modes_of

if TYPE_CHECKING:
    import control

    from excite.types.experiment import Experiment


class Model(Protocol):
    """What every model offers: frequency response, impulse response, simulation, poles, state space."""

    dt: float
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    def frf(self, f_hz: np.ndarray) -> np.ndarray: ...  # noqa: D102
    def impulse(self, count: int) -> np.ndarray: ...  # noqa: D102
    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray: ...  # noqa: D102
    def poles(self) -> np.ndarray: ...  # noqa: D102
    def to_state_space(self) -> "StateSpaceModel": ...  # noqa: D102


def _matrix(value: object, shape: tuple[int, int], place: str) -> np.ndarray:
    array = np.array(value, dtype=np.float64, ndmin=2)
    if array.shape != shape or not np.isfinite(array).all():
        raise ExciteError(f"{place}: shape {array.shape}, expected {shape} with finite values")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
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
        return lti.markov(self.A, self.B, self.C, self.D, count)

    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from state x0."""
        return lti.simulate(self.A, self.B, self.C, self.D, u - self.input_offset, x0) + self.output_offset

    def predictor(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A - K C and [B - K D, K], the one-step predictor driven by [u, y]."""
        if self.K is None:
            raise ExciteError("this model has no noise part (K), so it cannot predict; use simulate")
        return self.A - self.K @ self.C, np.hstack([self.B - self.K @ self.D, self.K])

    def predict(self, experiment: "Experiment", horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny), from state x0 at the first sample.

        The one-step predictor runs on measured u and y; the remaining horizon - 1 steps use u alone. The first
        horizon - 1 samples are simulated from x0.
        """
        if horizon < 1:
            raise ExciteError(f"predict: horizon {horizon}; it must be at least 1 sample")
        u, y = experiment.u - self.input_offset, experiment.y - self.output_offset
        Ak, Bk = self.predictor()
        x = lti.states(Ak, Bk, np.hstack([u, y]), x0)
        if horizon == 1:
            return x @ self.C.T + u @ self.D.T + self.output_offset
        lead = min(horizon - 1, len(u))
        yhat = np.empty_like(y)
        yhat[:lead] = lti.simulate(self.A, self.B, self.C, self.D, u[:lead], x0)
        response = lti.fir(self.impulse(horizon), u)
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
        powers = lti.observability(self.A, np.eye(self.order), every)
        A = self.A @ powers[-1]
        K, cov = self.K, self.innovation_cov
        if K is not None and cov is not None and np.any(cov):
            reach = powers @ K
            K, cov = kalman_gain(A, self.C, np.einsum("iab,bc,idc->ad", reach, cov, reach), cov, reach[-1] @ cov)
        else:
            K = cov = None
        return replace(self, A=A, B=powers.sum(0) @ self.B, dt=self.dt * every, K=K, innovation_cov=cov)


def kalman_gain(
    A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the steady one-step Kalman gain K (n, ny) and the innovation covariance (ny, ny).

    For x+ = A x + w, y = C x + v with cov [w; v] = [[Q, S], [S^T, R]], by the stabilising Riccati solution. Raises
    ExciteError when there is none.
    """
    try:
        P = la.solve_discrete_are(A.T, C.T, (Q + Q.T) / 2, (R + R.T) / 2, s=S)
        innovation = C @ P @ C.T + R
        return la.solve(innovation, (A @ P @ C.T + S).T, assume_a="pos").T, (innovation + innovation.T) / 2
    except (la.LinAlgError, ValueError) as error:  # the latter when the eigenvalues cannot be sorted
        raise ExciteError(
            f"no steady Kalman gain exists for this noise ({error}); give every output some noise"
        ) from error


@dataclass(frozen=True, eq=False)
class PolynomialModel:
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

    def predict(self, experiment: "Experiment", horizon: int = 1, x0: np.ndarray | None = None) -> np.ndarray:
        """Return yhat(t | t - horizon) as (N, ny)."""
        return self.to_state_space().predict(experiment, horizon, x0)
