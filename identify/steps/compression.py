"""Past-future data compressed into one triangular factor, from which every subspace method takes its rows."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.correlation import Joint
from excite.numerics.hankel import GRAM_CONDITION, HankelFactor, block_rows, condition_of, hankel_factor
from excite.persistency.certificate import RANK_TOLERANCE, certify
from excite.types.experiment import Experiment
from identify.data.records import constant

RANK = 1e-11  # singular values of scaled rows below this fraction of the largest are rounding


@dataclass(frozen=True, eq=False)
class PastFuture:
    """Rows of [u; y] Hankel data over past + future (+ 1) block rows, compressed.

    All row vectors of length `columns` live as rows of the factor: products of two of them, projections and least
    squares are the same there as on the long data.
    """

    factor: HankelFactor
    experiments: tuple[Experiment, ...]
    past: int
    future: int
    memory: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def once(self, key: Hashable, compute: Callable[["PastFuture"], Any]) -> Any:
        """Return compute(self), computed at the first call with this key: what all orders of one method share."""
        if key not in self.memory:
            self.memory[key] = compute(self)
        return self.memory[key]

    @property
    def closed(self) -> bool:
        """Whether some record was taken in closed loop."""
        return any(e.loop.closed for e in self.experiments)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return self.experiments[0].u.shape[1]

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return self.experiments[0].y.shape[1]

    @property
    def circular(self) -> np.ndarray | None:
        """Circular correlation of all experiments, None where some are too short to have a column."""
        shortest = min(map(len, self.experiments))
        return self.factor.correlation.circular if shortest >= self.factor.rows else None

    def u(self, start: int, stop: int) -> np.ndarray:
        """Input rows of block rows start:stop."""
        return self.factor.L[self.factor.index(slice(0, self.nu), start, stop)]

    def y(self, start: int, stop: int) -> np.ndarray:
        """Output rows of block rows start:stop."""
        return self.factor.L[self.factor.index(slice(self.nu, None), start, stop)]

    def z(self, shift: int = 0) -> np.ndarray:
        """Z_p = [U_p; Y_p], the past of block row past + shift."""
        return np.vstack([self.u(shift, shift + self.past), self.y(shift, shift + self.past)])


def joint_segments(experiments: tuple[Experiment, ...]) -> list[Joint]:
    """Return [u, y] of each experiment, (N_i, nu + ny), refusing constant channels."""
    if reason := constant(experiments):
        raise ExciteError(reason)
    return [Joint((e.u, e.y)) for e in experiments]


def compress(experiments: tuple[Experiment, ...], past: int, future: int) -> PastFuture:
    """Compress past + future block rows of all experiments (each a segment; no column crosses a seam).

    The factor's rows are in the order [U_f; U_p; Y_p; Y_f], from which the open-loop methods start.

    Raises ExciteError when the future inputs are not of full row rank, naming the order of persistency found and needed.
    """
    segments, nu, end = joint_segments(experiments), len(experiments[0].inputs), past + future
    u, y = (partial(block_rows, segments[0].shape[1], channels) for channels in (slice(0, nu), slice(nu, None)))
    order = np.concatenate([u(past, end), u(0, past), y(0, past), y(past, end)])
    data = PastFuture(hankel_factor(segments, end, order), experiments, past, future)
    require_excitation(data, past, past + future, "future rows")
    return data


def require_excitation(data: PastFuture, start: int, stop: int, what: str) -> None:
    """Refuse inputs whose block rows start:stop are not of full row rank, naming `what` they are."""
    rows = data.u(start, stop)
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    _, singular = left_svd(rows / np.where(norms > 0, norms, 1.0))
    if singular[-1] < RANK_TOLERANCE * singular[0]:
        needed = stop - start
        found = certify(data.experiments, block_rows=needed).order
        raise ExciteError(
            f"the input is persistently exciting of order {found}, but {needed} {what} need order {needed}; "
            "excite more frequencies, or shorten the horizon"
        )


def lq(*groups: np.ndarray) -> list[list[np.ndarray]]:
    """LQ decomposition of stacked row groups: blocks L[i][j] with group_i = sum_j L[i][j] Q_j, Kee (2013), eq. (3.16)."""
    L = lower_factor(np.vstack(groups))
    cuts = [slice(a, b) for a, b in pairwise(_edges(groups))]
    return [[L[i, j] for j in cuts] for i in cuts]


@dataclass(frozen=True, eq=False)
class FutureLq:
    """[U_f; U_p; Y_p; Y_f] = L Q, what the open-loop methods start from; `edges` are the ends of the four row groups."""

    L: np.ndarray
    edges: tuple[int, ...]

    def groups(self, start: int, stop: int) -> slice:
        """Rows, or columns, of groups start:stop."""
        return slice(self.edges[start], self.edges[stop])

    @cached_property
    def on_past(self) -> np.ndarray:
        """Coefficients of [U_p; Y_p] in the regression of Y_f on them and U_f: the oblique projection Y_f /_(U_f) Z_p."""
        known, future = self.groups(0, 3), self.groups(3, 4)
        return solve_lower(self.L[known, known], self.L[future, known])[:, self.groups(1, 3)]


def future_lq(data: PastFuture) -> FutureLq:
    """The factor that `compress` made, as the open-loop methods read it."""
    past, future = data.past, data.future
    edges = accumulate([future * data.nu, past * data.nu, past * data.ny, future * data.ny], initial=0)
    return data.once("future lq", lambda data: FutureLq(data.factor.L, tuple(edges)))


def _edges(groups: Sequence[np.ndarray]) -> tuple[int, ...]:
    return tuple(accumulate(map(len, groups), initial=0))


def lower_factor(rows: np.ndarray) -> np.ndarray:
    """L of rows = L Q, lower triangular (trapezoidal when there are more rows than columns)."""
    (R,) = la.qr(rows.T, mode="r", check_finite=False)
    return R[: R.shape[1]].T


def regress(target: np.ndarray, *regressors: np.ndarray) -> list[np.ndarray]:
    """Least-squares coefficients of the rows of `target` on stacked regressor rows, one block a group.

    Minimum-norm where the regressors are dependent (noise-free data).
    """
    stacked = np.vstack(regressors)
    r = len(stacked)
    L = lower_factor(np.vstack([stacked, target]))
    coefficients = solve_lower(L[:r, :r], L[r:, :r])
    return [coefficients[:, a:b] for a, b in pairwise(_edges(regressors))]


def solve_lower(L: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return X with X L = target for lower triangular L, of least norm where L is singular to rounding."""
    if L.shape[0] == L.shape[1] and condition_of(L) < 1 / RANK:
        return la.solve_triangular(L, target.T, lower=True, trans="T", check_finite=False).T
    scale = np.linalg.norm(L, axis=1)
    scale[scale == 0] = 1.0
    return la.lstsq((L / scale[:, None]).T, target.T, cond=RANK, check_finite=False)[0].T / scale


def left_svd(M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left singular vectors and singular values of M, largest first.

    From the eigenvectors of M M^T, which take a third of the time; by SVD where the condition is too large for squares,
    as for the Gram form of the data.
    """
    squares, vectors = np.linalg.eigh(M @ M.T)  # divide and conquer
    if squares[0] * GRAM_CONDITION**2 > squares[-1]:
        return vectors[:, ::-1], np.sqrt(squares[::-1])
    left, values, _ = la.svd(M, full_matrices=False, check_finite=False)
    return left, values


def orthonormal(Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return W and Q = W Z with orthonormal rows spanning those of Z."""
    scale = np.linalg.norm(Z, axis=1)
    scale[scale == 0] = 1.0
    left, s, right = la.svd(Z / scale[:, None], full_matrices=False, check_finite=False)
    keep = s > RANK * s[0]
    return (left[:, keep] / s[keep]).T / scale, right[keep]
