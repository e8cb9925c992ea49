"""Recording: everything that was logged; Roles choose an Experiment out of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import Channel, channels_for, period_of, positive, samples, time_axis
from excite.types.experiment import Experiment
from excite.types.frozen import Frozen, ReadOnlyArrays
from excite.types.level import ZERO, CheckedLevel, Level
from excite.types.loop import Loop
from excite.types.origin import Origin

OPEN, NOWHERE = Loop("open"), Origin()


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
class Recording(ReadOnlyArrays):
    """Everything that was logged in one run.

    time_s : (N,) s, increasing; values : (N, c), NaN = missing sample; channels : c names and units;
    dt : s when sampling is uniform, else None; views : named Roles; default : the view used when none is named;
    period : samples in one period of the excitation, or None; loop : how the plant was operated; origin : the
    plant, or the file, that it comes from; level : what the numbers are measured from, "zero" for our plants.
    """

    time_s: np.ndarray
    values: np.ndarray
    channels: tuple[Channel, ...]
    dt: float | None = None
    views: Mapping[str, Roles] = field(default_factory=dict)
    default: str | None = None
    period: int | None = None
    loop: Loop = OPEN
    origin: Origin = NOWHERE
    level: CheckedLevel = ZERO

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", samples(self.values, "Recording.values", missing=True))
        object.__setattr__(self, "channels", channels_for(self.values.shape[1], self.channels, "c"))
        object.__setattr__(self, "time_s", time_axis(self.time_s, len(self.values), "Recording.time_s"))
        object.__setattr__(self, "views", Frozen(self.views))
        object.__setattr__(self, "level", Level.of(self.level))
        object.__setattr__(self, "period", period_of(self.period, "Recording.period"))
        if self.dt is not None:
            object.__setattr__(self, "dt", positive(self.dt, "Recording.dt"))
        if self.default is not None and self.default not in self.views:
            raise ExciteError(f"Recording.default: '{self.default}'; {did_you_mean(self.default, self.views)}")

    def _loop_of(self, view: "Roles") -> Loop:
        """Return the recording's loop where the view's inputs depend on it; what enters from outside is free of feedback."""
        return self.loop if view.closed or self.loop.state == "unknown" else Loop("open")

    def columns(self, names: tuple[str, ...], place: str = "channels") -> np.ndarray:
        """Return the named channels side by side, (N, len(names))."""
        known = [c.name for c in self.channels]
        for name in names:
            if name not in known:
                raise ExciteError(f"{place}: no recorded channel '{name}'; {did_you_mean(name, known)}")
        return self.values[:, [known.index(name) for name in names]]

    def experiment(self, view: str | Roles | None = None) -> Experiment:
        """Return the view of this recording that a view's roles choose."""
        label = "roles"
        if not isinstance(view, Roles):
            view = self.default if view is None else view
            if view is None:
                raise ExciteError(f"Recording.experiment: name a view; known: {', '.join(self.views) or 'none'}")
            if view not in self.views:
                raise ExciteError(f"view '{view}' is not recorded; {did_you_mean(view, self.views)}")
            label, view = view, self.views[view]
        by_name = {c.name: c for c in self.channels}
        take = slice(None, None, view.every)
        u, y = (self.columns(names, label)[take] for names in (view.inputs, view.outputs))
        r = self.columns(view.reference, label)[take] if view.reference else None
        period = self.period // view.every if self.period and self.period % view.every == 0 else None
        return Experiment(
            u,
            y,
            reference=r,
            time_s=self.time_s[take],
            dt=None if self.dt is None else self.dt * view.every,
            inputs=[by_name[n] for n in view.inputs],
            outputs=[by_name[n] for n in view.outputs],
            references=[by_name[n] for n in view.reference] or None,
            period=period,
            loop=self._loop_of(view),
            level=self.level,
            name=label,
        )
