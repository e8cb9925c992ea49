"""Recording: everything that was logged; Roles choose an Experiment out of it; Loop says how it was closed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import Channel, channels_for, period_of, positive, samples
from excite.types.experiment import Experiment

if TYPE_CHECKING:
    from excite.types.models import StateSpaceModel

ENTRIES = ("set-point", "plant input")


@dataclass(frozen=True)
class Loop:
    """How the plant was operated: open, or closed by a controller.

    controller : state-space model from the measured outputs (error) to the plant input, None when open or unknown;
    sign : sign of the feedback; entry : where the reference enters (r1 "plant input", r2 "set-point" of seed 002, 6.1).
    """

    closed: bool = False
    controller: "StateSpaceModel | None" = None
    sign: int = -1
    entry: str = "set-point"

    def __post_init__(self) -> None:
        if self.sign not in (-1, 1):
            raise ExciteError(f"Loop.sign: {self.sign!r}; use -1 or 1")
        if self.entry not in ENTRIES:
            raise ExciteError(f"Loop.entry: {self.entry!r}; {did_you_mean(str(self.entry), ENTRIES)}")
        if self.controller is not None and not self.closed:
            raise ExciteError("Loop.controller: a controller is given for an open loop; set closed=True")


@dataclass(frozen=True)
class Roles:
    """Which recorded channels are input, output and reference of one experiment.

    every : keep each `every`-th sample (lifting of a loop that repeats with that period).
    closed : whether the inputs depend on the outputs through feedback in this view.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    reference: tuple[str, ...] = ()
    every: int = 1
    closed: bool = False


@dataclass(frozen=True, eq=False)
class Recording:
    """Everything that was logged in one run.

    time_s : (N,) s, increasing; values : (N, c), NaN = missing sample; channels : c names and units;
    dt : s when sampling is uniform, else None; settings : named Roles; default : the setting used when none is named;
    period : samples in one period of the excitation, or None; source : plant, parameters, seed, injection point; or file.
    """

    time_s: np.ndarray
    values: np.ndarray
    channels: tuple[Channel, ...]
    dt: float | None = None
    settings: Mapping[str, Roles] = field(default_factory=dict)
    default: str | None = None
    period: int | None = None
    loop: Loop = Loop()
    source: Mapping = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", samples(self.values, "Recording.values", missing=True))
        object.__setattr__(self, "channels", channels_for(self.values.shape[1], self.channels, "c"))
        object.__setattr__(self, "time_s", time_axis(self.time_s, len(self.values), "Recording.time_s"))
        object.__setattr__(self, "settings", MappingProxyType(dict(self.settings)))
        object.__setattr__(self, "source", MappingProxyType(dict(self.source)))
        object.__setattr__(self, "period", period_of(self.period, "Recording.period"))
        if self.dt is not None:
            object.__setattr__(self, "dt", positive(self.dt, "Recording.dt"))
        if self.default is not None and self.default not in self.settings:
            raise ExciteError(f"Recording.default: '{self.default}'; {did_you_mean(self.default, self.settings)}")

    def columns(self, names: tuple[str, ...], place: str = "channels") -> np.ndarray:
        """Return the named channels side by side, (N, len(names))."""
        known = [c.name for c in self.channels]
        for name in names:
            if name not in known:
                raise ExciteError(f"{place}: no recorded channel '{name}'; {did_you_mean(name, known)}")
        return self.values[:, [known.index(name) for name in names]]

    def experiment(self, setting: str | Roles | None = None) -> Experiment:
        """Return the view of this recording that a setting's roles choose."""
        label = setting if isinstance(setting, str) else (self.default if setting is None else "roles")
        if not isinstance(setting, Roles):
            if label is None:
                raise ExciteError(f"Recording.experiment: name a setting; known: {', '.join(self.settings) or 'none'}")
            if label not in self.settings:
                raise ExciteError(f"setting '{label}' is not recorded; {did_you_mean(label, self.settings)}")
            setting = self.settings[label]
        by_name = {c.name: c for c in self.channels}
        take = slice(None, None, setting.every)
        u, y = (self.columns(names, label)[take] for names in (setting.inputs, setting.outputs))
        r = self.columns(setting.reference, label)[take] if setting.reference else None
        period = self.period // setting.every if self.period and self.period % setting.every == 0 else None
        return Experiment(
            u,
            y,
            reference=r,
            time_s=self.time_s[take],
            dt=None if self.dt is None else self.dt * setting.every,
            inputs=[by_name[n] for n in setting.inputs],
            outputs=[by_name[n] for n in setting.outputs],
            references=[by_name[n] for n in setting.reference] or None,
            period=period,
            loop=self.loop if setting.closed else Loop(),
            name=label,
        )


def time_axis(time_s: object, count: int, place: str) -> np.ndarray:
    """Return (N,) strictly increasing finite times, read-only."""
    time = samples(time_s, place)[:, 0]
    if len(time) != count:
        raise ExciteError(f"{place}: {len(time)} times for {count} samples")
    steps = np.diff(time)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0))
        raise ExciteError(f"{place}: time does not increase after sample {k} ({time[k]:g} s -> {time[k + 1]:g} s)")
    return time
