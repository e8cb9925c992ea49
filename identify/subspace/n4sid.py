"""N4SID and CVA: the oblique-projection methods of the unifying theorem, for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError, did_you_mean
from identify.estimate import Estimate
from identify.ground.compression import PastFuture, lq, orthonormal, regress
from identify.ground.kalman import state_regression
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import TwoHorizonMethod

WEIGHTS = ("n4sid", "moesp", "cva")


@dataclass(frozen=True)
class N4sid(TwoHorizonMethod):
    """N4SID with the weights of the unifying theorem (Van Overschee and De Moor 1994, 1995; seed 000 chapter 3).

    O = Y_f /_(U_f) Z_p is the part of the future outputs that the past explains along the future inputs; the SVD of
    W1 O W2 gives the state X = J Z_p, with W1 = I, W2 = I ("n4sid"), W1 = I, W2 = Pi_(U_f)^perp ("moesp"), or
    W1 = (Y_f Pi Y_f^T)^(-1/2), W2 = Pi ("cva"). A, C, K by regression on the state, B, D, x0 on all samples.

    past, future : horizons; weight : "n4sid", "moesp" or "cva"; feedthrough : estimate D (else zero).
    """

    name: ClassVar[str] = "n4sid"
    summary: ClassVar[str] = "oblique projection with the weights of the unifying theorem; open loop"
    closed_loop: ClassVar[bool] = False

    weight: str = "n4sid"
    feedthrough: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.weight not in WEIGHTS:
            raise ExciteError(f"{self.name}.weight: {self.weight!r}; {did_you_mean(str(self.weight), WEIGHTS)}")

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        p, f, nu, ny = self.past, self.future, factor.nu, factor.ny
        U, Y, Z = factor.u(p, p + f), factor.y(p, p + f), factor.z()
        oblique = regress(Y, Z, U)[0]
        L = lq(U, Z, Y)
        seen = Z if self.weight == "n4sid" else L[1][1]
        if self.weight == "cva":
            oblique = orthonormal(np.hstack(L[2][1:]))[0] @ oblique
        left, values, _ = la.svd(oblique @ seen, full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        to_state = left[:, :n].T @ oblique
        A, C, K, E = state_regression(to_state @ Z, to_state @ factor.z(1), U[:nu], Y[:ny], self.feedthrough)
        closed = any(e.loop.closed for e in factor.experiments)
        return complete(
            self.name, factor, A, C, K, E, feedthrough=self.feedthrough, predictor=closed, singular_values=values,
            warnings=warnings,
        )  # fmt: skip


@dataclass(frozen=True)
class Cva(N4sid):
    """N4SID with the canonical-variate weight (Larimore 1990)."""

    name: ClassVar[str] = "cva"
    summary: ClassVar[str] = "canonical variate analysis: N4SID with its weight; open loop"

    weight: str = "cva"
