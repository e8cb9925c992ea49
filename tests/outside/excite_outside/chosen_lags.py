"""A list as a setting: the lags that take part."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.models.polynomial import PolynomialModel
from identify.data.records import Records
from identify.estimate import Estimate
from identify.method import Method


@dataclass(frozen=True)
class ChosenLags(Method):
    """Least squares on chosen lags of outputs and inputs; it has no order."""

    name: ClassVar[str] = "chosen_lags"
    summary: ClassVar[str] = "ARX on the lags that are named"
    order_is: ClassVar[str | None] = None

    lags: tuple[int, ...] = field(default=(1, 2), metadata={"meaning": "lags of y and u, in samples"})

    def span(self, order: int | None) -> int:
        """The longest lag and the sample it explains."""
        return max(self.lags) + 1

    def realize(self, compressed: Records, order: None, data: Records) -> Estimate:
        """Return the model."""
        last, lags = max(self.lags), list(self.lags)
        parts = data.parts(last + 1)
        rows = [np.hstack([x[last - k : len(x) - k] for x in (p.y, p.u) for k in lags]) for p in parts]
        Y = np.vstack([p.y[last:] for p in parts])
        theta, ny, nu = np.linalg.lstsq(np.vstack(rows), Y)[0], len(data.outputs), len(data.inputs)
        a, b = np.zeros((last + 1, ny, ny)), np.zeros((last + 1, ny, nu))
        a[0] = np.eye(ny)
        past_y, past_u = np.split(theta, [len(lags) * ny])
        a[lags], b[lags] = (
            -past_y.reshape(-1, ny, ny).transpose(0, 2, 1),
            past_u.reshape(-1, nu, ny).transpose(0, 2, 1),
        )
        residual = Y - np.vstack(rows) @ theta
        cov = residual.T @ residual / len(Y)
        model = PolynomialModel(a, b, data.dt, innovation_cov=cov, inputs=data.inputs, outputs=data.outputs)
        return Estimate(model, self.name, None)
