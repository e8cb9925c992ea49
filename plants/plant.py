"""What a plant is: where a signal enters it, what it records, and the checks that every run and every truth pass."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arguments import multiple
from excite.errors import DesignRefused, ExciteError, did_you_mean
from excite.types.channel import Channel
from excite.types.frozen import Frozen
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from plants.arguments import Parameter, noise_levels, seed_of


@dataclass(frozen=True)
class Injection:
    """A place where an excitation enters: its channels, their limits (low, high), and what can be identified from there.

    views : name -> Roles on the recording; a view of the same name at another injection has the same truth.
    """

    channels: tuple[Channel, ...]
    limits: tuple[tuple[float, float], ...]
    views: Mapping[str, Roles] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, eq=False)
class Layout:
    """What a plant records: known from the place of injection, before a sample is simulated.

    channels : in the order of the columns; dt : s, None where the plant samples at uneven times; views : name -> Roles,
    `default` the one used when none is named; loop : how the plant is operated.
    """

    channels: tuple[Channel, ...]
    dt: float | None
    views: Mapping[str, Roles]
    default: str
    loop: Loop

    def recording(self, time_s: np.ndarray, values: np.ndarray, origin: Origin, period: int | None = None) -> Recording:
        """Return the recording of values (N, channels) at time_s (N,), as deviations from the operating point."""
        return Recording(
            time_s=time_s,
            values=values,
            channels=self.channels,
            dt=self.dt,
            views=self.views,
            default=self.default,
            period=period,
            loop=self.loop,
            origin=origin,
            level="zero",
        )

    def blank(self) -> Recording:
        """Return a recording of one sample of zeros, by which roles can be tried."""
        return self.recording(np.zeros(1), np.zeros((1, len(self.channels))), Origin())


@dataclass(frozen=True, eq=False)
class Task:
    """What a plant is to play, checked.

    signal enters at `inject`, each of its samples held over `hold` samples of the plant; levels : noise source ->
    standard deviation.
    """

    inject: str
    signal: Signal
    hold: int
    levels: Mapping[str, float]

    @property
    def u(self) -> np.ndarray:
        """The signal at the plant's sampling time, (N hold, channels)."""
        return np.repeat(self.signal.u, self.hold, axis=0)


