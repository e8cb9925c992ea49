"""SSARX: state-space ARX, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.estimate import Estimate
from identify.ground.compression import PastFuture, orthonormal, regress
from identify.ground.kalman import state_regression
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import TwoHorizonMethod


@dataclass(frozen=True)
class Ssarx(TwoHorizonMethod):
    """SSARX (Jansson 2003): a high-order ARX model, then canonical correlations of future and past.

    The ARX coefficients are the predictor's Markov parameters C Ak^(i-1) [B - K D, K]; their Toeplitz products with
    the future inputs and outputs are removed, Y~ = Y_f - H~u U_f - H~y Y_f = Gamma(Ak, C) X + E_f, and the canonical
    correlations of Y~ and Z_p give the state X = J Z_p. A, C, K by regression on the state, B, D, x0 through the
    one-step predictor.

    past : ARX order and past horizon p; future : f; feedthrough : allow D (the controller then needs a delay).
    """

    name: ClassVar[str] = "ssarx"
    summary: ClassVar[str] = "state-space ARX with canonical correlations; open and closed loop"
    closed_loop: ClassVar[bool] = True

    feedthrough: bool = False

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        p, f, ny, nu = self.past, self.future, factor.ny, factor.nu
        Z, U, Y = factor.z(), factor.u(p, p + f), factor.y(p, p + f)
        first = [Z, U[:nu]] if self.feedthrough else [Z]
        theta = regress(Y[:ny], *first)
        D = theta[1] if self.feedthrough else np.zeros((ny, nu))
        Hu = _toeplitz(np.concatenate([D[None], _newest_first(theta[0][:, : p * nu], p)]), f)
        Hy = _toeplitz(np.concatenate([np.zeros((1, ny, ny)), _newest_first(theta[0][:, p * nu :], p)]), f)
        future = Y - Hu @ U - Hy @ Y
        past, past_basis = orthonormal(Z)
        _, future_basis = orthonormal(future)
        _, values, right = la.svd(future_basis @ past_basis.T, full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        to_state = right[:n] @ past
        X, X_next = to_state @ Z, to_state @ factor.z(1)
        A, C, K, E = state_regression(X, X_next, U[:nu], Y[:ny], self.feedthrough)
        return complete(
            self.name, factor, A, C, K, E, feedthrough=self.feedthrough, predictor=True, singular_values=values,
            warnings=warnings,
        )  # fmt: skip


def _newest_first(coefficients: np.ndarray, p: int) -> np.ndarray:
    """Blocks (p, ny, m) of ARX coefficients, lag 1 first, from a row whose oldest lag stands first."""
    return coefficients.reshape(len(coefficients), p, -1).transpose(1, 0, 2)[::-1]


def _toeplitz(blocks: np.ndarray, f: int) -> np.ndarray:
    """Lower block-Toeplitz (f ny, f m) with blocks[i] on the i-th subdiagonal, zero beyond the last block."""
    ny, m = blocks.shape[1:]
    padded = np.concatenate([np.zeros((f - 1, ny, m)), blocks[:f], np.zeros((max(0, f - len(blocks)), ny, m))])
    lag = np.arange(f)[:, None] - np.arange(f)[None, :] + f - 1
    return padded[lag].transpose(0, 2, 1, 3).reshape(f * ny, f * m)
