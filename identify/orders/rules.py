"""Rules that choose an order: each takes the candidates and returns the order and why, in words."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.registry import Registry
from identify.data.records import Data, Records
from identify.estimate import Estimate
from identify.method import Method
from identify.orders.criteria import Criteria, information_criteria
from identify.orders.gap import largest_gap

MOST_ORDERS = 30  # that a criterion looks at


@dataclass(frozen=True, eq=False)
class Candidates:
    """The orders that a method can realize from condensed data, and what a rule may ask about them."""

    method: Method
    compressed: Any
    data: Data
    _estimates: dict[int, Estimate] = field(default_factory=dict, repr=False)

    @property
    def largest(self) -> int:
        """Largest possible order."""
        return self.method.largest_order(self.data)

    @property
    def orders(self) -> range:
        """Orders to look at, from 1 on."""
        return range(1, min(self.largest, MOST_ORDERS) + 1)

    @property
    def singular_values(self) -> np.ndarray | None:
        """Singular values of the condensed data, or None where the method has none."""
        return self.method.singular_values(self.compressed)

    def estimate(self, order: int) -> Estimate:
        """Return the estimate of one order, made once."""
        if order not in self._estimates:
            self._estimates[order] = self.method.realize(self.compressed, order, self.data)
        return self._estimates[order]

    def criteria(self, order: int) -> Criteria | None:
        """Return the information criteria of one order, None where there is no estimate or no noise model."""
        if not isinstance(self.data, Records):
            return None
        try:
            return information_criteria(self.estimate(order).model, self.data)
        except (ExciteError, np.linalg.LinAlgError):
            return None


OrderRule = Callable[[Candidates], tuple[int, str]]


def gap(candidates: Candidates) -> tuple[int, str]:
    """Return the order before the largest ratio of successive singular values."""
    values, name = candidates.singular_values, candidates.method.name
    if values is None:
        unit = f" (number of {candidates.method.order_is})" if candidates.method.order_is != "states" else ""
        raise ExciteError(f"{name}: give the order{unit}, or a rule such as bic; it has no singular values to show one")
    if len(values) < 2:
        raise ExciteError("a single singular value shows no gap to choose the order at; give the order")
    chosen, ratio = largest_gap(values[: candidates.largest + 1])
    return chosen, f"at the largest singular-value gap (ratio {ratio:.3g})"


def _least(criterion: str) -> OrderRule:
    def rule(candidates: Candidates) -> tuple[int, str]:
        found = {n: getattr(c, criterion) for n in candidates.orders if (c := candidates.criteria(n)) is not None}
        found = {n: value for n, value in found.items() if np.isfinite(value)}
        if not found:
            raise ExciteError(
                f"{candidates.method.name}: no order has a {criterion.upper()}, since none gives a model of the noise; "
                "give the order"
            )
        chosen = min(found, key=lambda n: found[n])
        return chosen, f"by the least {criterion.upper()} of orders {min(found)} to {max(found)}"

    rule.__doc__ = f"Return the order of the least {criterion.upper()}."
    return rule


aic, aicc, bic = _least("aic"), _least("aicc"), _least("bic")

# One line adds a rule; installed packages add theirs under the entry points excite.order_rules.
ORDER_RULES: Registry[OrderRule] = Registry(
    "order rule", {name: f"identify.orders.rules:{name}" for name in ("gap", "aic", "aicc", "bic")}
)


def order_rule(name: str) -> OrderRule:
    """Return a rule by name."""
    return ORDER_RULES[name]
