"""Experiment: a view of a recording with roles chosen; what every identification method takes."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.errors import ExciteError
from excite.types.channel import Channels, channels_for, period_of, positive, samples, time_axis
from excite.types.checked import NOT_GIVEN, ArrayByDefault, Checked, OptionalArray
from excite.types.frozen import ReadOnlyArrays
from excite.types.level import ZERO, CheckedLevel, Level
from excite.types.loop import Loop


@dataclass(frozen=True, eq=False)
class Experiment(ReadOnlyArrays):
    """Input-output data of one run, without any truth inside.

    u : (N, nu), what this experiment's diagram calls the plant input, None or (N, 0) when only outputs were recorded;
    y : (N, ny); NaN = missing sample;
    dt : s (uniform sampling), or time_s : (N,) s (any sampling); reference : (N, nr) or None;
    period : samples in one period of the excitation, or None; loop : how u was made; 1-D arrays become one channel.
    """

    u: np.ndarray
    y: np.ndarray
    dt: float | None = None
    reference: OptionalArray = NOT_GIVEN
    time_s: ArrayByDefault = NOT_GIVEN
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    references: Channels = NOT_GIVEN
    period: int | None = None
    loop: Checked[Loop | str | None, Loop] = NOT_GIVEN
    name: str = "data"
    level: CheckedLevel = ZERO

    def __post_init__(self) -> None:
        for key, role, prefix in (("u", "inputs", "u"), ("y", "outputs", "y"), ("reference", "references", "r")):
            if key == "reference" and self.reference is None:
                object.__setattr__(self, role, ())
                continue
            if key == "u" and (self.u is None or np.shape(self.u) == (len(self.y), 0)):
                values = np.empty((len(self.y), 0))
            else:
                values = samples(getattr(self, key), f"Experiment.{key}", missing=True)
            object.__setattr__(self, key, values)
            object.__setattr__(self, role, channels_for(values.shape[1], getattr(self, role), prefix))
            if len(values) != len(self.u):
                raise ExciteError(
                    f"Experiment.{key}: {len(values)} samples, but u has {len(self.u)}; lengths must agree"
                )
        if self.dt is None and self.time_s is None:
            raise ExciteError("Experiment: give dt in seconds, or time_s")
        if self.dt is not None:
            object.__setattr__(self, "dt", positive(self.dt, "Experiment.dt"))
        if self.time_s is None:
            time = np.arange(len(self.u)) * self.dt
            time.flags.writeable = False
        else:
            time = time_axis(self.time_s, len(self.u), "Experiment.time_s")
        object.__setattr__(self, "time_s", time)
        object.__setattr__(self, "loop", Loop.of(self.loop))
        object.__setattr__(self, "level", Level.of(self.level))
        object.__setattr__(self, "period", period_of(self.period, "Experiment.period"))

    def __len__(self) -> int:
        return len(self.u)

    @cached_property
    def incomplete(self) -> np.ndarray | None:
        """Which samples miss a value of u or y, (N,) bool, or None when none does."""
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(self.u.sum() + self.y.sum()):  # a tenth of the time of looking for NaN
                return None
        missing = np.isnan(self.u).any(1) | np.isnan(self.y).any(1)
        return missing if missing.any() else None

    @property
    def uniform_dt(self) -> float:
        """The sampling time, s; raises ExciteError where the samples were taken at uneven instants."""
        if self.dt is None:
            raise ExciteError(
                f"{self.name}: sampling is not uniform, and one sampling time is needed; resample the record"
            )
        return self.dt

    def without_inputs(self) -> "Experiment":
        """Return the outputs alone."""
        return replace(self, u=np.empty((len(self), 0)), inputs=None, references=self.references or None)

    def window(self, start: int, stop: int | None = None) -> "Experiment":
        """Return samples start:stop as an experiment of its own."""
        r = None if self.reference is None else self.reference[start:stop]
        return replace(
            self,
            u=self.u[start:stop],
            y=self.y[start:stop],
            reference=r,
            references=self.references or None,
            time_s=self.time_s[start:stop],
        )

    def decimate(self, every: int) -> "Experiment":
        """Keep each `every`-th sample. Exact when u is held over whole decimated intervals; no filter is applied."""
        if every == 1:
            return self
        if self.dt is None:
            raise ExciteError("decimate: the sampling is not uniform; choose samples by time instead")
        r = None if self.reference is None else self.reference[::every]
        period = self.period // every if self.period and self.period % every == 0 else None
        return replace(
            self,
            u=self.u[::every],
            y=self.y[::every],
            reference=r,
            references=self.references or None,
            time_s=self.time_s[::every],
            dt=self.dt * every,
            period=period,
        )
