"""Delta: the covariance of the parameters, carried to functions of the model by their derivatives."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Model, Parametric
from identify.uncertainty.uncertainty import Uncertainty

STEP = 1e-5  # of a parameter, in its standard deviations: small enough for first order, large enough for rounding


@dataclass(frozen=True, eq=False)
class Delta(Uncertainty):
    """First-order propagation cov f = F cov theta F^T, F = df / d theta by central differences.

    model : parametric, at the estimate; covariance : (p, p) of `model.theta()`, textbook or sandwich as `kind` says.
    """

    model: Parametric
    covariance: np.ndarray
    kind: str = "delta method"
    withheld: str | None = None

    def __post_init__(self) -> None:
        p = len(self.model.theta())
        if np.shape(self.covariance) != (p, p) or not np.isfinite(self.covariance).all():
            raise ExciteError(f"Delta.covariance: shape {np.shape(self.covariance)}; give ({p}, {p}), finite")

    def of(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Return the covariance (m, m) of a real function of the model.

        The differences are taken along the principal axes of the covariance, so that only directions in which the
        estimate scatters count (not, say, changes of a state basis).
        """
        theta = self.model.theta()
        variances, axes = np.linalg.eigh((self.covariance + self.covariance.T) / 2)
        keep = variances > 1e-14 * max(variances.max(initial=0), 0)
        columns = []
        for std, axis in zip(np.sqrt(variances[keep]), axes[:, keep].T, strict=True):
            step = max(STEP * std, 1e-9 * np.linalg.norm(theta) / np.sqrt(len(theta)))
            ahead, behind = (np.ravel(function(self.model.at(theta + s * step * axis))) for s in (1, -1))
            columns.append(std * (ahead - behind) / (2 * step))
        if not columns:
            return np.zeros((np.size(function(self.model)),) * 2)
        F = np.column_stack(columns)
        return F @ F.T
