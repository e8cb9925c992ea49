"""PBSID: predictor-based subspace identification, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.estimate import Estimate
from identify.ground.compression import PastFuture, regress
from identify.ground.kalman import state_regression
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import TwoHorizonMethod


@dataclass(frozen=True)
class Pbsid(TwoHorizonMethod):
    """Optimised predictor-based subspace identification (Chiuso and Picci 2005, Chiuso 2007), the whitening filter's heir.

    The coefficients of a high-order ARX model are C Ak^(i-1) [B - K D, K]; shifted to the past one block a row and
    filled with zeros they are Gamma(Ak, C) L_p up to Ak^p. The SVD of Gamma L_p Z_p gives the state; A, C, K by
    regression on it, B, D, x0 through the one-step predictor.

    past : ARX order and past horizon p; future : f, at most p; feedthrough : allow D (the controller needs a delay).
    """

    name: ClassVar[str] = "pbsid"
    summary: ClassVar[str] = "optimised predictor-based subspace identification; open and closed loop"
    closed_loop: ClassVar[bool] = True

    feedthrough: bool = False

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        p, f, nu, ny = self.past, min(self.future, self.past), factor.nu, factor.ny
        Z, U, Y = factor.z(), factor.u(p, p + 1), factor.y(p, p + 1)
        theta = regress(Y, *([Z, U] if self.feedthrough else [Z]))[0]
        observed = np.vstack([_shifted(theta, i, p, nu, ny) for i in range(f)])
        _, values, right = la.svd(observed @ Z, full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        to_state = regress(np.sqrt(values[:n])[:, None] * right[:n], Z)[0]
        A, C, K, E = state_regression(to_state @ Z, to_state @ factor.z(1), U, Y, self.feedthrough)
        return complete(
            self.name, factor, A, C, K, E, feedthrough=self.feedthrough, predictor=True, singular_values=values,
            warnings=warnings,
        )  # fmt: skip


def _shifted(theta: np.ndarray, i: int, p: int, nu: int, ny: int) -> np.ndarray:
    """ARX row whose coefficient of lag k is C Ak^(k-1+i) [B - K D, K], from one that starts at i = 0."""
    row = np.zeros_like(theta)
    row[:, i * nu : p * nu] = theta[:, : (p - i) * nu]
    row[:, p * nu + i * ny :] = theta[:, p * nu : p * nu + (p - i) * ny]
    return row
