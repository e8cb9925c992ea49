"""PBSID: predictor-based subspace identification, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from identify.steps.compression import PastFuture
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod
from identify.subspace.varx import varx


@dataclass(frozen=True)
class Pbsid(TwoHorizonMethod):
    """Optimised predictor-based subspace identification (Chiuso and Picci 2005, Chiuso 2007), the heir of `wfa`.

    The coefficients of a high-order ARX model are C Ak^(i-1) [B - K D, K]; shifted to the past one block per row and
    filled with zeros they are Gamma(Ak, C) L_p up to Ak^p. The SVD of Gamma L_p Z_p gives the state; A, C, K by
    regression on it, B, D, x0 through the one-step predictor.

    past : ARX order and past horizon p; future : f, at most p.
    """

    name: ClassVar[str] = "pbsid"
    summary: ClassVar[str] = "optimised predictor-based subspace identification; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of Gamma L_p Z_p."""
        theta, Z = varx(factor, self.feedthrough).theta, factor.z()
        rows = [_shifted(theta, i, self.past, factor.nu, factor.ny) for i in range(min(self.future, self.past))]
        return Subspace.of_states(np.vstack(rows) @ Z, Z)


def _shifted(theta: np.ndarray, i: int, p: int, nu: int, ny: int) -> np.ndarray:
    """ARX row whose coefficient of lag k is C Ak^(k-1+i) [B - K D, K], from one that starts at i = 0."""
    row = np.zeros_like(theta)
    row[:, i * nu : p * nu] = theta[:, : (p - i) * nu]
    row[:, p * nu + i * ny :] = theta[:, p * nu : p * nu + (p - i) * ny]
    return row
