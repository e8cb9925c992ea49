"""Models as strict JSON, bit for bit, and back."""

import json
import os
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.files.atomic import written
from excite.models.fir import FirModel
from excite.models.foster import FosterModel
from excite.models.frequency_response import FrequencyResponse
from excite.models.model import Model
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import ContinuousModel, StateSpaceModel

# kind in the file -> the class whose fields the file holds
Kind = StateSpaceModel | PolynomialModel | FirModel | FosterModel | FrequencyResponse | ContinuousModel
KINDS: dict[str, type[Kind]] = {
    "state_space": StateSpaceModel,
    "polynomial": PolynomialModel,
    "fir": FirModel,
    "foster": FosterModel,
    "frequency_response": FrequencyResponse,
    "continuous": ContinuousModel,
}
REMEDY = "pass a model that `excite identify -o` or save_model wrote"


def model_to_dict(model: Model) -> dict[str, Any]:
    """Return a model in strict JSON's types: its kind, dt (None in continuous time), channels and arrays.

    Arrays become nested lists, complex ones {"re": …, "im": …}; what the model does not have is None.
    """
    kind = next((name for name, of in KINDS.items() if isinstance(model, of)), None)
    if kind is None:
        raise ExciteError(f"a {type(model).__name__} has no JSON form; known: {', '.join(KINDS)}")
    channels = {role: [str(c) for c in getattr(model, role)] for role in ("inputs", "outputs")}
    names = [field.name for field in fields(KINDS[kind]) if field.name not in ("dt", *channels)]
    return {"kind": kind, "dt": model.dt, **channels, **{name: _plain(getattr(model, name)) for name in names}}


def model_from_dict(data: Mapping[str, Any], place: str) -> Model:
    """Return the model that `model_to_dict` described; further keys are passed over. Errors name `place` and the key."""
    if "kind" not in data:
        raise ExciteError(f"{place}: key 'kind' is missing; {REMEDY}")
    kind = data["kind"]
    if not isinstance(kind, str) or kind not in KINDS:
        known = did_you_mean(kind, KINDS) if isinstance(kind, str) else REMEDY
        raise ExciteError(f"{place}: kind {kind!r} is no kind of model; {known}")
    values = {}
    for field in fields(KINDS[kind]):
        if data.get(field.name) is None and field.default is MISSING:
            state = "null" if field.name in data else "missing"
            raise ExciteError(f"{place}: key '{field.name}' is {state}; {REMEDY}")
        if data.get(field.name) is not None:
            values[field.name] = _array(data[field.name], f"{place}: {field.name}")
    try:
        return KINDS[kind](**values)
    except ExciteError as error:
        raise type(error)(f"{place}: {error}") from error
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise ExciteError(f"{place}: {error}; {REMEDY}") from None


def save_model(model: Model, path: str | os.PathLike) -> None:
    """Write a model as JSON."""
    text = json.dumps(model_to_dict(model), allow_nan=False)
    with written(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def load_model(path: str | os.PathLike) -> Model:
    """Read a model from JSON: what `save_model` wrote, or the model of an estimate that `excite identify -o` wrote."""
    return model_from_dict(read_json_object(path), str(path))


def read_json_object(path: str | os.PathLike) -> dict[str, Any]:
    """Read a file that holds one object of strict JSON."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse)
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (ValueError, RecursionError) as error:
        raise ExciteError(f"{path}: not valid JSON ({error}); {REMEDY}") from None
    if not isinstance(data, dict):
        raise ExciteError(f"{path}: a JSON {type(data).__name__}, not a model; {REMEDY}")
    return data


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"re": value.real.tolist(), "im": value.imag.tolist()} if np.iscomplexobj(value) else value.tolist()
    return value


def _array(value: Any, place: str) -> Any:
    """Put the parts of a complex array together; leave other values to the model's own checks."""
    if not isinstance(value, dict):
        return value
    try:
        parts = [np.array(value[part], float) for part in ("re", "im")]
        array = np.empty(np.broadcast_shapes(*(part.shape for part in parts)), complex)
        array.real, array.imag = parts  # not re + 1j im, which loses the sign of zeros
        return array
    except (KeyError, TypeError, ValueError):
        raise ExciteError(f'{place}: give complex arrays as {{"re": …, "im": …}} of equal shapes; {REMEDY}') from None
