"""The sparse quadratic program behind shaping: the sequence nearest to a given one within linear bounds."""

from dataclasses import dataclass

import numpy as np
import osqp
from scipy import sparse

from excite.errors import ExciteError
from excite.numerics.matrices import spectral_radius
from excite.numerics.simulate import simulate, states

OUT_OF_BAND = 0.1  # amplitude weight of a deviation outside the excited band against one inside
HALF_TAPS = 24  # of the filter that tells the two apart
ACCURACY = 1e-4  # of the solver, relative to the bounds; what it leaves is repaired afterwards
ITERATIONS = 1000  # a solution that takes longer is near enough, and repaired as well
SETTLED = 1e-3  # a transient below this fraction of its start needs no more periods


@dataclass(frozen=True, eq=False)
class Bounds:
    """Linear bounds on values v (n, nu) that are played as u(k) = v(index(k)).

    index : (N,); repeats : whether the last value is followed by the first; low, high, move : (nu,), infinite where free;
    A, B, C, D : model from u - rest to the bounded outputs about trim, with ny = 0 when there are none;
    y_low, y_high : (ny,); rest : (nu,), the input at trim.
    """

    index: np.ndarray
    repeats: bool
    low: np.ndarray
    high: np.ndarray
    move: np.ndarray
    rest: np.ndarray
    model: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    y_low: np.ndarray
    y_high: np.ndarray

    def moves(self, v: np.ndarray) -> np.ndarray:
        """Changes from value to value, and from the last to the first where they repeat, (n, nu)."""
        return np.diff(v, axis=0, append=v[:1] if self.repeats else v[-1:])

    def outputs(self, v: np.ndarray) -> np.ndarray:
        """Outputs about trim, (N, ny)."""
        return simulate(*self.model, v[self.index] - self.rest) if len(self.y_low) else np.zeros((1, 0))

    def excess(self, y: np.ndarray, margin: np.ndarray | float = 0.0) -> np.ndarray:
        """How far each output lies beyond its bound less `margin` at worst, (ny,); negative inside."""
        return np.maximum(y - self.y_high, self.y_low - y).max(0, initial=-np.inf) + margin


