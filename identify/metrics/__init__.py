"""Metrics: what an estimate is worth, on data and against the truth; one object each.

`from identify.metrics import list_metrics, load_metric, describe`; names are loaded when they are asked for.
"""

from importlib import import_module

_HOMES = {
    "Judgement": "judgement",
    "Case": "judgement",
    "Metric": "metric",
    "Need": "metric",
    "NotApplicable": "metric",
    "describe": "metric",
    "list_metrics": "registry",
    "load_metric": "registry",
    "pole_errors": "poles",
    "frf_errors": "frequency",
    "default_band": "frequency",
    "impulse_error": "impulse",
    "fit_percent": "fits",
    "vaf_percent": "vaf",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
