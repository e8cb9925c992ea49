"""Models and estimates as strict JSON (null, never NaN), and back."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Model
from excite.models.modes import continuous_poles
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.plain import plain as plain
from excite.types.frozen import Frozen
from identify.estimate import Estimate, Status
from identify.uncertainty.first_order import FirstOrder
from identify.uncertainty.uncertainty import Uncertainty
from identify.uncertainty.withheld import Withheld

SCHEMA_VERSION = 2
ARRAYS = {
    "state_space": (StateSpaceModel, ("A", "B", "C", "D", "K", "innovation_cov", "input_offset", "output_offset")),
    "polynomial": (PolynomialModel, ("a", "b", "innovation_cov")),
}


def estimate_to_dict(estimate: Estimate, fit: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the object that `excite identify --json` prints and MODEL.json holds."""
    model = estimate.model
    kind = next(k for k, (cls, _) in ARRAYS.items() if isinstance(model, cls))
    return plain(
        {
            "schema_version": SCHEMA_VERSION,
            "kind": kind,
            "method": estimate.method,
            "order": estimate.order,
            "dt": model.dt,
            "inputs": [str(c) for c in model.inputs],
            "outputs": [str(c) for c in model.outputs],
            **{name: getattr(model, name) for name in ARRAYS[kind][1]},
            "x0": list(estimate.x0),
            "poles": [pole_to_dict(p, model.dt) for p in model.poles()],
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


def pole_to_dict(pole: complex, dt: float) -> dict[str, float]:
    """z-plane pole with the natural frequency (Hz) and damping ratio of log(pole) / dt; damping null for integrators."""
    s = complex(continuous_poles(np.array([pole]), dt)[0])
    wn = abs(s)
    return {"re": pole.real, "im": pole.imag, "f_hz": wn / (2 * np.pi), "zeta": -s.real / wn if wn > 0 else None}


def estimate_from_dict(data: Mapping[str, Any], place: str) -> Estimate:
    """Rebuild an estimate; errors name `place` and the key."""
    try:
        kind, names = ARRAYS[data["kind"]]
        arrays = {n: None if data.get(n) is None else np.array(data[n], float) for n in names}
        model: Model = kind(dt=data["dt"], inputs=data["inputs"], outputs=data["outputs"], **arrays)
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
        raise ExciteError(
            f"{place}: key {error} is missing or unknown; pass a model that `excite identify -o` wrote"
        ) from None
    except (TypeError, ValueError, AttributeError) as error:
        raise ExciteError(f"{place}: {error}; pass a model that `excite identify -o` wrote") from None


def load_estimate(path: str | Path) -> Estimate:
    """Read MODEL.json."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except ValueError as error:
        raise ExciteError(f"{path}: not valid JSON ({error}); pass a model that `excite identify -o` wrote") from None
    if not isinstance(data, dict):
        raise ExciteError(f"{path}: a JSON {type(data).__name__}, not a model; pass what `excite identify -o` wrote")
    return estimate_from_dict(data, str(path))


def _uncertainty(data: Mapping[str, Any] | None, model: Model) -> Uncertainty | None:
    """Rebuild what `Uncertainty.to_dict` gave: of the poles, or withheld."""
    if data is None:
        return None
    if data["withheld"] is not None:
        return Withheld(model, data["withheld"], data["kind"])
    return FirstOrder(model, np.array(data["pole_covariance"], float), data["kind"])
