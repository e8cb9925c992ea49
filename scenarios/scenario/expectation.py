"""What a scenario expects of its result: `view.method.metric.statistic`, compared with a number."""

import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from excite.errors import ExciteError, did_you_mean
from identify.compare import STATISTICS
from identify.metrics.registry import find_metric, list_metrics

COMPARISONS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
BOUND = re.compile(r"\s*(<=|>=|<|>)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")


@dataclass(frozen=True)
class Expectation:
    """`view.method.metric.statistic` compared with a number."""

    key: str
    view: str
    method: str
    metric: str
    statistic: str
    comparison: str
    bound: float

    def holds(self, value: float) -> bool:
        """Whether the value meets the bound; NaN never does."""
        return bool(COMPARISONS[self.comparison](value, self.bound))


def read_expectation(
    key: str, value: Any, place: str, views: Sequence[str], methods: Sequence[tuple[str, str]]
) -> Expectation:
    """Return what a key and a value of [expect] say; methods : (view, label) of all methods.

    Raises ExciteError for what is no comparison, and for a view, a label, a metric or a statistic that is not known.
    """
    place = f'{place}"{key}"'
    match = BOUND.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ExciteError(f'{place}: {value!r}; give a comparison such as "<= 0.02"')
    parts = key.split(".")
    if len(parts) not in (3, 4):
        raise ExciteError(f'{place}: give "method.metric.statistic" or "view.method.metric.statistic"')
    if len(parts) == 3 and len(views) > 1:
        raise ExciteError(f"{place}: there are {len(views)} views; put one first: {', '.join(views)}")
    view = parts[0] if len(parts) == 4 else views[0]
    method, metric, statistic = parts[-3:]
    here = [label for of, label in methods if of == view] + ["best"]
    metrics = [metric] if find_metric(metric) else list_metrics()
    for part, known in ((view, views), (method, here), (metric, metrics), (statistic, STATISTICS)):
        if part not in known:
            raise ExciteError(f"{place}: '{part}' is not known here; {did_you_mean(part, known)}")
    return Expectation(key, view, method, metric, statistic, match[1], float(match[2]))
