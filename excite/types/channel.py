"""Named channels with units, and the one check that every sample array passes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arguments import positive as positive  # passed on: what has channels has a dt
from excite.arguments import whole
from excite.errors import ExciteError
from excite.types.checked import Checked


@dataclass(frozen=True)
class Channel:
    """One signal's name and unit; `str` and `parse` use the form ``flap [deg]`` of data files."""

    name: str
    unit: str = ""

    def __post_init__(self) -> None:
        if not self.name or self.name != self.name.strip() or "\n" in self.name:
            raise ExciteError(f"channel name {self.name!r}: give a non-empty name on one line, without outer spaces")

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit or self.name.endswith("]") else self.name

    @classmethod
    def parse(cls, text: str) -> "Channel":
        """Read ``name [unit]`` or ``name``."""
        match = re.fullmatch(r"\s*(.*?)\s*(?:\[([^\[\]]*)\])?\s*", text, re.DOTALL)
        assert match is not None  # its first group takes any text
        return cls(match[1], match[2] or "")


# The field of a type that holds channels: names or channels are given, or None for numbered ones.
Channels = Checked[Sequence[Channel | str] | None, tuple[Channel, ...]]


def channels_for(count: int, given: Sequence["Channel | str"] | None, prefix: str) -> tuple[Channel, ...]:
    """Return `count` channels with distinct names: those given, or prefix1, prefix2, …"""
    if given is None:
        return tuple(Channel(f"{prefix}{i + 1}") for i in range(count))
    channels = tuple(c if isinstance(c, Channel) else Channel.parse(c) for c in given)
    if len(channels) != count:
        raise ExciteError(f"channels {prefix}: {len(channels)} names for {count} columns; give one name per column")
    names = [c.name for c in channels]
    if len(set(names)) != count:
        raise ExciteError(f"channels {prefix}: duplicate names in {names}; names must differ")
    return channels


def listed(names: Sequence[object]) -> str:
    """Return names on one line: all of up to eight, else the first six and the last with their number."""
    said = [str(name) for name in names]
    return ", ".join(said) if len(said) <= 8 else f"{', '.join(said[:6])}, … {said[-1]} ({len(said)})"


def samples(values: object, place: str, missing: bool = False) -> np.ndarray:
    """Return `values` as a read-only (N, c) float64 copy; 1-D becomes one column.

    NaN is allowed only where `missing` samples are; infinities, complex numbers, text and empty arrays never.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise ExciteError(f"{place}: values of type {array.dtype} are not real numbers; pass a real array")
    array = np.array(array, dtype=np.float64, order="C")
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.size == 0:
        raise ExciteError(f"{place}: shape {array.shape}; expected (samples, channels) with at least one of each")
    bad = np.isinf(array) if missing else ~np.isfinite(array)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise ExciteError(
            f"{place}: sample {row}, column {column} is {array[row, column]}; "
            + ("replace it by a number, or by NaN if it is missing" if missing else "every value must be finite")
        )
    array.flags.writeable = False
    return array


def period_of(value: object, place: str) -> int | None:
    """Return a period in samples, a positive whole number or None."""
    if value is None:
        return None
    return whole(value, place, remedy="give a positive number of samples, or None")


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
