"""IEM: innovation estimation method, for closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import scipy.linalg as la

from identify.steps.compression import PastFuture
from identify.subspace.row_by_row import causal_lq, coefficients_on
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod


@dataclass(frozen=True)
class Iem(TwoHorizonMethod):
    """Innovation estimation (Qin and Ljung 2003), Kee (2013), section 3.2.

    Row by row, Y_fi = Gamma_fi L_p Z_p + H_fi U_(i-1) + G_fi E_(i-1) + E_fi by least squares (3.31), each residual E_fi
    becoming a regressor of the next rows. All f regressions are one triangular solve in the LQ factor of
    [Z_p; Y_1; U_1; Y_2; U_2; …], because E_i is the part of Y_i that its predecessors leave. The SVD of Gamma_f L_p is
    weighted by Z_p (print omits it in (3.32); without it the method fails on integrating plants).

    past, future : horizons p, f.
    """

    name: ClassVar[str] = "iem"
    summary: ClassVar[str] = "innovation estimation; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of Gamma_f L_p Z_p."""
        L, outputs = causal_lq(factor, self.feedthrough)
        M = L.copy()
        for block in outputs:  # E_i keeps only its own columns of Y_i
            M[block, : block[0]] = 0
        z = len(factor.z())
        on_past = coefficients_on(M, L[outputs.ravel()])[:, :z]
        left, values, _ = la.svd(on_past @ L[:z, :z], full_matrices=False, check_finite=False)
        return Subspace.of_gamma(left, values, on_past)
