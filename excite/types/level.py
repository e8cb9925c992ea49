"""Level: what the recorded numbers are measured from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.checked import NOT_GIVEN, Checked

STATES = ("zero", "known", "unknown")

CheckedNumbers = Checked[Sequence[float] | None, tuple[float, ...] | None]


@dataclass(frozen=True)
class Level:
    """The operating point of a record: zero (deviations are recorded), known values, or unknown.

    u0 (nu,), y0 (ny,) : the operating point where it is known, in the channels' units, else None.
    """

    state: str
    u0: CheckedNumbers = NOT_GIVEN
    y0: CheckedNumbers = NOT_GIVEN

    def __post_init__(self) -> None:
        if self.state not in STATES:
            raise ExciteError(f"level: {self.state!r}; {did_you_mean(str(self.state), STATES)}, or give (u0, y0)")
        for key in ("u0", "y0"):
            value = getattr(self, key)
            if (value is not None) != (self.state == "known"):
                raise ExciteError(
                    f"level: {self.state} with {key} = {value!r}; give u0 and y0 where the level is known"
                )
            if value is not None:
                value = tuple(float(each) for each in np.atleast_1d(np.asarray(value, float)))
                if not np.isfinite(value).all():
                    raise ExciteError(f"level: {key} = {value}; give finite numbers, one per channel")
                object.__setattr__(self, key, value)

    @classmethod
    def of(cls, given: "str | Level | tuple[Sequence[float], Sequence[float]]") -> "Level":
        """Return a level from "zero", "unknown", or the pair (u0, y0)."""
        if isinstance(given, Level):
            return given
        if isinstance(given, str):
            return cls(given)
        try:
            u0, y0 = given
            return cls("known", u0, y0)
        except (TypeError, ValueError):
            raise ExciteError(f'level: {given!r}; give "zero", "unknown", or the pair (u0, y0)') from None


# The field of a type that is measured from a level, and its default.
CheckedLevel = Checked[str | Level | tuple[Sequence[float], Sequence[float]], Level]
ZERO: Any = Level("zero")
