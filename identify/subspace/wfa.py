"""WFA: whitening filter approach, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from identify.steps.compression import PastFuture
from identify.subspace.row_by_row import causal_lq, coefficients_on
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod


@dataclass(frozen=True)
class Wfa(TwoHorizonMethod):
    """Whitening filter approach (Chiuso and Picci 2005), the predictor-based method before its optimisation (`pbsid`).

    Row by row of the predictor form, Y_fi = C Ak^(i-1) L_p Z_p + sum_(k<i) C Ak^(i-1-k) [B - K D, K] [U_k; Y_k] + E_fi by
    least squares on the past and on all earlier rows, each row with coefficients of its own. All f regressions are one
    triangular solve in the LQ factor of [Z_p; Y_1; U_1; Y_2; U_2; …]. The SVD of Gamma(Ak, C) L_p Z_p gives the state;
    A, C, K by regression on it, B, D, x0 through the one-step predictor.

    past, future : horizons p, f.
    """

    name: ClassVar[str] = "wfa"
    summary: ClassVar[str] = "whitening filter approach, predictor form row by row; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of Gamma L_p Z_p."""
        L, outputs = causal_lq(factor, self.feedthrough)
        fitted = L[outputs.ravel()]
        fitted[np.arange(L.shape[1]) >= outputs[:, :1].repeat(factor.ny, axis=0)] = 0  # the innovation's columns
        observed = coefficients_on(L, fitted)[:, : len(factor.z())]
        return Subspace.of_states(observed @ factor.z(), factor.z())
