"""SSI-DATA: stochastic subspace identification from the outputs themselves."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.numerics.hankel import hankel_factor
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.method import Data, experiments, order_or_gap
from identify.output_only.output_only import OutputOnlyMethod, noise_model, output_only_estimate
from identify.steps.compression import PastFuture, joint_segments, lq, regress
from identify.steps.shift import shift_invariance


@dataclass(frozen=True)
class SsiData(OutputOnlyMethod):
    """Data-driven stochastic subspace identification (Van Overschee and De Moor 1996, ch. 3; Peeters and De Roeck 1999).

    The projection of the future outputs on the past ones, Y_f / Y_p = Gamma X, is taken from the LQ factor of the
    compressed outputs; its SVD (unweighted principal components) gives Gamma, A and C by shift invariance. The residuals
    of the state sequences have the noise covariances, whose Kalman gain is K.
    """

    name: ClassVar[str] = "ssi_data"
    summary: ClassVar[str] = "output only: projection of future on past outputs"

    def prepare(self, data: Data) -> PastFuture:
        """Compress past and future outputs."""
        data, r = gap_free(experiments(data), self.span(1)).parts, self.block_rows
        return PastFuture(hankel_factor(joint_segments(data), 2 * r), data, r, r)

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        r, ny = self.block_rows, factor.ny
        past, future = factor.y(0, r), factor.y(r, 2 * r)
        left, values, _ = la.svd(lq(past, future)[1][0], full_matrices=False, check_finite=False)
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        gamma = left[:, :n] * np.sqrt(values[:n])
        A, C = shift_invariance(gamma, ny)
        to_state = la.lstsq(gamma, regress(future, past)[0], check_finite=False)[0]
        X, X_next = to_state @ past, to_state @ factor.y(1, r + 1)
        residual = np.vstack([X_next - A @ X, future[:ny] - C @ X])
        cov = residual @ residual.T / factor.factor.columns
        model, more = noise_model(factor.experiments[0], A, C, cov[:n, :n], cov[n:, n:], cov[:n, n:])
        return output_only_estimate(
            self.name,
            model,
            factor.experiments,
            values,
            warnings + more,
            path=factor.factor.path,
            condition=factor.factor.condition,
        )
