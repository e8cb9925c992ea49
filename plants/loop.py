"""Linear plants in open or closed loop: dynamics with noise, feedback, their interconnection and its checks.

The one diagram (seed 002, 6.1), r1 at the plant input and r2 at the set-point, s = -1 for negative feedback:

    u = r1 + C(q) (r2 + s y_m),    v = actuator(u),    x+ = A x + B v + G n,    y = C x + D v + H n
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.errors import ExciteError, SimulationStopped
from excite.types.models import StateSpaceModel
from plants.actuator import Element, actuate

STABLE = 1 - 1e-12  # spectral radius that a closed loop must stay below
DIVERGED = 1e12


@dataclass(frozen=True, eq=False)
class Dynamics:
    """x+ = A x + B u + G n, y = C x + D u + H n, with white n of unit variance.

    sources : name -> columns of n that it drives, in order; noise_states : how many states, the last ones, only shape
    noise; stationary : whether the noise's states start in their stationary distribution (else all states at zero).
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    G: np.ndarray
    H: np.ndarray
    sources: Mapping[str, int] = field(default_factory=dict)
    noise_states: int = 0
    stationary: bool = False

    def scaled(self, levels: Mapping[str, float]) -> "Dynamics":
        """Return the dynamics with every source's columns multiplied by its level."""
        columns = np.repeat([levels[name] for name in self.sources], list(self.sources.values()))
        return replace(self, G=self.G * columns, H=self.H * columns)


@dataclass(frozen=True, eq=False)
class Feedback:
    """A controller from r2 + sign * (measured outputs) to all plant inputs.

    controller : discrete model at the plant's dt; measured : columns of y that it sees.
    """

    controller: StateSpaceModel
    measured: tuple[int, ...]
    sign: int = -1


def interconnect(plant: Dynamics, feedback: Feedback | None) -> StateSpaceModel:
    """Return the system from [r1, r2, n] to [u, y]; states are the plant's, then the controller's.

    Raises ExciteError for an algebraic loop and for a loop that is not internally stable.
    """
    (nx, nu), ny, nw = plant.B.shape, len(plant.C), plant.G.shape[1]
    if feedback is None:
        radius = np.abs(la.eigvals(plant.A)).max(initial=0.0)
        if radius > 1 + 1e-9:
            raise ExciteError(f"the plant is unstable in open loop (spectral radius {radius:.6g}); run it in closed loop")
        D = np.block([[np.eye(nu), np.zeros((nu, nw))], [plant.D, plant.H]])
        C = np.vstack([np.zeros((nu, nx)), plant.C])
        return StateSpaceModel(plant.A, np.hstack([plant.B, plant.G]), C, D, 1.0)
    c, S, sign = feedback.controller, np.eye(ny)[list(feedback.measured)], feedback.sign
    if np.any(c.D @ S @ plant.D):
        raise ExciteError(
            "algebraic loop: controller and plant both act without delay (D of both is not zero); give one of them a delay"
        )
    direct = c.D * sign @ S  # from y to u without delay
    # u, then what it does: rows over [x, xc | r1, r2, n]
    u_x = np.hstack([direct @ plant.C, c.C])
    u_r = np.hstack([np.eye(nu), c.D, direct @ plant.H])
    y_x = np.hstack([plant.C, np.zeros((ny, c.order))]) + plant.D @ u_x
    y_r = np.hstack([np.zeros((ny, nu + len(S))), plant.H]) + plant.D @ u_r
    A = np.vstack([plant.B @ u_x, sign * c.B @ S @ y_x]) + la.block_diag(plant.A, c.A)
    B = np.vstack([plant.B @ u_r, sign * c.B @ S @ y_r])
    B[:nx, nu + len(S) :] += plant.G
    B[nx:, nu : nu + len(S)] += c.B
    poles = la.eigvals(A)
    worst = poles[np.argmax(np.abs(poles))]
    if abs(worst) >= STABLE:
        raise ExciteError(
            f"the closed loop is not internally stable: pole {worst:.6g} of modulus {abs(worst):.6g} (plant and controller "
            "together); change the controller, or the sign of the feedback"
        )
    return StateSpaceModel(A, B, np.vstack([u_x, y_x]), np.vstack([u_r, y_r]), 1.0)


