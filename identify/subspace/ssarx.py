"""SSARX: state-space ARX, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.steps.compression import PastFuture, orthonormal
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod
from identify.subspace.varx import varx


@dataclass(frozen=True)
class Ssarx(TwoHorizonMethod):
    """SSARX (Jansson 2003): a high-order ARX model, then canonical correlations of future and past.

    The ARX coefficients are the predictor's Markov parameters C Ak^(i-1) [B - K D, K]; their Toeplitz products with
    the future inputs and outputs are removed, Y~ = Y_f - H~u U_f - H~y Y_f = Gamma(Ak, C) X + E_f, and the canonical
    correlations of Y~ and Z_p give the state X = J Z_p. A, C, K by regression on the state, B, D, x0 through the
    one-step predictor.

    past : ARX order and past horizon p; future : f.
    """

    name: ClassVar[str] = "ssarx"
    summary: ClassVar[str] = "state-space ARX with canonical correlations; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    def decompose(self, factor: PastFuture) -> Subspace:
        """Canonical correlations of Y~ and Z_p."""
        p, f, ny = self.past, self.future, factor.ny
        Z, U, Y = factor.z(), factor.u(p, p + f), factor.y(p, p + f)
        arx = varx(factor, self.feedthrough)
        Hu = _toeplitz(np.concatenate([arx.D[None], arx.on_u]), f)
        Hy = _toeplitz(np.concatenate([np.zeros((1, ny, ny)), arx.on_y]), f)
        past, past_basis = orthonormal(Z)
        _, future_basis = orthonormal(Y - Hu @ U - Hy @ Y)
        _, values, right = la.svd(future_basis @ past_basis.T, full_matrices=False, check_finite=False)
        return Subspace(values, right @ past)


def _toeplitz(blocks: np.ndarray, f: int) -> np.ndarray:
    """Lower block-Toeplitz (f ny, f m) with blocks[i] on the i-th subdiagonal, zero beyond the last block."""
    ny, m = blocks.shape[1:]
    padded = np.concatenate([np.zeros((f - 1, ny, m)), blocks[:f], np.zeros((max(0, f - len(blocks)), ny, m))])
    lag = np.arange(f)[:, None] - np.arange(f)[None, :] + f - 1
    return padded[lag].transpose(0, 2, 1, 3).reshape(f * ny, f * m)
