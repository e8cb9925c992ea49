"""Signal: what is played on the plant."""

from dataclasses import dataclass, replace

import numpy as np

from excite.arguments import multiple
from excite.errors import ExciteError
from excite.types.channel import Channels, channels_for, period_of, positive, samples
from excite.types.checked import NOT_GIVEN
from excite.types.frozen import ReadOnlyArrays
from excite.types.recipe import Recipe


@dataclass(frozen=True, eq=False)
class Signal(ReadOnlyArrays):
    """A designed input, sampled with zero-order hold.

    u : (N, nu) samples; dt : s; channels : names and units; period : samples in one period, or None;
    recipe : how a generator made it, enough to make `u` again bit for bit; None where nobody knows.
    """

    u: np.ndarray
    dt: float
    channels: Channels = NOT_GIVEN
    period: int | None = None
    recipe: Recipe | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "u", samples(self.u, "Signal.u"))
        object.__setattr__(self, "dt", positive(self.dt, "Signal.dt"))
        object.__setattr__(self, "channels", channels_for(self.u.shape[1], self.channels, "u"))
        if self.recipe is not None and not isinstance(self.recipe, Recipe):
            raise ExciteError(f"Signal.recipe: a {type(self.recipe).__name__}; give a Recipe, or None")
        object.__setattr__(self, "period", period_of(self.period, "Signal.period"))

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self.u) * self.dt

    @property
    def time_s(self) -> np.ndarray:
        """Time of every sample, (N,), s."""
        return np.arange(len(self.u)) * self.dt

    @property
    def hold(self) -> int:
        """Samples over which the signal is held: it changes only at whole multiples of so many.

        A constant signal is held throughout.
        """
        changes = 1 + np.flatnonzero((self.u[1:] != self.u[:-1]).any(axis=1))
        return int(np.gcd.reduce(changes)) if len(changes) else len(self.u)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What its generator has to say about it."""
        return () if self.recipe is None else self.recipe.warnings

    def sampled(self, dt: float) -> "Signal":
        """Return the zero-order-held signal sampled every dt seconds; dt must divide, or be a multiple of, the signal's."""
        dt = positive(dt, "Signal.sampled")
        finer, coarser = multiple(self.dt, dt), multiple(dt, self.dt)
        if finer is not None:
            return replace(self, u=np.repeat(self.u, finer, axis=0), dt=dt, period=self.period and self.period * finer)
        if coarser is None:
            raise ExciteError(
                f"Signal.sampled: {dt:g} s is neither a whole fraction nor a whole multiple of the signal's dt {self.dt:g} s"
            )
        period = self.period // coarser if self.period and self.period % coarser == 0 else None
        return replace(self, u=self.u[::coarser], dt=dt, period=period)
