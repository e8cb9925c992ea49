"""PO-MOESP: past-output MOESP, for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.estimate import Estimate
from identify.ground.compression import PastFuture, lq, regress
from identify.ground.kalman import state_regression
from identify.ground.shift_invariance import shift_invariance
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import SubspaceMethod


@dataclass(frozen=True)
class PoMoesp(SubspaceMethod):
    """Past-output MOESP (Verhaegen 1994) in the LQ form of seed 000, eq. (3.16)-(3.17).

    [U_f; U_p; Y_p; Y_f] = L Q over N - 2 s + 1 columns; range [L42 L43] = range Gamma_f by SVD, A and C by shift
    invariance, B, D and x0 by least squares on all samples (simulation; one-step predictor when the data are from a
    closed loop). Biased in closed loop: there u is correlated with past noise.

    block_rows : s, rows of past and of future each; feedthrough : estimate D (else zero).
    """

    name: ClassVar[str] = "po_moesp"
    summary: ClassVar[str] = "past-output MOESP; open loop"
    closed_loop: ClassVar[bool] = False

    block_rows: int = 20
    feedthrough: bool = True

    def horizons(self) -> tuple[int, int]:
        """(s, s)."""
        return self.block_rows, self.block_rows

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        s, ny = self.block_rows, factor.ny
        U_f, Y_f = factor.u(s, 2 * s), factor.y(s, 2 * s)
        L = lq(U_f, factor.u(0, s), factor.y(0, s), Y_f)
        left, values, _ = la.svd(np.hstack([L[3][1], L[3][2]]), full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        gamma = left[:, :n] * np.sqrt(values[:n])
        A, C = shift_invariance(gamma, ny)
        to_state = la.lstsq(gamma, regress(Y_f, factor.z(), U_f)[0])[0]
        X, X_next = to_state @ factor.z(), to_state @ factor.z(1)
        _, _, K, E = state_regression(X, X_next, factor.u(s, s + 1), factor.y(s, s + 1), self.feedthrough)
        closed = any(e.loop.closed for e in factor.experiments)
        return complete(
            self.name, factor, A, C, K, E, feedthrough=self.feedthrough, predictor=closed, singular_values=values,
            warnings=warnings,
        )  # fmt: skip