def nearest(
    target: np.ndarray, bounds: Bounds, band: tuple[float, float] | None, margin: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Minimise ||F (v - target)||^2 within the bounds, outputs kept off theirs by `margin` (ny,): v, whether solved.

    F weighs deviations in `band` (fractions of the Nyquist frequency; None for all) by 1 and elsewhere by OUT_OF_BAND.
    Clipping solves the problem with amplitude bounds and no band. Otherwise OSQP does (Stellato et al., Math. Prog. Comp.
    12, 2020), without the outputs where they need nothing.
    """
    clipped = np.clip(target, bounds.low, bounds.high)
    if (bounds.excess(bounds.outputs(clipped), margin) > 0).any():
        return _solve(target, bounds, band, margin), True
    inside = (np.abs(bounds.moves(clipped)) <= bounds.move).all()
    if inside and (band is None or (clipped == target).all()):
        return clipped, False
    values = _solve(target, bounds, band, None)
    if (bounds.excess(bounds.outputs(values), margin) > 0).any():
        values = _solve(target, bounds, band, margin)
    return values, True


def _solve(
    target: np.ndarray, bounds: Bounds, band: tuple[float, float] | None, margin: np.ndarray | None
) -> np.ndarray:
    n, nu = target.shape
    scale = np.abs(target - target.mean(0)).max(0)
    scale = np.where(scale > 0, scale, 1.0)
    P = sparse.kron(_weight(n, band), sparse.eye(nu)).tocsc()
    rows = [sparse.eye(n * nu)]
    low, high = [np.tile((bounds.low - bounds.rest) / scale, n)], [np.tile((bounds.high - bounds.rest) / scale, n)]
    if np.isfinite(bounds.move).any():
        D = sparse.eye(n, k=1) - sparse.eye(n)
        D = D + sparse.coo_matrix(([1.0], ([n - 1], [0])), (n, n)) if bounds.repeats else D.tocsr()[: n - 1]
        rows.append(sparse.kron(D, sparse.eye(nu)))
        high.append(np.tile(bounds.move / scale, D.shape[0]))
        low.append(-high[-1])
    wanted = (target - bounds.rest) / scale
    if margin is not None:
        dynamics = _dynamics(target, bounds, scale, margin)
        states = dynamics[0].shape[1] - n * nu
        P = sparse.block_diag([P, sparse.csc_matrix((states, states))])
        rows = [sparse.hstack([row, sparse.csc_matrix((row.shape[0], states))]) for row in rows] + [dynamics[0]]
        low.append(dynamics[1])
        high.append(dynamics[2])
    q = np.zeros(P.shape[0])
    q[: n * nu] = -(P.tocsr()[: n * nu, : n * nu] @ wanted.ravel())
    A = sparse.vstack(rows).tocsc()
    solver = osqp.OSQP()
    solver.setup(
        sparse.triu(P).tocsc(),
        q,
        A,
        np.concatenate(low),
        np.concatenate(high),
        verbose=False,
        eps_abs=ACCURACY,
        eps_rel=ACCURACY,
        max_iter=ITERATIONS,
        rho=1.0,
        polishing=False,
    )
    x = solver.solve(raise_error=False).x[: n * nu]
    if x is None or not np.isfinite(x).all():
        raise ExciteError("shape: the quadratic program has no solution; the limits contradict each other")
    return x.reshape(n, nu) * scale + bounds.rest


def _weight(n: int, band: tuple[float, float] | None) -> sparse.spmatrix:
    """F^T F, (n, n) banded Toeplitz: the filter's own correlation, so that the ends weigh as much as the middle."""
    from scipy.signal import firwin  # slow to import, and only shaping needs it

    half = min(HALF_TAPS, (n - 1) // 2)
    if band is None or half == 0:
        return sparse.eye(n)
    edges = [f for f in band if 0 < f < 1]
    taps = (1 - OUT_OF_BAND) * firwin(2 * half + 1, edges, pass_zero=band[0] <= 0) if edges else np.zeros(2 * half + 1)
    taps[half] += OUT_OF_BAND
    lags = np.arange(-2 * half, 2 * half + 1)
    inside = np.abs(lags) < n
    return sparse.diags(np.correlate(taps, taps, "full")[inside], lags[inside], shape=(n, n))


def _dynamics(
    target: np.ndarray, bounds: Bounds, scale: np.ndarray, margin: np.ndarray
) -> tuple[sparse.spmatrix, np.ndarray, np.ndarray]:
    """Rows of x(k+1) = A x(k) + B u(k) and of the bounded outputs, in scaled values and states, with their bounds.

    Periods after the transient has settled repeat each other and are left out.
    """
    A, B, C, D = bounds.model
    n = len(target)
    K, n_x = _samples_that_matter(A, bounds.index), len(A)
    index = bounds.index[:K]
    x_scale = np.abs(states(A, B, target[index] - bounds.rest)).max(0, initial=0.0)
    x_scale = np.where(x_scale > 0, x_scale, 1.0)
    sizes = np.abs([bounds.y_low, bounds.y_high])
    y_scale = np.where((sizes > 0) & np.isfinite(sizes), sizes, np.inf).min(
        0
    )  # the solver's accuracy is the tighter one's
    y_scale[np.isinf(y_scale)] = 1.0
    A, B = A / x_scale[:, None] * x_scale, B / x_scale[:, None] * scale
    C, D = C / y_scale[:, None] * x_scale, D / y_scale[:, None] * scale
    pick = sparse.coo_matrix((np.ones(K), (np.arange(K), index)), (K, n)).tocsr()
    steps = sparse.hstack(
        [-sparse.kron(pick[: K - 1], B), sparse.eye((K - 1) * n_x) - sparse.kron(sparse.eye(K - 1, k=-1), A)]
    )
    later = sparse.eye(K, K - 1, k=-1)  # x(0) = 0 is no variable
    seen = sparse.hstack([sparse.kron(pick, D), sparse.kron(later, C)])
    zero = np.zeros((K - 1) * n_x)
    low, high = ((b + s * margin) / y_scale for b, s in ((bounds.y_low, 1), (bounds.y_high, -1)))
    return (
        sparse.vstack([steps, seen]),
        np.concatenate([zero, np.tile(low, K)]),
        np.concatenate([zero, np.tile(high, K)]),
    )


def _samples_that_matter(A: np.ndarray, index: np.ndarray) -> int:
    """Samples up to one whole period after the transient from trim has settled; all for a record without repetition."""
    N, period = len(index), int((index[1:] < index[:-1]).argmax()) + 1 if (index[1:] < index[:-1]).any() else len(index)
    radius = spectral_radius(A)
    if radius >= 1:
        return N
    settle = np.log(SETTLED) / np.log(max(radius, 1e-3))
    return min(N, period * (int(np.ceil(settle / period)) + 1))
