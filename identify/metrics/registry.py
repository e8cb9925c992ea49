"""The table of metrics: one line per metric of ours, and entry points of installed packages beside them."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from excite.errors import ExciteError
from excite.registry import Registry
from identify.metrics.metric import FAMILY, Metric

Family = Callable[[int], Metric]
STEPS = re.compile(r"(?<=_)\d+(?=_)")  # where the horizon stands in the name of a metric of a family


def _refused(entry: Any) -> str | None:
    try:
        made = entry if isinstance(entry, Metric) else entry(1)
    except Exception as error:  # whatever a plug-in raises
        return f"neither a Metric nor a function of the horizon ({type(error).__name__}: {error})"
    return None if isinstance(made, Metric) else f"{made!r} is no Metric"


# In the order of tables.
METRICS: Registry[Metric | Family] = Registry(
    "metric",
    {
        "pole_error_max": "identify.metrics.poles:POLE_ERROR_MAX",
        "pole_error_mean": "identify.metrics.poles:POLE_ERROR_MEAN",
        "pole_error_frequency_percent": "identify.metrics.poles:POLE_ERROR_FREQUENCY",
        "pole_error_damping": "identify.metrics.poles:POLE_ERROR_DAMPING",
        "pole_error_time_constant_percent": "identify.metrics.poles:POLE_ERROR_TIME_CONSTANT",
        "pole_error_integrator_rad_s": "identify.metrics.poles:POLE_ERROR_INTEGRATOR",
        "pole_error_z_max": "identify.metrics.poles:POLE_ERROR_Z_MAX",
        "pole_error_z_mean": "identify.metrics.poles:POLE_ERROR_Z_MEAN",
        "poles_missing": "identify.metrics.poles:POLES_MISSING",
        "poles_surplus": "identify.metrics.poles:POLES_SURPLUS",
        "frf_error_h2": "identify.metrics.frequency:FRF_ERROR_H2",
        "frf_error_peak": "identify.metrics.frequency:FRF_ERROR_PEAK",
        "impulse_error": "identify.metrics.impulse:IMPULSE_ERROR",
        "fit_simulation": "identify.metrics.fits:FIT_SIMULATION",
        "fit_clean": "identify.metrics.fits:FIT_CLEAN",
        "fit_below_floor": "identify.metrics.fits:FIT_BELOW_FLOOR",
        "fit_one_step": "identify.metrics.fits:FIT_ONE_STEP",
        "vaf_simulation": "identify.metrics.vaf:VAF_SIMULATION",
        "vaf_one_step": "identify.metrics.vaf:VAF_ONE_STEP",
        "fit_<h>_step": "identify.metrics.fits:fit_ahead",
        "fit_clean_<h>_step": "identify.metrics.fits:fit_clean_ahead",
        "vaf_<h>_step": "identify.metrics.vaf:vaf_ahead",
    },
    _refused,
)


def list_metrics() -> list[str]:
    """Names of all metrics; a family with one metric per prediction horizon has <h> in place of the samples."""
    return list(METRICS)


def load_metric(name: str) -> Metric:
    """Return a metric by name.

    "fit_5_step" is the one of the family "fit_<h>_step" at 5 samples; the family's own name returns a metric that
    explains it and applies to nothing. Raises ExciteError for an unknown name, with the nearest known one.

    Examples
    --------
    >>> load_metric("fit_5_step").title(dt=0.02)
    'fit 100 ms ahead [%]'
    """
    steps = STEPS.findall(name)
    if len(steps) == 1 and (family := STEPS.sub(FAMILY, name)) in METRICS:
        return _made(METRICS[family], name, int(steps[0]))
    return _made(METRICS[name], name, None)


def _made(entry: Metric | Family, name: str, horizon: int | None) -> Metric:
    """Return the metric of an entry under its name in the registry, which counts."""
    if isinstance(entry, Metric):
        return entry if entry.name == name else replace(entry, name=name)
    made = entry(horizon or 1)
    return made if (made.name, made.horizon) == (name, horizon) else replace(made, name=name, horizon=horizon)


def find_metric(name: str) -> Metric | None:
    """Return the metric whose values stand under a name, None where there is none (a family's name has none)."""
    try:
        return None if FAMILY in name else load_metric(name)
    except ExciteError:
        return None


def metrics_at(horizons: Sequence[int]) -> tuple[Metric, ...]:
    """Return all metrics in the order of tables, those of families at each of the prediction horizons (samples)."""
    names = _in_order()
    found = [load_metric(name) for name in names if FAMILY not in name]
    for horizon in sorted(set(horizons)):
        each = [load_metric(name.replace(FAMILY, str(horizon))) for name in names if FAMILY in name]
        found += [metric for metric in each if not metric.longest or horizon == max(horizons)]
    return tuple(found)


def table() -> tuple[Metric, ...]:
    """Return all metrics in the order of tables, each family as one."""
    return tuple(load_metric(name) for name in _in_order())


def _in_order() -> list[str]:
    return [*METRICS.ours, *(name for name in METRICS if name not in METRICS.ours)]
