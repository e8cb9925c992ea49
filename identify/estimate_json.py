"""Models and estimates as strict JSON (null, never NaN), and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.files.models import REMEDY, model_from_dict, model_to_dict, read_json_object
from excite.models.model import Dynamic, Model
from excite.models.modes import continuous_poles
from excite.plain import plain
from excite.types.frozen import Frozen
from identify.estimate import Estimate, Status
from identify.uncertainty.first_order import FirstOrder
from identify.uncertainty.uncertainty import Uncertainty
from identify.uncertainty.withheld import Withheld

SCHEMA_VERSION = 2


def estimate_to_dict(estimate: Estimate, fit: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the object that `excite identify --json` prints and MODEL.json holds."""
    model = estimate.model
    poles = model.poles() if isinstance(model, Dynamic) else ()
    return plain(
        {
            "schema_version": SCHEMA_VERSION,
            "method": estimate.method,
            "order": estimate.order,
            **model_to_dict(model),
            "x0": list(estimate.x0),
            "poles": [pole_to_dict(p, model.dt) for p in poles],
            "singular_values": estimate.singular_values,
            "fit": fit,
            "uncertainty": estimate.uncertainty and estimate.uncertainty.to_dict(),
            "status": estimate.status.name.lower(),
            "warnings": list(estimate.warnings),
            "settings": estimate.settings,
            "preparation": list(estimate.preparation),
            "condition": estimate.condition,
            "route": estimate.route,
            "seconds": estimate.seconds,
        }
    )


def pole_to_dict(pole: complex, dt: float | None) -> dict[str, float | None]:
    """Return a pole with what its s = log(pole) / dt means: natural frequency in Hz, damping ratio, time constant in s.

    dt None : the pole is in the s-plane already, rad/s. The damping of an integrator, and the time constant -1 / Re s of
    what is undamped, are null.
    """
    s = complex(pole if dt is None else continuous_poles(np.array([pole]), dt)[0])
    wn = abs(s)
    return {
        "re": pole.real,
        "im": pole.imag,
        "f_hz": wn / (2 * np.pi),
        "zeta": -s.real / wn if wn > 0 else None,
        "tau_s": -1 / s.real if s.real != 0 else None,
    }


def estimate_from_dict(data: Mapping[str, Any], place: str) -> Estimate:
    """Rebuild an estimate; errors name `place` and the key."""
    version = data.get("schema_version", SCHEMA_VERSION)
    if version not in range(1, SCHEMA_VERSION + 1):
        raise ExciteError(f"{place}: schema_version {version!r}; this excite reads 1 to {SCHEMA_VERSION}: update it")
    model = model_from_dict(data, place)
    try:
        values = data.get("singular_values")
        return Estimate(
            model,
            data["method"],
            data["order"],
            x0=tuple(np.array(x, float) for x in data.get("x0") or ()),
            singular_values=None if values is None else np.array(values, float),
            uncertainty=_uncertainty(data.get("uncertainty"), model),
            status=Status[data["status"].upper()],
            warnings=tuple(data["warnings"]),
            settings=Frozen(data.get("settings") or {}),
            preparation=tuple(data.get("preparation") or ()),
            condition=data.get("condition"),
            route=data.get("route"),
            seconds=data.get("seconds") or 0.0,
        )
    except KeyError as error:
        raise ExciteError(f"{place}: key {error} is missing or unknown; {REMEDY}") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise ExciteError(f"{place}: {error}; {REMEDY}") from None


def load_estimate(path: str | Path) -> Estimate:
    """Read MODEL.json: an estimate, the trial of a run or a comparison that holds one, or a model by itself (`save_model`)."""
    data = read_json_object(path)
    if "estimate" in data:
        if data["estimate"] is None:
            raise ExciteError(f"{path}: this trial failed, it holds no model; see its `failure`")
        data = data["estimate"]
    if "kind" in data and "method" not in data:
        model = model_from_dict(data, str(path))
        return Estimate(model, "saved model", len(model.poles()) if isinstance(model, Dynamic) else None)
    return estimate_from_dict(data, str(path))


def _uncertainty(data: Mapping[str, Any] | None, model: Model) -> Uncertainty | None:
    """Rebuild what `Uncertainty.to_dict` gave: of the poles, or withheld."""
    if data is None:
        return None
    if data["withheld"] is not None:
        return Withheld(model, data["withheld"], data["kind"])
    return FirstOrder(model, np.array(data["pole_covariance"], float), data["kind"])
