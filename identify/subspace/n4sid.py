"""N4SID and CVA: the oblique-projection methods of the unifying theorem, for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError, did_you_mean
from identify.estimate import Estimate
from identify.method import order_or_gap
from identify.steps.compression import PastFuture, future_lq, orthonormal
from identify.subspace.realize import complete
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod
from identify.subspace.system_equations import gain_of, system_equations

WEIGHTS = ("n4sid", "moesp", "cva")
ALGORITHMS = ("states", "robust")


@dataclass(frozen=True)
class N4sid(TwoHorizonMethod):
    """N4SID with the weights of the unifying theorem (Van Overschee and De Moor 1994, 1995; seed 000 chapter 3).

    O = Y_f /_(U_f) Z_p is the part of the future outputs that the past explains along the future inputs; the SVD of
    W1 O W2 gives the state X = J Z_p, with W1 = I, W2 = I ("n4sid"), W1 = I, W2 = Pi_(U_f)^perp ("moesp"), or
    W1 = (Y_f Pi Y_f^T)^(-1/2), W2 = Pi ("cva").

    past, future : horizons; weight : "n4sid", "moesp" or "cva"; algorithm : "states", A, C, K by regression on the state,
    B, D, x0 on all samples; "robust", all but x0 from the projected equations (Van Overschee and De Moor 1996, chapter 4,
    robust combined algorithm), K by Riccati equation. weight "moesp" with "robust" is the combined method of SLICOT's
    IB01BD and Octave's moen4.
    """

    name: ClassVar[str] = "n4sid"
    summary: ClassVar[str] = "oblique projection with the weights of the unifying theorem; open loop"
    closed_loop: ClassVar[bool] = False

    feedthrough: bool = True
    weight: str = "n4sid"
    algorithm: str = "states"

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, known in (("weight", WEIGHTS), ("algorithm", ALGORITHMS)):
            value = getattr(self, key)
            if value not in known:
                raise ExciteError(f"{self.name}.{key}: {value!r}; {did_you_mean(str(value), known)}")

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of the weighted oblique projection."""
        data = future_lq(factor)
        past, future = data.groups(1, 3), data.groups(3, 4)
        seen = data.L[past] if self.weight == "n4sid" else data.L[past, past]
        whitening = coloring = np.eye(len(data.on_past))
        if self.weight == "cva":
            free = data.L[future, data.groups(1, 4)]
            whitening, basis = orthonormal(free)
            coloring = free @ basis.T  # inverse of the whitening where there is anything to whiten
        left, values, _ = la.svd(whitening @ data.on_past @ seen, full_matrices=False, check_finite=False)
        gamma = coloring @ left if self.algorithm == "robust" else None
        return Subspace(values, left.T @ whitening, data.on_past, gamma)

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        if self.algorithm == "states":
            return super().realize(factor, order)
        found = self.found(factor)
        n, warnings = order_or_gap(order, found.values, self.largest_order(factor.experiments))
        solved = system_equations(factor, found.gamma[:, :n], self.feedthrough)
        A, guarded = self.guard(solved.A, solved.C, self.future)
        K, E = gain_of(A, solved, factor)
        return complete(
            self.name,
            factor,
            A,
            solved.C,
            K,
            E,
            feedthrough=self.feedthrough,
            predictor=self.uses_predictor(factor),
            singular_values=found.values,
            warnings=warnings + guarded,
            fitted=None if guarded else (solved.B, solved.D),
        )


@dataclass(frozen=True)
class Cva(N4sid):
    """N4SID with the canonical-variate weight (Larimore 1990).

    weight, algorithm : as for n4sid.
    """

    name: ClassVar[str] = "cva"
    summary: ClassVar[str] = "canonical variate analysis: N4SID with its weight; open loop"

    weight: str = "cva"
