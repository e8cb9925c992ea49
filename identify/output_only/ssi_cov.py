"""SSI-COV: stochastic subspace identification from output covariances."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.estimate import Estimate
from identify.output_only.output_only import OutputOnlyMethod
from identify.steps.compression import joint_segments
from identify.steps.covariance import cross_covariance
from identify.steps.hankel_svd import HankelSvd, hankel_of, hankel_svd, onto
from identify.steps.shift import Shift


@dataclass(frozen=True, eq=False)
class OutputCovariances:
    """R (2 r + 1, ny, ny) over all records, R(0) first, and the SVD of its Hankel matrix."""

    experiments: tuple[Experiment, ...]
    R: np.ndarray
    svd: HankelSvd


@dataclass(frozen=True)
class SsiCov(OutputOnlyMethod):
    """Covariance-driven stochastic subspace identification (Van Overschee and De Moor 1996, ch. 3; Peeters and De Roeck 1999).

    R(tau) = E y(t + tau) y(t)^T = C A^(tau - 1) G for tau > 0, with G = E x(t + 1) y(t)^T: an impulse response, realized
    from r by r blocks and the same one lag later. K and the innovation covariance solve the Riccati equation of
    A, G, C, R(0). Poles and shapes need no positive realness; K does, and is left out with a warning where it is missing.
    """

    name: ClassVar[str] = "ssi_cov"
    summary: ClassVar[str] = "output only: realization of output covariances"

    def singular_values(self, factor: OutputCovariances) -> np.ndarray:
        """Return those of the covariances' Hankel matrix."""
        return factor.svd.values

    def compress(self, data: Records) -> OutputCovariances:
        """Covariances to lag 2 r."""
        parts = data.parts(self.span(1))
        segments = joint_segments(parts)
        R = cross_covariance([(y, y) for y in segments], 0, 2 * self.block_rows)
        return OutputCovariances(parts, R, hankel_svd(R[1:-1], self.block_rows))

    def realize(self, factor: OutputCovariances, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        H = factor.svd
        shift = Shift.of_pair(H, hankel_of(factor.R[2:], self.block_rows), order)
        A, notes = self.dynamics(shift)
        G = onto(A, shift.C, factor.R[1:]) if notes else H.delta(order)[:, : H.m]
        noise = np.zeros((order, order)), factor.R[0], G
        return self.completed(
            factor.experiments, A, shift.C, noise, notes, singular_values=H.values, route="covariances"
        )
