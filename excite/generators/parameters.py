"""What every generator checks of its parameters; each error reads ``generator: parameter: value; remedy``."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arguments import (
    LARGEST,
    LARGEST_WHOLE,
    bad,
    choice,
    flag,
    is_number,
    is_whole,
    number,
    one_per_channel,
    whole,
)
from excite.errors import ExciteError
from excite.types.channel import Channel, channels_for

Channels = int | str | Channel | Sequence[str | Channel]
MAX_VALUES = 2 * 10**8  # float64 values of one signal: 1.6 GB
MAX_CHANNELS = 256
SMALLEST = 1e-150  # of positive numbers: products of two keep all digits, and so do their reciprocals


@dataclass(frozen=True)
class Parameters:
    """The checker of `excite.arguments` for one generator, which `kind` names in every message."""

    kind: str

    def place(self, name: str) -> str:
        """Return what a parameter is called in messages."""
        return f"{self.kind}: {name}"

    def bad(self, name: str, value: object, remedy: str) -> ExciteError:
        """Return the error that names a parameter, its value and the remedy."""
        return bad(self.place(name), value, remedy)

    def whole(self, name: str, value: object, least: int = 1, most: float = LARGEST_WHOLE) -> int:
        """Return a whole number of at least `least` and at most `most`."""
        return whole(value, self.place(name), least, most)

    def seed(self, value: object) -> int:
        """Return the seed, a whole number from 0 of any size."""
        return self.whole("seed", value, 0, np.inf)

    def number(
        self,
        name: str,
        value: object,
        remedy: str,
        least: float = -LARGEST,
        above: float = -np.inf,
        most: float = LARGEST,
    ) -> float:
        """Return a number of at least `least`, beyond `above` and of at most `most`, small enough for sums to be finite."""
        found = number(value, self.place(name), least, above, most, remedy)
        if above == 0 and found < SMALLEST:
            raise self.bad(name, value, f"nothing below {SMALLEST:g} is computed with; change the unit")
        return found

    def seconds(self, name: str, value: object) -> float:
        """Return a positive number of seconds."""
        return self.number(name, value, "give a positive number of seconds", above=0)

    def frequency(self, name: str, value: object, dt: float) -> float:
        """Return a frequency in Hz, above 0 and up to the Nyquist frequency."""
        f_hz = self.number(name, value, "give a positive number of Hz", above=0)
        if f_hz * dt > 0.5 * (1 + 1e-12):
            raise self.bad(name, value, f"it exceeds the Nyquist frequency {0.5 / dt:g} Hz; lower it, or sample faster")
        return f_hz

    def flag(self, name: str, value: object) -> bool:
        """Return true or false."""
        return flag(value, self.place(name))

    def choice(self, name: str, value: object, known: Collection[str]) -> str:
        """Return one of the known words."""
        return choice(value, self.place(name), known)

    def samples(self, name: str, value: object, dt: float) -> int:
        """Return the samples nearest to a positive time in s, at least one."""
        ratio = self.seconds(name, value) / dt
        if not 0.5 < ratio < 2**53:
            raise self.bad(name, value, f"it must span at least one sample of dt = {dt:g} s, and fewer than 2^53")
        return round(ratio)

    def pause(self, name: str, value: object, dt: float) -> int:
        """Return the samples nearest to a time in s that may be 0."""
        seconds = self.number(name, value, "give a number of seconds, 0 for none", least=0)
        return self.samples(name, value, dt) if seconds else 0

    def channels(self, channels: Channels) -> tuple[Channel, ...]:
        """Return the channels that a count or names ask for."""
        if isinstance(channels, bool) or is_whole(channels):
            count = self.whole("channels", channels)
            if count > MAX_CHANNELS:
                raise self.bad("channels", count, f"at most {MAX_CHANNELS} are played together; give fewer")
            return channels_for(count, None, "u")
        if not isinstance(channels, (str, Channel, Iterable)):
            raise self.bad("channels", channels, "give their count, or their names")
        names = [channels] if isinstance(channels, (str, Channel)) else list(channels)
        if not names:
            raise self.bad("channels", channels, "name at least one")
        if not all(isinstance(name, (str, Channel)) for name in names):
            raise self.bad("channels", channels, "give every channel a name")
        return channels_for(len(names), names, "u")

    def items(self, name: str, value: object, remedy: str) -> list:
        """Return the items of a list or an array, at least one; a number is a list of one."""
        if is_number(value):
            return [value]
        value = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(value, Sequence) or isinstance(value, str) or not value:
            raise self.bad(name, value, remedy)
        return list(value)

    def amplitudes(self, name: str, value: object, count: int, of: str = "channels") -> list[float]:
        """Return a positive finite number per channel, from one number or one per channel."""
        remedy = f"every {name} must be positive and finite"
        return one_per_channel(value, self.place(name), count, lambda x: x > 0, remedy, of)

    def offsets(self, name: str, value: object, count: int) -> list[float]:
        """Return a finite number per channel, from one number or one per channel."""
        return one_per_channel(value, self.place(name), count, np.isfinite, f"every {name} must be finite")

    def nonzero(self, name: str, value: object, count: int) -> list[float]:
        """Return a finite number other than 0 per channel, from one number or one per channel."""
        remedy = f"every {name} must be finite and not zero"
        return one_per_channel(value, self.place(name), count, lambda x: x != 0, remedy)

    def bounded(self, name: str, value: object, samples: int, count: int, remedy: str) -> None:
        """Refuse a signal that does not fit into memory, before anything is allocated."""
        if samples * count > MAX_VALUES:
            size = f"{samples} samples x {count} channels exceed {MAX_VALUES} values ({MAX_VALUES * 8 / 1e9:g} GB)"
            raise self.bad(name, value, f"{size}; {remedy}")

    def fill(self, form: str, used: Mapping[str, object], given: Mapping[str, object]) -> dict[str, Any]:
        """Return the values of a form's parameters: those given, else the defaults of `used` (...: required).

        A value given for a parameter that the form does not use is refused, not ignored.
        """
        for name, value in given.items():
            if name not in used and value is not None:
                raise self.bad(name, value, f"the form '{form}' does not use it; leave it out")
            if used.get(name) is ... and value is None:
                raise self.bad(name, value, f"the form '{form}' needs it")
        return {name: given[name] if given[name] is not None else default for name, default in used.items()}
