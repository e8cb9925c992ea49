"""Linear plants in open or closed loop: dynamics with noise, feedback, their interconnection and its checks.

The one diagram (Zaffalon and Hofmann 2024, 6.1), r1 at the plant input and r2 at the set-point, s = -1 for negative feedback:

    u = r1 + C(q) (r2 + s y_m),    v = actuator(u),    x+ = A x + B v + G n,    y = C x + D v + H n
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError, SimulationStopped
from excite.models.state_space import StateSpaceModel
from excite.numerics.matrices import spectral_radius
from excite.numerics.simulate import simulate
from plants.linear.actuator import Element, actuate

STABLE = 1 - 1e-12  # spectral radius that a closed loop must stay below
GROWTH = 1e-5  # an open-loop pole beyond 1 + this grows within a record; below, it is an integrator and rounding
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
        radius = spectral_radius(plant.A)
        if radius > 1 + GROWTH:
            raise ExciteError(
                f"the plant is unstable in open loop (spectral radius {radius:.6g}); run it in closed loop"
            )
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


def start(plant: Dynamics, loop: StateSpaceModel) -> np.ndarray:
    """Return R (n, q) such that R z, z white of unit variance, is the loop's initial state; q = 0 to start at zero.

    Each source has columns of its own, a square root of the covariance that it alone gives the state in the long run.
    """
    if not plant.stationary:
        return np.zeros((loop.order, 0))
    columns = np.cumsum(list(plant.sources.values()))
    each = np.split(loop.B[:, loop.B.shape[1] - plant.G.shape[1] :], columns[:-1], axis=1)
    return np.hstack([_root(la.solve_discrete_lyapunov(loop.A, G @ G.T)) for G in each])


def _root(P: np.ndarray) -> np.ndarray:
    """Return the symmetric square root of a covariance."""
    values, vectors = la.eigh(P)
    return vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T


def play(
    plant: Dynamics,
    feedback: Feedback | None,
    elements: tuple[Element, ...],
    loop: StateSpaceModel,
    reference: np.ndarray,
    noise: np.ndarray,
    x0: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return u, v (R, N, nu) and y (R, N, ny) of R runs for one reference [r1, r2] (N, ·).

    loop : `interconnect` of the plant and its feedback; noise (R, N, nw), x0 (R, loop.order).
    Linear superposition as long as the actuator passes u unchanged; sample by sample in a closed loop where it does not.
    """
    nu = plant.B.shape[1]
    if elements and feedback is None:
        u = reference
        v = u if all(element.passes(u) for element in elements) else actuate(elements, u)
        answer = _superpose(loop, v, noise, x0)[:, :, nu:]
        runs = (len(noise), 1, 1)
        return np.tile(u, runs), np.tile(v, runs), answer
    answer = _superpose(loop, reference, noise, x0)
    u, y = answer[:, :, :nu], answer[:, :, nu:]
    if feedback is None or all(element.passes(each) for element in elements for each in u):
        return u, u, y
    return _step(plant, feedback, elements, reference, noise, x0)


def _superpose(loop: StateSpaceModel, reference: np.ndarray, noise: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Return the answer to the reference, the same in all runs, plus that to each run's noise and initial state."""
    m = reference.shape[1]
    known = simulate(loop.A, loop.B[:, :m], loop.C, loop.D[:, :m], reference)
    B, D = loop.B[:, m:], loop.D[:, m:]
    moving = B.any(0)  # the other noise reaches no state, so that a product serves
    answers = np.empty((len(noise), *known.shape))
    for answer, n, x in zip(answers, noise, x0, strict=True):
        answer[:] = known
        if np.any(n) or np.any(x):
            answer += simulate(loop.A, B[:, moving], loop.C, D[:, moving], n[:, moving], x)
            answer += n[:, ~moving] @ D[:, ~moving].T
    return answers


def _step(
    plant: Dynamics,
    feedback: Feedback,
    elements: tuple[Element, ...],
    reference: np.ndarray,
    noise: np.ndarray,
    x0: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample by sample, all runs at once; what the loop does not feed back is worked out before and after it."""
    c, sign, S = feedback.controller, feedback.sign, np.eye(len(plant.C))[list(feedback.measured)]
    nx, nu = plant.B.shape
    r1, r2 = reference[:, None, :nu], reference[:, None, nu:]
    Gn, Hn = (noise.transpose(1, 0, 2) @ part.T for part in (plant.G, plant.H))  # (N, R, ·)
    direct, back = c.D * sign @ S, c.B * sign @ S  # D of one of the two is zero: u does not see v of the same sample
    U = np.hstack([direct @ plant.C, c.C]).T
    Z = np.block([[plant.A, np.zeros((nx, c.order))], [back @ plant.C, c.A]]).T
    V = np.vstack([plant.B, back @ plant.D]).T
    known_u = r1 + r2 @ c.D.T + Hn @ direct.T
    known_z = np.concatenate([Gn, r2 @ c.B.T + Hn @ back.T], axis=2)
    u, v, z = np.empty_like(known_u), np.empty_like(known_u), np.empty((len(noise[0]) + 1, *x0.shape))
    z[0] = x0
    memory = [element.start((len(x0), nu)) for element in elements]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(u)):
            u[k] = given = z[k] @ U + known_u[k]
            for i, element in enumerate(elements):
                given, memory[i] = element.advance(given, memory[i])
            v[k] = given
            z[k + 1] = z[k] @ Z + given @ V + known_z[k]
        y = z[:-1, :, :nx] @ plant.C.T + v @ plant.D.T + Hn
    kept = np.abs(y).max((1, 2)) < DIVERGED
    if not kept.all():
        raise SimulationStopped(
            f"the loop diverged at sample {np.argmin(kept)}: the actuator's limits take away the feedback that keeps the plant; "
            "reduce the excitation's amplitude, or widen the limits"
        )
    return u.transpose(1, 0, 2), v.transpose(1, 0, 2), y.transpose(1, 0, 2)
