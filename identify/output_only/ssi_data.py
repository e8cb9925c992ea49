"""SSI-DATA: stochastic subspace identification from the outputs themselves."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.numerics.hankel import hankel_factor
from identify.data.records import Records
from identify.estimate import Estimate
from identify.output_only.output_only import OutputOnlyMethod
from identify.steps.compression import PastFuture, joint_segments, lq, regress
from identify.steps.shift import Shift


@dataclass(frozen=True)
class SsiData(OutputOnlyMethod):
    """Data-driven stochastic subspace identification (Van Overschee and De Moor 1996, ch. 3; Peeters and De Roeck 1999).

    The projection of the future outputs on the past ones, Y_f / Y_p = Gamma X, is taken from the LQ factor of the
    compressed outputs; its SVD (unweighted principal components) gives Gamma, A and C by shift invariance. The residuals
    of the state sequences have the noise covariances, whose Kalman gain is K.
    """

    name: ClassVar[str] = "ssi_data"
    summary: ClassVar[str] = "output only: projection of future on past outputs"

    def compress(self, data: Records) -> PastFuture:
        """Compress past and future outputs."""
        parts, r = data.parts(self.span(1)), self.block_rows
        return PastFuture(hankel_factor(joint_segments(parts), 2 * r), parts, r, r)

    def singular_values(self, factor: PastFuture) -> np.ndarray:
        """Return those of the projection."""
        return factor.once(self, self._projection)[1]

    def realize(self, factor: PastFuture, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        r, ny, n = self.block_rows, factor.ny, order
        past, future = factor.y(0, r), factor.y(r, 2 * r)
        left, values = factor.once(self, self._projection)
        gamma = left[:, :n] * np.sqrt(values[:n])
        shift = Shift.of_gamma(gamma, ny)
        A, notes = self.dynamics(shift)
        to_state = la.lstsq(gamma, regress(future, past)[0], check_finite=False)[0]
        X, X_next = to_state @ past, to_state @ factor.y(1, r + 1)
        residual = np.vstack([X_next - A @ X, future[:ny] - shift.C @ X])
        cov = residual @ residual.T / factor.factor.columns
        noise = cov[:n, :n], cov[n:, n:], cov[:n, n:]
        known = {"condition": factor.factor.condition, "route": factor.factor.path}
        return self.completed(factor.experiments, A, shift.C, noise, notes, singular_values=values, **known)

    def _projection(self, factor: PastFuture) -> tuple[np.ndarray, np.ndarray]:
        """Left singular vectors and singular values of Y_f / Y_p."""
        r = self.block_rows
        past, future = factor.y(0, r), factor.y(r, 2 * r)
        left, values, _ = la.svd(lq(past, future)[1][0], full_matrices=False, check_finite=False)
        return left, values
