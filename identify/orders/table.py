"""Orders side by side, and what speaks for each."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic
from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.estimate import Estimate
from identify.fit import check, fit
from identify.method import Method
from identify.orders.criteria import Criteria, information_criteria
from identify.orders.stabilisation import StablePole, stabilisation

CRITERIA = ("aic", "aicc", "bic")


@dataclass(frozen=True, eq=False)
class OrderRow:
    """What one order gives: the estimate and its criteria, or the reason why there is none.

    gap : ratio of this singular value to the next, None where the method has none; criteria : None where the model has
    no noise part; radius : largest pole modulus, None without an estimate.
    """

    order: int
    estimate: Estimate | None = None
    reason: str | None = None
    gap: float | None = None
    criteria: Criteria | None = None
    radius: float | None = None


@dataclass(frozen=True, eq=False)
class OrderTable:
    """Orders side by side; chosen : rule -> the order it prefers; poles : stabilisation diagram."""

    rows: tuple[OrderRow, ...]
    chosen: Mapping[str, int]
    poles: tuple[StablePole, ...]


def order_table(data: Experiment | Iterable[Experiment] | Records, method: Method, orders: Iterable[int]) -> OrderTable:
    """Fit several orders and return what speaks for each. The data are condensed and decomposed once for all of them.

    The order that a method takes when none is given is that of the gap; the criteria are offered beside it because they
    weigh fit against size, where singular values of noisy data fall without a step. They presuppose estimates near the
    least one-step error: arx, ssarx, cva, pbsid, parsim_k, wfa. The gain of MOESP, N4SID and IEM is less efficient, so
    that larger orders go on lowering their residuals beyond the true one.
    """
    records = Records.of(data)
    shared: dict[Any, Any] = {}
    check(method, records.deviations().without_dead_time(method.input_delay), None)
    rows = tuple(_row(records, method, n, shared) for n in sorted(set(orders)))
    judged: dict[str, dict[int, float]] = {
        "gap": {row.order: -row.gap for row in rows if row.gap is not None},
        **{name: {r.order: getattr(r.criteria, name) for r in rows if r.criteria is not None} for name in CRITERIA},
    }
    chosen = {name: min(values, key=values.__getitem__) for name, values in judged.items() if values}
    models = {
        r.order: r.estimate.model for r in rows if r.estimate is not None and isinstance(r.estimate.model, Dynamic)
    }
    return OrderTable(rows, chosen, stabilisation({n: model.to_state_space() for n, model in models.items()}))


def _row(records: Records, method: Method, n: int, shared: dict[Any, Any]) -> OrderRow:
    try:
        estimate = fit(records, method, n, shared=shared)
    except (ExciteError, np.linalg.LinAlgError) as error:
        return OrderRow(n, reason=str(error))
    s, model = estimate.singular_values, estimate.model
    gap = None if s is None or n >= len(s) else float(s[n - 1] / max(s[n], 1e-12 * s[0]))
    radius = float(np.abs(model.poles()).max(initial=0.0)) if isinstance(model, Dynamic) else None
    return OrderRow(n, estimate, None, gap, information_criteria(model, records), radius)
