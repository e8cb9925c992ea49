"""Past-future data compressed into one triangular factor, from which every subspace method takes its rows."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.hankel import HankelFactor, hankel_factor
from excite.persistency import RANK_TOLERANCE, certify
from excite.types.experiment import Experiment


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

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return self.experiments[0].u.shape[1]

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return self.experiments[0].y.shape[1]

    def u(self, start: int, stop: int) -> np.ndarray:
        """Input rows of block rows start:stop."""
        return self.factor.L[self.factor.index(slice(0, self.nu), start, stop)]

    def y(self, start: int, stop: int) -> np.ndarray:
        """Output rows of block rows start:stop."""
        return self.factor.L[self.factor.index(slice(self.nu, None), start, stop)]

    def z(self, shift: int = 0) -> np.ndarray:
        """Z_p = [U_p; Y_p], the past of block row past + shift."""
        return np.vstack([self.u(shift, shift + self.past), self.y(shift, shift + self.past)])


def joint_segments(experiments: tuple[Experiment, ...]) -> list[np.ndarray]:
    """Return [u, y] of each experiment, (N_i, nu + ny), refusing constant channels."""
    segments = [np.hstack([e.u, e.y]) for e in experiments]
    low, high = (f(np.array([f(w, axis=0) for w in segments]), axis=0) for f in (np.min, np.max))
    inputs, outputs = experiments[0].inputs, experiments[0].outputs
    for i in np.flatnonzero(low == high):
        if i < len(inputs):
            raise ExciteError(
                f"input '{inputs[i].name}' is constant ({low[i]:g}), so it is persistently exciting of order "
                f"{int(low[i] != 0)} only; excite it or drop the channel"
            )
        raise ExciteError(f"output '{outputs[i - len(inputs)].name}' is constant ({low[i]:g}); drop the channel")
    return segments


def compress(experiments: tuple[Experiment, ...], past: int, future: int) -> PastFuture:
    """Compress past + future block rows of all experiments (each a segment; no column crosses a seam).

    Raises ExciteError when the future inputs are not of full row rank, naming the order of persistency found and needed.
    """
    data = PastFuture(hankel_factor(joint_segments(experiments), past + future), experiments, past, future)
    future_inputs = data.u(past, past + future)
    singular = la.svdvals(future_inputs / np.linalg.norm(future_inputs, axis=1, keepdims=True))
    if singular[-1] < RANK_TOLERANCE * singular[0]:
        found = certify(experiments, block_rows=future).order
        raise ExciteError(
            f"the input is persistently exciting of order {found}, but {future} future rows need order {future}; "
            "excite more frequencies, or shorten the future horizon"
        )
    return data


def lq(*groups: np.ndarray) -> list[list[np.ndarray]]:
    """LQ decomposition of stacked row groups: blocks L[i][j] with group_i = sum_j L[i][j] Q_j, seed 000 eq. (3.16)."""
    (R,) = la.qr(np.vstack(groups).T, mode="r", check_finite=False)
    L = R[: R.shape[1]].T
    edges = np.cumsum([0] + [len(g) for g in groups])
    cuts = [slice(a, b) for a, b in pairwise(edges)]
    return [[L[i, j] for j in cuts] for i in cuts]


def regress(target: np.ndarray, *regressors: np.ndarray) -> list[np.ndarray]:
    """Least-squares coefficients of the rows of `target` on stacked regressor rows, one block a group.

    Minimum-norm where the regressors are dependent (noise-free data).
    """
    stacked = np.vstack(regressors)
    scale = np.linalg.norm(stacked, axis=1)
    scale[scale == 0] = 1.0
    solution = la.lstsq((stacked / scale[:, None]).T, target.T, cond=1e-11, check_finite=False)[0].T / scale
    edges = np.cumsum([0] + [len(r) for r in regressors])
    return [solution[:, a:b] for a, b in pairwise(edges)]


def orthonormal(Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return W and Q = W Z with orthonormal rows spanning those of Z."""
    scale = np.linalg.norm(Z, axis=1)
    scale[scale == 0] = 1.0
    left, s, right = la.svd(Z / scale[:, None], full_matrices=False, check_finite=False)
    keep = s > 1e-11 * s[0]
    return (left[:, keep] / s[keep]).T / scale, right[keep]