def start(plant: Dynamics, loop: StateSpaceModel, rng: np.random.Generator) -> np.ndarray:
    """Return the loop's initial state: zero, or drawn from what the noise alone makes of it in the long run."""
    x0 = np.zeros(loop.order)
    if plant.stationary and loop.order:
        G = loop.B[:, loop.B.shape[1] - plant.G.shape[1] :]
        values, vectors = la.eigh(la.solve_discrete_lyapunov(loop.A, G @ G.T))
        x0 = vectors @ (np.sqrt(np.maximum(values, 0)) * rng.standard_normal(loop.order))
    return x0


def play(
    plant: Dynamics, feedback: Feedback | None, elements: tuple[Element, ...], loop: StateSpaceModel,
    reference: np.ndarray, noise: np.ndarray, x0: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return u, v (R, N, nu) and y (R, N, ny) of R runs for one reference [r1, r2] (N, ·).

    loop : `interconnect` of the plant and its feedback; noise (R, N, nw), x0 (R, loop.order).
    Linear superposition as long as the actuator passes u unchanged; sample by sample in a closed loop where it does not.
    """
    nu = plant.B.shape[1]
    if elements and feedback is None:
        u = reference
        v = actuate(elements, u)
        answer = _superpose(loop, v, noise, x0)[:, :, nu:]
        runs = (len(noise), 1, 1)
        return np.tile(u, runs), np.tile(v, runs), answer
    answer = _superpose(loop, reference, noise, x0)
    u, y = answer[:, :, :nu], answer[:, :, nu:]
    if not elements or all(np.array_equal(actuate(elements, each), each) for each in u):
        return u, u, y
    return _step(plant, feedback, elements, reference, noise, x0)


def _superpose(loop: StateSpaceModel, reference: np.ndarray, noise: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Return the answer to the reference, the same in all runs, plus that to each run's noise and initial state."""
    m = reference.shape[1]
    known = lti.simulate(loop.A, loop.B[:, :m], loop.C, loop.D[:, :m], reference)
    answers = np.empty((len(noise), *known.shape))
    for answer, n, x in zip(answers, noise, x0, strict=True):
        answer[:] = known
        if np.any(n) or np.any(x):
            answer += lti.simulate(loop.A, loop.B[:, m:], loop.C, loop.D[:, m:], n, x)
    return answers


def _step(
    plant: Dynamics, feedback: Feedback, elements: tuple[Element, ...], reference: np.ndarray, noise: np.ndarray, x0: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Sample by sample, all runs at once."""
    c, measured, sign = feedback.controller, list(feedback.measured), feedback.sign
    runs, N = noise.shape[:2]
    (nx, nu), ny = plant.B.shape, len(plant.C)
    x, xc = x0[:, :nx].copy(), x0[:, nx:].copy()
    u, v, y = np.empty((runs, N, nu)), np.empty((runs, N, nu)), np.empty((runs, N, ny))
    memory = [np.zeros((runs, nu)) for _ in elements]
    Gn, Hn = noise @ plant.G.T, noise @ plant.H.T
    for k in range(N):
        r1, r2 = reference[k, :nu], reference[k, nu:]
        free = x @ plant.C.T + Hn[:, k]  # y but for D v, which no direct path leads back to u
        u[:, k] = r1 + xc @ c.C.T + (r2 + sign * free[:, measured]) @ c.D.T
        given = u[:, k]
        for i, element in enumerate(elements):
            given = memory[i] = element.step(given, memory[i])
        v[:, k] = given
        y[:, k] = free + given @ plant.D.T
        x = x @ plant.A.T + given @ plant.B.T + Gn[:, k]
        xc = xc @ c.A.T + (r2 + sign * y[:, k][:, measured]) @ c.B.T
        if not np.abs(y[:, k]).max() < DIVERGED:
            raise SimulationStopped(
                f"the loop diverged at sample {k}: the actuator's limits take away the feedback that keeps the plant; "
                "reduce the excitation's amplitude, or widen the limits"
            )
    return u, v, y
