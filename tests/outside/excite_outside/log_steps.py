"""A method on step responses at any instants: a sum of lags on a grid of time constants."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls

from excite.models.foster import FosterModel
from identify.data.records import Kind, Records
from identify.estimate import Estimate
from identify.method import Method


@dataclass(frozen=True)
class LogSteps(Method):
    """Time-constant spectrum of a step response: lags on a logarithmic grid, weights >= 0 by least squares; no order."""

    name: ClassVar[str] = "log_steps"
    summary: ClassVar[str] = "sum of lags from step responses at any instants"
    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.STEPS, Kind.UNEVEN_STEPS})
    order_is: ClassVar[str | None] = None

    per_decade: int = field(default=10, metadata={"meaning": "time constants per decade"})

    def unsupported(self, data: Records) -> str | None:
        """One input, which steps at the first sample."""
        if len(data.inputs) != 1:
            return f"{len(data.inputs)} inputs, and this method takes the step of one"
        moves = any(np.ptp(record.u) > 1e-9 * np.abs(record.u).max() for record in data.measured)
        return "the input moves after its first sample, and this method takes a step from there" if moves else None

    def realize(self, compressed: Records, order: None, data: Records) -> Estimate:
        """Return the lags that take part, for all outputs."""
        first = data.measured[0]
        time_s = first.time_s - first.time_s[0]
        low, high = np.log10([time_s[1] / 2, time_s[-1]])
        tau = np.logspace(low, high, 1 + round((high - low) * self.per_decade))
        X = np.vstack([r.u[:1] * -np.expm1(-(r.time_s - r.time_s[0])[:, None] / tau) for r in data.measured])
        Y = np.vstack([record.y for record in data.measured])
        R = np.column_stack([nnls(X, y)[0] for y in Y.T])
        part = R.max(1) > 0
        model = FosterModel(R[part], tau[part], inputs=data.inputs, outputs=data.outputs)
        return Estimate(model, self.name, None)
