"""N4SID and CVA: the oblique-projection methods of the unifying theorem, for open-loop data."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.data.records import Records
from identify.estimate import Estimate
from identify.steps.completion import Inputs
from identify.steps.compression import PastFuture, future_lq, orthonormal
from identify.steps.shift import Shift
from identify.subspace.subspace_method import Subspace, TwoHorizonMethod
from identify.subspace.system_equations import gain_of, system_equations

WEIGHTS = ("n4sid", "moesp", "cva")
ALGORITHMS = ("states", "robust")


@dataclass(frozen=True)
class N4sid(TwoHorizonMethod):
    """N4SID with the weights of the unifying theorem (Van Overschee and De Moor 1994, 1995; Kee 2013, chapter 3).

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

    feedthrough: bool = True
    weight: str = field(default="n4sid", metadata={"choices": WEIGHTS})
    algorithm: str = field(default="states", metadata={"choices": ALGORITHMS})

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of the weighted oblique projection."""
        data = future_lq(factor)
        past, future = data.groups(1, 3), data.groups(3, 4)
        seen = data.L[past] if self.weight == "n4sid" else data.L[past, past]
        whitening = colouring = np.eye(len(data.on_past))
        if self.weight == "cva":
            free = data.L[future, data.groups(1, 4)]
            whitening, basis = orthonormal(free)
            colouring = free @ basis.T  # inverse of the whitening where there is anything to whiten
        left, values, _ = la.svd(whitening @ data.on_past @ seen, full_matrices=False, check_finite=False)
        gamma = colouring @ left if self.algorithm == "robust" else None
        return Subspace(values, left.T @ whitening, data.on_past, gamma)

    def realize(self, factor: PastFuture, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        if self.algorithm == "states":
            return super().realize(factor, order, data)
        found = self.found(factor)
        solved = system_equations(factor, found.gamma[:, :order], self.feedthrough)
        A, notes = self.dynamics(Shift.of_states(solved.A, solved.C, solved.X, self.future))
        K, E = gain_of(A, solved, factor)
        inputs = None if notes else Inputs(solved.B, solved.D)
        return self.completed(factor, A, solved.C, K, E, found.values, inputs, warnings=notes)


@dataclass(frozen=True)
class Cva(N4sid):
    """N4SID with the canonical-variate weight (Larimore 1990).

    weight, algorithm : as for n4sid.
    """

    name: ClassVar[str] = "cva"
    summary: ClassVar[str] = "canonical variate analysis: N4SID with its weight; open loop"

    weight: str = field(default="cva", metadata={"choices": WEIGHTS})
