"""IEM: innovation estimation method, for closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.estimate import Estimate
from identify.ground.compression import PastFuture
from identify.ground.kalman import state_regression
from identify.ground.shift_invariance import shift_invariance
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import TwoHorizonMethod


@dataclass(frozen=True)
class Iem(TwoHorizonMethod):
    """Innovation estimation (Qin and Ljung 2003), seed 000 section 3.2.

    Row by row, Y_fi = Gamma_fi L_p Z_p + H_fi U_(i-1) + G_fi E_(i-1) + E_fi by least squares (3.31), each residual E_fi
    becoming a regressor of the next rows. All f regressions are one triangular solve in the LQ factor of
    [Z_p; Y_1; U_1; Y_2; U_2; …], because E_i is the part of Y_i that its predecessors leave. The SVD of Gamma_f L_p is
    weighted by Z_p (print omits it in (3.32); without it the method fails on integrating plants).

    past, future : horizons p, f; feedthrough : allow D, for loops whose controller has a delay.
    """

    name: ClassVar[str] = "iem"
    summary: ClassVar[str] = "innovation estimation; open and closed loop"
    closed_loop: ClassVar[bool] = True

    feedthrough: bool = False

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        p, f, ny = self.past, self.future, factor.ny
        Z = factor.z()
        rows, is_output = [Z], [np.zeros(len(Z), bool)]
        for k in range(p, p + f):
            pair = [(factor.y(k, k + 1), True), (factor.u(k, k + 1), False)]
            for block, output in reversed(pair) if self.feedthrough else pair:
                rows.append(block)
                is_output.append(np.full(len(block), output))
        is_output = np.concatenate(is_output)
        (R,) = la.qr(np.vstack(rows).T, mode="r", check_finite=False)
        L = R.T
        M = L.copy()
        positions = np.flatnonzero(is_output).reshape(f, ny)
        for block in positions:  # E_i keeps only its own columns of Y_i
            M[block, : block[0]] = 0
        pivot = np.abs(np.diag(M))
        tiny = pivot < 1e-12 * np.linalg.norm(L, axis=1).max()
        M[tiny, tiny.nonzero()[0]] = np.inf
        coefficients = la.solve_triangular(M, L[positions.ravel()].T, lower=True, trans="T", check_finite=False).T
        observed = coefficients[:, : len(Z)] @ L[: len(Z), : len(Z)]
        left, values, _ = la.svd(observed, full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        gamma = left[:, :n] * np.sqrt(values[:n])
        A, C = shift_invariance(gamma, ny)
        to_state = la.lstsq(gamma, coefficients[:, : len(Z)])[0]
        X, X_next = to_state @ Z, to_state @ factor.z(1)
        _, _, K, E = state_regression(X, X_next, factor.u(p, p + 1), factor.y(p, p + 1), self.feedthrough)
        return complete(
            self.name, factor, A, C, K, E, feedthrough=self.feedthrough, predictor=True, singular_values=values,
            warnings=warnings,
        )  # fmt: skip
