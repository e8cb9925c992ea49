"""What a user gives a plant: a preset, parameters by name, noise levels, a seed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arguments import bad, number, whole
from excite.errors import ExciteError, did_you_mean

ALLOWED = ("positive", "non-negative", "any")
NONE = "none"  # a parameter that is not there; files have no other word for it
MOST_NOISE = 1e3  # of any standard deviation, in the source's unit


@dataclass(frozen=True)
class Parameter:
    """One plant parameter: value, unit, where the number comes from ("assumption" when it is one), what is allowed.

    value : a number; a matrix as nested lists, or a text, where a plant is described by such.
    """

    value: Any
    unit: str
    source: str
    allowed: str = "positive"


def is_there(value: object) -> bool:
    """Whether a parameter has been given."""
    return value is not None and not (isinstance(value, str) and value == NONE)


def resolve(
    plant: str, presets: Mapping[str, Mapping[str, Parameter]], preset: str, overrides: Mapping[str, Any]
) -> dict[str, Parameter]:
    """Return the parameters of a preset, overridden by name.

    Only parameters that are numbers are checked here; lists, tables and texts are read by the plant itself.
    """
    if preset not in presets:
        raise ExciteError(f"{plant}: preset '{preset}' does not exist; {did_you_mean(preset, presets)}")
    parameters = dict(presets[preset])
    for name, value in overrides.items():
        place = f"{plant} parameter '{name}'"
        if name not in parameters:
            raise ExciteError(f"{place} does not exist; {did_you_mean(name, parameters)}")
        old = parameters[name]
        given = _allowed(value, place, old) if isinstance(old.value, (int, float)) else value
        parameters[name] = Parameter(given, old.unit, "override" if given != old.value else old.source, old.allowed)
    return parameters


def noise_levels(plant: str, sources: Mapping[str, Parameter], noise: bool | Mapping[str, float]) -> dict[str, float]:
    """Return every source's standard deviation: the defaults (True), zeros (False), or defaults with some changed."""
    levels = {name: parameter.value for name, parameter in sources.items()}
    if isinstance(noise, bool):
        return levels if noise else dict.fromkeys(levels, 0.0)
    if not isinstance(noise, Mapping):
        raise bad(f"{plant} noise", noise, "give true, false, or standard deviations by name")
    for name, value in noise.items():
        place = f"{plant} noise '{name}'"
        if name not in levels:
            raise ExciteError(f"{place} does not exist; {did_you_mean(name, levels)}")
        unit = sources[name].unit
        levels[name] = number(value, place)
        if levels[name] < 0:
            raise bad(place, value, "a standard deviation is at least zero", unit)
        if levels[name] > MOST_NOISE:
            raise bad(place, value, f"nothing works so, give at most {MOST_NOISE:g}", unit)
    return levels


def seed_of(plant: str, seed: object) -> int:
    """Return a seed, a whole number of at least 0 and of any size."""
    return whole(seed, f"{plant} seed", 0, np.inf)


def _allowed(value: object, place: str, old: Parameter) -> float:
    """Return a number that a parameter may take."""
    given = number(value, place)
    if (given < 0 and old.allowed != "any") or (given == 0 and old.allowed == "positive"):
        least = "at least zero" if old.allowed == "non-negative" else "positive"
        raise bad(place, value, f"it must be {least}", old.unit)
    return given
