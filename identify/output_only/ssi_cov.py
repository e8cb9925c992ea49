"""SSI-COV: stochastic subspace identification from output covariances."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.types.experiment import Experiment
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.method import Data, experiments, order_or_gap
from identify.output_only.output_only import OutputOnlyMethod, noise_model, output_only_estimate
from identify.steps.compression import joint_segments
from identify.steps.covariance import cross_covariance
from identify.steps.hankel_svd import HankelSvd, era, hankel_of, hankel_svd


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

    def prepare(self, data: Data) -> OutputCovariances:
        """Covariances to lag 2 r."""
        data = gap_free(experiments(data), self.span(1)).parts
        segments = joint_segments(data)
        R = cross_covariance([(y, y) for y in segments], 0, 2 * self.block_rows)
        return OutputCovariances(data, R, hankel_svd(R[1:-1], self.block_rows))

    def realize(self, factor: OutputCovariances, order: int | None) -> Estimate:
        """Return the model of one order."""
        values = factor.svd.values
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        A, G, C = era(factor.svd, hankel_of(factor.R[2:], self.block_rows), n)
        model, more = noise_model(factor.experiments[0], A, C, np.zeros((n, n)), factor.R[0], G)
        return output_only_estimate(self.name, model, factor.experiments, values, warnings + more, path="covariances")
