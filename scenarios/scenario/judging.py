"""How a scenario's models are judged: [score], and what is expected of them: [expect]."""

import re
from typing import Any

from excite.errors import ExciteError, did_you_mean
from identify.compare import STATISTICS
from identify.metrics.registry import find_metric, list_metrics
from scenarios.scenario.spec import Expectation, MethodSpec, ViewSpec
from scenarios.scenario.toml_table import NUMBER, TomlTable, is_a

BOUND = re.compile(r"\s*(<=|>=|<|>)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")


def read_score(table: TomlTable, views: tuple[ViewSpec, ...]) -> tuple[tuple, tuple, dict]:
    """Return rank_by, horizons_s and bands_hz by view."""
    rank_by = tuple(table.items("rank_by", str, ["pole_error_max", "frf_error_h2"]))
    without_truth = [s.name for s in views if not s.plants_own]
    for i, metric in enumerate(rank_by):
        place = f"{table.place}rank_by[{i}]: '{metric}'"
        if (known := find_metric(metric)) is None:
            raise ExciteError(f"{place} is no metric; {did_you_mean(metric, list_metrics())}")
        if without_truth and known.needs_truth:
            raise ExciteError(
                f"{place} needs a truth, and view '{without_truth[0]}', with roles of its own, has none; "
                'rank by "fit_one_step" or "fit_simulation"'
            )
        if known.horizon is not None and "horizons_s" not in table.values:
            raise ExciteError(f"{place} needs a prediction horizon; give horizons_s")
    horizons_s = table.items("horizons_s", NUMBER, [], lambda h: None if h > 0 else "give positive seconds")
    bands, bands_hz = table.table("bands_hz"), {}
    for view in views:
        band = bands.take(view.name, list, None)
        if band is None and view.coherence is not None:
            raise ExciteError(f"{bands.place}{view.name}: missing; coherence is judged over it, give [low, high] in Hz")
        if band is None:
            continue
        if len(band) != 2 or not all(is_a(f, NUMBER) for f in band) or not 0 < band[0] < band[1]:
            raise ExciteError(f"{bands.place}{view.name}: {band!r}; give [low, high] with 0 < low < high")
        bands_hz[view.name] = (float(band[0]), float(band[1]))
    bands.done()
    table.done()
    return rank_by, tuple(map(float, horizons_s)), bands_hz


def read_expectation(
    key: str, value: Any, place: str, views: list[str], methods: tuple[MethodSpec, ...]
) -> Expectation:
    """Read one line of [expect]: a key of names and a statistic, and the bound that it must keep."""
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
    here = [name for m in methods if m.view == view for name in (m.label or m.name,)] + ["best"]
    metrics = [metric] if find_metric(metric) else list_metrics()
    for part, known in ((view, views), (method, here), (metric, metrics), (statistic, STATISTICS)):
        if part not in known:
            raise ExciteError(f"{place}: '{part}' is not known here; {did_you_mean(part, known)}")
    return Expectation(key, view, method, metric, statistic, match[1], float(match[2]))
