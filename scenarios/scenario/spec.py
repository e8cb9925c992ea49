"""A checked scenario and its parts, and what its signals must keep to."""

import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.errors import DesignRefused, ExciteError
from excite.types.recording import Roles
from excite.types.signal import Signal
from identify.method import Method
from identify.registry import load_method
from plants.plant import Plant
from scenarios.scenario.excitation import play

COMPARISONS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}


@dataclass(frozen=True)
class ViewSpec:
    """One identification view: roles on the recording, and how much to decimate ("auto": by the design rule).

    coherence : keep the outputs whose mean coherence with what was played, over the view's band, is at least this.
    """

    name: str
    roles: Roles
    plants_own: bool
    decimate: int | str = "auto"
    coherence: float | None = None


@dataclass(frozen=True)
class MethodSpec:
    """One method with its settings; horizons that are not given follow from the design rule.

    orders : whole numbers or rules ("bic"); (None,) for a method without an order; label : what tables call it, by default
    its name, with the settings that set twins apart; place : its key path.
    """

    name: str
    view: str
    orders: tuple[int | str | None, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
    place: str = "method"
    label: str | None = None

    def build(self, horizons: Mapping[str, int]) -> Method:
        """Return the method with the horizons of the design rule filled in where the scenario gives none."""
        return load_method(self.name, **{**horizons, **self.settings})


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


@dataclass(frozen=True, eq=False)
class Scenario:
    """A checked scenario. `source` is the plain dictionary it came from, `file` its file, `plant` the configured plant."""

    name: str
    seed: int
    description: str
    plant: Plant
    preset: str | None
    parameters: Mapping[str, Any]
    noise: bool | Mapping[str, float]
    inject: str
    excitation: tuple[Mapping[str, Any], ...]
    views: tuple[ViewSpec, ...]
    methods: tuple[MethodSpec, ...]
    estimation_runs: int
    validation_runs: int
    discard_s: float
    rank_by: tuple[str, ...]
    bands_hz: Mapping[str, tuple[float, float]]
    horizons_s: tuple[float, ...]
    expect: tuple[Expectation, ...]
    source: Mapping[str, Any]
    file: str = "scenario"

    def design(self, seed: int) -> Signal:
        """Return the excitation for a realisation seed."""
        return play(self.excitation, [str(c) for c in self.plant.injections[self.inject].channels], seed)


def check_signal(scenario: Scenario, signal: Signal) -> None:
    """Refuse an excitation that leaves the plant's limits, and discards and horizons that it does not bear."""
    file = scenario.file
    check_limits(scenario, signal, f"{file}: excitation")
    left_s = signal.duration_s - scenario.discard_s
    if left_s <= 0:
        raise ExciteError(
            f"{file}: data.discard_s: {scenario.discard_s:g} s discards the whole record of {signal.duration_s:g} s; discard less"
        )
    for i, horizon in enumerate(scenario.horizons_s):
        if horizon >= left_s:
            raise ExciteError(
                f"{file}: score.horizons_s[{i}]: {horizon:g} s is beyond the {left_s:g} s of data; shorten it"
            )


def check_limits(scenario: Scenario, signal: Signal, place: str) -> None:
    """Refuse a design whose amplitude leaves the limits of the place where it enters the plant."""
    injection = scenario.plant.injections[scenario.inject]
    low, high = signal.u.min(0), signal.u.max(0)
    for channel, limits, least, most in zip(injection.channels, injection.limits, low, high, strict=True):
        if least < limits[0] or most > limits[1]:
            worst = least if least < limits[0] else most
            raise DesignRefused(
                f"{place}: channel '{channel.name}' reaches {worst:g} {channel.unit}, outside the plant's limits "
                f"{limits[0]:g} to {limits[1]:g} {channel.unit}; lower the amplitude"
            )
