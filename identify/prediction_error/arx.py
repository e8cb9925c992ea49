"""ARX: linear least squares on lagged inputs and outputs."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.models.polynomial import PolynomialModel
from excite.numerics.hankel import hankel_factor, largest_rows
from identify.data.records import Records
from identify.estimate import Estimate
from identify.method import Method
from identify.steps.compression import PastFuture, joint_segments, regress, require_excitation
from identify.steps.initial_state import initial_state


@dataclass(frozen=True)
class Arx(Method[Records, int]):
    """Multivariable ARX by least squares: y(t) + A_1 y(t-1) + … = B_k u(t-k) + … + e(t) (Zaffalon and Hofmann 2024, 5.2).

    The order is the number of lags of y and of u each; delay : k, the first lag of u (0 lets u act at once).
    Consistent in open and closed loop when the noise is ARX, biased otherwise; high orders approximate any noise.
    """

    name: ClassVar[str] = "arx"
    summary: ClassVar[str] = "least squares on lagged inputs and outputs; the order is the number of lags"
    consistent_in_closed_loop: ClassVar[bool] = True
    order_is: ClassVar[str | None] = "lags"

    delay: int = field(default=1, metadata={"minimum": 0})

    def required_excitation(self, order: int | None) -> int:
        """One for each lag of u."""
        return order or 1

    def sufficient_excitation(self, order: int | None) -> int:
        """Twice the lags: numerator and common denominator of an input-output model."""
        return 2 * (order or 1)

    def largest_order(self, data: Records) -> int:
        """Lags that leave at least as many equations as unknowns."""
        return largest_rows(joint_segments(data.parts(1))) - self.delay

    def span(self, order: int | None) -> int:
        """The lags and the sample they explain."""
        return (order or 1) + max(self.delay, 1)

    def realize(self, compressed: Records, order: int, data: Records) -> Estimate:
        """Return the model with `order` lags; each order compresses its own few lags."""
        rows = self.span(order)
        parts = data.parts(rows)
        first = parts[0]
        nu, ny = first.u.shape[1], first.y.shape[1]
        H = hankel_factor(joint_segments(parts), rows)
        lags = PastFuture(H, parts, rows, 0)
        require_excitation(lags, rows - self.delay - order, rows - self.delay, "lags of the input")
        last = rows - 1
        past_y = H.L[H.index(slice(nu, None), last - order, last)]
        past_u = H.L[H.index(slice(0, nu), rows - self.delay - order, rows - self.delay)]
        Y = H.L[H.index(slice(nu, None), last, rows)]
        on_y, on_u = regress(Y, past_y, past_u)
        residual = Y - on_y @ past_y - on_u @ past_u
        a = np.concatenate([np.eye(ny)[None], -on_y.reshape(ny, order, ny).transpose(1, 0, 2)[::-1]])
        b = np.concatenate([np.zeros((self.delay, ny, nu)), on_u.reshape(ny, order, nu).transpose(1, 0, 2)[::-1]])
        model = PolynomialModel(
            a,
            b,
            first.uniform_dt,
            innovation_cov=residual @ residual.T / H.columns,
            inputs=first.inputs,
            outputs=first.outputs,
        )
        x0 = tuple(initial_state(model, e, predictor=True) for e in parts)
        return Estimate(model, self.name, order, x0=x0, condition=H.condition, route=H.path)
