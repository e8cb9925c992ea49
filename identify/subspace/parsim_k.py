"""PARSIM-K: parsimonious predictor form, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from identify.steps.compression import PastFuture, regress
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod


@dataclass(frozen=True)
class ParsimK(TwoHorizonMethod):
    """Parsimonious subspace identification in predictor form (Pannocchia and Calosi 2010).

    Row i of the future, Y_i = C Ak^(i-1) L_p Z_p + sum_(k<i) C Ak^(i-1-k) [B - K D, K] [U_k; Y_k] + E_i, holds one block of
    Markov parameters that the rows before it did not: only that block and Gamma_i L_p are estimated, so the model stays
    causal. The SVD of Gamma L_p, weighted by Z_p, gives the state; A, C, K by regression, B, D, x0 through the predictor.

    past, future : horizons p, f.
    """

    name: ClassVar[str] = "parsim_k"
    summary: ClassVar[str] = "parsimonious predictor form; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of Gamma L_p Z_p."""
        p, f, nu, ny = self.past, self.future, factor.nu, factor.ny
        Z, rows = factor.z(), []
        pairs: list[np.ndarray] = []
        markov: list[np.ndarray] = []
        for i in range(f):
            u, y = factor.u(p + i, p + i + 1), factor.y(p + i, p + i + 1)
            known = sum((m @ w for m, w in zip(markov, reversed(pairs[1:]), strict=True)), np.zeros_like(y))
            if i == 0:
                fitted = regress(y, *([Z, u] if self.feedthrough else [Z]))
                D = fitted[1] if self.feedthrough else np.zeros((ny, nu))
            else:
                fitted = regress(y - D @ u - known, Z, pairs[0])
                markov.append(fitted[1])
            rows.append(fitted[0])
            pairs.append(np.vstack([u, y]))
        return Subspace.of_states(np.vstack(rows) @ Z, Z)
