"""What a user gives a plant: preset and parameters, noise levels, a seed, and the signal at its place of entry."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from excite.errors import DesignRefused, ExciteError, did_you_mean
from excite.types.signal import Signal
from plants.plant import Injection, Parameter

STEP_TOLERANCE = 1e-9


def number(value: object, place: str) -> float:
    """Return a finite float or refuse it by its place."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ExciteError(f"{place}: {value!r} is not a number")
    if not math.isfinite(value):
        raise ExciteError(f"{place}: {value!r} is not finite")
    return float(value)


def resolve(
    plant: str, presets: Mapping[str, Mapping[str, Parameter]], preset: str, overrides: Mapping[str, Any]
) -> dict[str, Parameter]:
    """Return the parameters of a preset overridden by name; what is no number there is left to the plant to read."""
    if preset not in presets:
        raise ExciteError(f"{plant}: preset '{preset}' does not exist; {did_you_mean(preset, presets)}")
    parameters = dict(presets[preset])
    for name, value in overrides.items():
        place = f"{plant} parameter '{name}'"
        if name not in parameters:
            raise ExciteError(f"{place} does not exist; {did_you_mean(name, parameters)}")
        old = parameters[name]
        numeric = isinstance(old.value, (int, float))
        given = number(value, place) if numeric else value
        if numeric and old.allowed != "any" and (given < 0 or (given == 0 and old.allowed == "positive")):
            least = "at least zero" if old.allowed == "non-negative" else "positive"
            raise ExciteError(f"{place}: {value!r} {old.unit}; it must be {least}")
        parameters[name] = Parameter(given, old.unit, "override" if given != old.value else old.source, old.allowed)
    return parameters


def noise_levels(
    plant: str, sources: Mapping[str, Parameter], noise: bool | Mapping[str, float], most: float = 1e3
) -> dict[str, float]:
    """Return every source's standard deviation: the defaults (True), zeros (False), or defaults with some changed."""
    levels = {name: parameter.value for name, parameter in sources.items()}
    if isinstance(noise, bool):
        return levels if noise else dict.fromkeys(levels, 0.0)
    if not isinstance(noise, Mapping):
        raise ExciteError(f"{plant} noise: {noise!r}; give true, false, or standard deviations by name")
    for name, value in noise.items():
        place = f"{plant} noise '{name}'"
        if name not in levels:
            raise ExciteError(f"{place} does not exist; {did_you_mean(name, levels)}")
        unit = sources[name].unit
        levels[name] = number(value, place)
        if levels[name] < 0:
            raise ExciteError(f"{place}: {value!r} {unit}; a standard deviation is at least zero")
        if levels[name] > most:
            raise ExciteError(f"{place}: {value!r} {unit}; nothing works so, give at most {most:g}")
    return levels


def seed_of(plant: str, seed: object) -> int:
    """Return a seed of at least 0 as an int."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ExciteError(f"{plant} seed: {seed!r}; give an integer of at least 0")
    return int(seed)


def injection_of(plant: str, injections: Mapping[str, Injection], inject: str | None) -> str:
    """Return the injection's name, the first one by default."""
    inject = inject or next(iter(injections))
    if inject not in injections:
        raise ExciteError(f"{plant} injection '{inject}' does not exist; {did_you_mean(inject, injections)}")
    return inject


def held(plant: str, signal: Signal, step_s: float, why: str) -> int:
    """Return the steps of `step_s` in one signal sample; `why` says what the step is when they do not fit."""
    steps = round(signal.dt / step_s)
    if steps < 1 or abs(signal.dt - steps * step_s) > STEP_TOLERANCE * signal.dt:
        raise ExciteError(
            f"{plant}: signal dt {signal.dt:g} s is not a whole multiple of {step_s:g} s, {why}; "
            f"use dt = {max(steps, 1) * step_s:g} s"
        )
    return steps


def check_limits(plant: str, signal: Signal, injection: Injection) -> None:
    """Refuse a signal with the wrong number of channels, or one that leaves its limits."""
    needed, given = [c.name for c in injection.channels], signal.u.shape[1]
    if given != len(needed):
        raise ExciteError(f"{plant}: the signal has {given} channels; give {len(needed)}: {', '.join(needed)}")
    for values, channel, (low, high) in zip(signal.u.T, injection.channels, injection.limits, strict=True):
        worst = values.min() if values.min() < low else values.max()
        if not low <= worst <= high:
            limit = low if worst < low else high
            raise DesignRefused(
                f"{plant} {channel.name}: {worst:g} {channel.unit} exceeds the limit {limit:g} {channel.unit}; "
                "reduce the amplitude"
            )