class Plant(ABC):
    """A simulated plant: stateless, starts at trim, SI units or a unit in every channel.

    A plant gives what is listed below, and implements `records`, `simulate` and `derive_truth`. `run`, `run_many` and `truth`
    check what users ask for and are the same for all plants. In the registry stands what makes it: the class or a
    function, which takes the keywords `preset` (a name) and `parameters` (values by name).

    name : that of the registry; description : one line; preset : the one chosen; dt : sampling time, s;
    injections : name -> Injection, the first is the default; outputs : channels that it always records;
    parameters : name -> Parameter; noise_sources : name -> Parameter (standard deviations);
    conformance_exceptions : check of `plants.conformance` that this plant need not pass -> the reason.
    """

    name: str
    description: str
    preset: str | None
    dt: float
    outputs: Sequence[Channel]
    parameters: Mapping[str, Parameter]
    noise_sources: Mapping[str, Parameter]
    conformance_exceptions: Mapping[str, str] = Frozen()

    if TYPE_CHECKING:  # what every plant has in one form or another

        def __init__(self, *, preset: str | None = None, parameters: Mapping[str, Any] | None = None) -> None: ...

        @property
        def injections(self) -> Mapping[str, Injection]:
            """Places of entry, the first is the default."""

    @abstractmethod
    def records(self, inject: str | None = None) -> Layout:
        """Return what a run records for a signal that enters at `inject`, by default the first injection."""

    @abstractmethod
    def simulate(self, task: Task, seeds: Sequence[int]) -> Iterable[np.ndarray]:
        """Play the task once per seed; return for each the values (N, channels) of the layout, time along the rows."""

    @abstractmethod
    def derive_truth(self, view: str, levels: Mapping[str, float]) -> Truth:
        """Return the truth of a view from this plant's equations, for these standard deviations of the noise."""

    @cached_property
    def values(self) -> dict[str, Any]:
        """The parameters' values by name."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that the plant was made from, beside its parameters: what they hold belongs to what it is."""
        return ()

    @property
    def views(self) -> dict[str, Roles]:
        """All views by name, with their roles at the first injection that knows them."""
        places = list(self.injections.values())
        found = {name: roles for place in reversed(places) for name, roles in place.views.items()}
        return {name: found[name] for place in places for name in place.views}

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play a signal from trim, with zero-order hold, and record everything.

        Parameters
        ----------
        signal : its dt is a whole multiple of the plant's.
        inject : where it enters, by default the first injection.
        noise : whether there is noise, or standard deviations by source; sources not named keep theirs.
        seed : of the noise; the same seed gives the same bits.

        Raises
        ------
        ExciteError for what the plant does not know; DesignRefused for a signal beyond the limits; SimulationStopped when
        the run leaves its safe region.
        """
        return self.run_many(signal, seeds=[seed], inject=inject, noise=noise)[0]

    def run_many(
        self,
        signal: Signal,
        *,
        seeds: Sequence[int],
        inject: str | None = None,
        noise: bool | Mapping[str, float] = True,
    ) -> list[Recording]:
        """Play a signal once per seed; each recording equals `run` with that seed."""
        seeds = [seed_of(self.name, seed) for seed in seeds]
        task = self.prepare(signal, inject, noise)
        if not seeds:
            return []
        layout, start_s = self.records(task.inject), self.start_s(task)
        period = None if signal.period is None else signal.period * task.hold
        recordings = []
        for seed, values in zip(seeds, self.simulate(task, seeds), strict=True):
            origin = Origin(self.name, self.preset, self.values, task.inject, task.levels, seed, start_s)
            time_s = self.times(task, len(values))
            recordings.append(layout.recording(time_s, values, origin, None if layout.dt is None else period))
        return recordings

    def prepare(self, signal: Signal, inject: str | None = None, noise: bool | Mapping[str, float] = True) -> Task:
        """Check what a run is asked for, without simulating: place, sampling time, limits, noise."""
        inject = self._place(inject)
        hold = self.hold(signal)
        self._check_limits(signal, self.injections[inject])
        return Task(inject, signal, hold, noise_levels(self.name, self.noise_sources, noise))

    def truth(self, recording: Recording | None, view: str) -> Truth:
        """Return the model that an ideal identification of a view would find, from the plant's equations.

        It has the parameters and noise levels of `recording`; without one, this plant's and the default levels.
        """
        views = self.views
        if view not in views:
            raise ExciteError(f"{self.name} view '{view}' does not exist; {did_you_mean(view, views)}")
        if recording is None:
            return self.derive_truth(view, noise_levels(self.name, self.noise_sources, True))
        origin = recording.origin
        if origin.plant != self.name:
            raise ExciteError(f"{self.name} truth: the recording is of {origin.plant!r}; pass one of this plant")
        same = self if origin.parameters == self.values else self.again(origin.preset, origin.parameters)
        return same.derive_truth(view, origin.noise)

    def again(self, preset: str | None, parameters: Mapping[str, Any]) -> "Plant":
        """Return this plant with other parameters; all of them are given."""
        return type(self)(preset=preset, parameters=parameters)

    def with_actuator(self, given: Mapping[str, Any]) -> "Plant":
        """Return this plant with actuator elements before its inputs; refuse them where it takes none."""
        for key in given:
            raise ExciteError(f"{self.name} parameter '{key}': this plant brings its own actuators; drop it")
        return self

    def hold(self, signal: Signal) -> int:
        """Return the plant's samples in one of the signal's."""
        return self.whole_multiple(signal, self.dt, "the plant's sampling time")

    def start_s(self, task: Task) -> float:
        """Return when the excitation begins, s after the first sample."""
        return 0.0

    def times(self, task: Task, count: int) -> np.ndarray:
        """Return when the `count` samples of a run are taken, (count,), s."""
        return np.arange(count) * self.dt

    def whole_multiple(self, signal: Signal, step_s: float, why: str) -> int:
        """Return the steps of `step_s` in one signal sample; `why` says what the step is when they do not fit."""
        steps = multiple(signal.dt, step_s)
        if steps is None:
            raise ExciteError(
                f"{self.name}: signal dt {signal.dt:g} s is not a whole multiple of {step_s:g} s, {why}; "
                f"use dt = {max(round(signal.dt / step_s), 1) * step_s:g} s"
            )
        return steps

    def _place(self, inject: str | None) -> str:
        """Return the name of an injection, the first one by default."""
        inject = inject or next(iter(self.injections))
        if inject not in self.injections:
            raise ExciteError(
                f"{self.name} injection '{inject}' does not exist; {did_you_mean(inject, self.injections)}"
            )
        return inject

    def _check_limits(self, signal: Signal, injection: Injection) -> None:
        """Refuse a signal with the wrong number of channels, or one that leaves its limits."""
        needed, given = [c.name for c in injection.channels], signal.u.shape[1]
        if given != len(needed):
            raise ExciteError(f"{self.name}: the signal has {given} channels; give {len(needed)}: {', '.join(needed)}")
        for values, channel, (low, high) in zip(signal.u.T, injection.channels, injection.limits, strict=True):
            worst = values.min() if values.min() < low else values.max()
            if not low <= worst <= high:
                limit = low if worst < low else high
                raise DesignRefused(
                    f"{self.name} {channel.name}: {worst:g} {channel.unit} exceeds the limit {limit:g} {channel.unit}; "
                    "reduce the amplitude"
                )
