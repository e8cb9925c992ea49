"""Records: measured experiments, checked once by `fit` and trusted by every method."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from excite.errors import ExciteError
from excite.models.frequency_response import FrequencyResponse
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from identify.data.gaps import GapFree, gap_free

SAME_DT = 1e-6  # relative difference of sampling times that is rounding
LARGEST, SMALLEST = 1e100, 1e-100  # magnitudes whose squares and their sums stay far from overflow and underflow
PROPORTIONAL = 1e-9  # relative difference below which one channel is a multiple of another
BEGINNING = 1000  # samples that as a rule clear a record of suspicion


class Kind(Enum):
    """Kinds of data that a method may take; the value names them in messages."""

    SERIES = "input-output records"
    OUTPUTS = "outputs alone"
    IMPULSES = "impulse responses or free decays"
    STEPS = "step responses"
    UNEVEN_STEPS = "step responses at any instants"
    FREQUENCY = "frequency responses"


@dataclass(frozen=True, eq=False)
class Records:
    """One or several measured experiments with the same channels and sampling time.

    measured : as they were given, one record each. What holds for all of them: inputs, outputs, dt (None where a record
    is sampled at uneven instants), closed (whether some record was taken in closed loop).
    """

    measured: tuple[Experiment, ...]
    _gap_free: dict[int, GapFree] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, data: "Experiment | Iterable[Experiment] | Records") -> "Records":
        """Return checked records; raises ExciteError naming the record that differs from the first."""
        if isinstance(data, Records):
            return data
        measured = (data,) if isinstance(data, Experiment) else tuple(data)
        if not measured:
            raise ExciteError("no experiment given; pass at least one")
        for k, record in enumerate(measured):
            if not isinstance(record, Experiment):
                raise ExciteError(f"record {k}: a {type(record).__name__}; pass an Experiment")
        first = measured[0]
        for k, other in enumerate(measured[1:], 1):
            for what in ("inputs", "outputs"):
                if getattr(other, what) != getattr(first, what):
                    raise ExciteError(
                        f"experiment {k}: its {what} differ from those of experiment 0; pass like with like"
                    )
            if _differ(first.dt, other.dt):
                raise ExciteError(
                    f"experiment {k}: dt {other.dt} s differs from {first.dt} s of experiment 0; resample one"
                )
        return cls(measured)

    def __len__(self) -> int:
        return len(self.measured)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Channels of u."""
        return self.measured[0].inputs

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Channels of y."""
        return self.measured[0].outputs

    @property
    def dt(self) -> float | None:
        """Sampling time in s, None at uneven instants."""
        return self.measured[0].dt

    @property
    def closed(self) -> bool:
        """Whether some record was taken in closed loop."""
        return any(record.loop.closed for record in self.measured)

    def gap_free(self, span: int) -> GapFree:
        """Return the gap-free parts of at least `span` samples, and what the gaps cost."""
        if span not in self._gap_free:
            self._gap_free[span] = gap_free(self.measured, span)
        return self._gap_free[span]

    def parts(self, span: int) -> tuple[Experiment, ...]:
        """Return the gap-free parts of at least `span` samples."""
        return self.gap_free(span).parts

    def place(self, k: int) -> str:
        """Return what messages put before a reason that concerns record k."""
        return f"record {k}: " if len(self.measured) > 1 else ""

    def without_dead_time(self, samples: int) -> "Records":
        """Return y(t) beside u(t - samples), so that the input acts without that dead time.

        The first `samples` of y fall away.
        """
        if samples == 0:
            return self
        if samples >= (shortest := min(map(len, self.measured))):
            raise ExciteError(f"input_delay {samples}: the shortest record has only {shortest} samples; give fewer")
        return Records(tuple(replace(record.window(samples), u=record.u[:-samples]) for record in self.measured))

    def deviations(self) -> "Records":
        """Return the records about their level, where it is known; raises ExciteError where nobody knows it."""
        levels = [record.level for record in self.measured]
        for k, level in enumerate(levels):
            if level.state == "unknown":
                raise ExciteError(
                    f"{self.place(k)}level unknown: no method estimates the operating point with the model yet; give the "
                    'level (u0, y0), or "zero" for records of deviations'
                )
        if all(level.state == "zero" for level in levels):
            return self
        return Records(tuple(_about(record, self.place(k)) for k, record in enumerate(self.measured)))


Data = Records | FrequencyResponse


def _differ(dt: float | None, other: float | None) -> bool:
    """Whether two sampling times are not the same; None is that of uneven instants."""
    if dt is None or other is None:
        return dt is not other
    return abs(other / dt - 1) > SAME_DT


def _about(record: Experiment, place: str) -> Experiment:
    """Return a record about its known level."""
    level = record.level
    if level.u0 is None or level.y0 is None:
        return record
    for key, values, channels in (("u0", level.u0, record.inputs), ("y0", level.y0, record.outputs)):
        if len(values) != len(channels):
            raise ExciteError(
                f"{place}level: {key} has {len(values)} numbers for {len(channels)} channels; give one each"
            )
    return replace(
        record, u=record.u - level.u0, y=record.y - level.y0, references=record.references or None, level="zero"
    )


def mismatch(takes: frozenset[Kind], data: Data) -> str | None:
    """Return why a method that takes these kinds cannot take the data, or None."""
    if isinstance(data, FrequencyResponse):
        wanted = ", ".join(kind.value for kind in Kind if kind in takes)
        return None if Kind.FREQUENCY in takes else f"the data are a frequency response, and this method takes {wanted}"
    if takes == {Kind.FREQUENCY}:
        return "the data are records over time, and this method takes frequency responses; estimate one first"
    if data.inputs and takes == {Kind.OUTPUTS}:
        return (
            f"the data have inputs ('{data.inputs[0].name}'), whose effect an output-only method takes for noise; name "
            "no input, or use a method for inputs and outputs"
        )
    if not data.inputs and not takes & {Kind.OUTPUTS, Kind.IMPULSES}:
        return "the data have no input, and this method identifies the path from inputs to outputs; name the inputs"
    if Kind.UNEVEN_STEPS not in takes:
        for k, record in enumerate(data.measured):
            if record.dt is None:
                return f"{data.place(k)}sampling is not uniform, and this method needs one sampling time; resample the record"
    return None


def missing_sample(data: Records) -> str | None:
    """Return which sample is missing first, for methods that take no gaps, or None."""
    for k, record in enumerate(data.measured):
        for values, channels in ((record.u, record.inputs), (record.y, record.outputs)):
            if (missing := np.isnan(values)).any():
                row, column = np.argwhere(missing)[0]
                return (
                    f"{data.place(k)}sample {row} of channel '{channels[column].name}' is missing (NaN), {missing.sum()} "
                    "in all; fill them or give the gap-free parts as separate records"
                )
    return None


def out_of_range(data: Records) -> str | None:
    """Return which channel is too large or too small for double precision to square, or None."""
    for k, record in enumerate(data.measured):
        for values, channels in ((record.u, record.inputs), (record.y, record.outputs)):
            if reason := _out_of_range(values, channels):
                return data.place(k) + reason
    return None


def _out_of_range(values: np.ndarray, channels: Sequence[Channel]) -> str | None:
    beginning = np.abs(values[:BEGINNING]).max(0, initial=0.0)
    if (beginning >= SMALLEST).all() and values.max(initial=0.0) <= LARGEST and values.min(initial=0.0) >= -LARGEST:
        return None  # without a copy of the record; what follows finds the channel
    for i, channel in enumerate(channels):
        size = np.abs(values[:, i])
        peak = np.fmax.reduce(size)
        if peak > LARGEST:
            return (
                f"channel '{channel.name}' passes {LARGEST:g} at sample {int(np.argmax(size > LARGEST))} and reaches "
                f"{peak:.3g}: a diverged run, whose squares overflow; keep the part before it grows"
            )
        if 0 < peak < SMALLEST:
            return f"channel '{channel.name}' stays below {SMALLEST:g}, so that its squares underflow; change its unit"
    return None


def constant(parts: tuple[Experiment, ...]) -> str | None:
    """Return which input or output never moves, and what to do, or None."""
    for key, role in (("u", "inputs"), ("y", "outputs")):
        first = getattr(parts[0], key)[:1]
        still = np.ones(first.shape[1], bool)
        for part in parts:
            signal = getattr(part, key)
            for start in range(0, len(signal), BEGINNING):
                if not still.any():  # as a rule after the first thousand samples
                    break
                still &= (signal[start : start + BEGINNING] == first).all(0)
        for i in np.flatnonzero(still):
            name, value = getattr(parts[0], role)[i].name, first[0, i]
            if key == "y":
                return f"output '{name}' is constant ({value:g}); drop the channel"
            return (
                f"input '{name}' is constant ({value:g}), so it is persistently exciting of order {int(value != 0)} only; "
                "excite it or drop the channel"
            )
    return None


def proportional(parts: tuple[Experiment, ...]) -> str | None:
    """Return which two inputs or two outputs are multiples of each other in every sample, or None."""
    for key, role, remedy in (
        ("u", "inputs", "their effects cannot be told apart; excite them independently or drop one"),
        ("y", "outputs", "they say the same; drop one"),
    ):
        signals, channels = [getattr(part, key) for part in parts], getattr(parts[0], role)
        if len(channels) > 1 and (pair := _proportional_columns(signals)):
            names = " and ".join(f"'{channels[i].name}'" for i in pair)
            return f"{role} {names} are multiples of each other in every sample, so that {remedy}"
    return None


def _proportional_columns(signals: list[np.ndarray]) -> tuple[int, int] | None:
    if len(signals[0]) > BEGINNING and _proportional_columns([signals[0][:BEGINNING]]) is None:
        return None  # what differs there is not proportional anywhere
    gram = sum(w.T @ w for w in signals)
    norm = np.sqrt(np.diag(gram))
    size = np.where(norm > 0, norm, 1.0)
    alike = np.abs(gram / np.outer(size, size)) > 1 - PROPORTIONAL
    for i, j in np.argwhere(np.triu(alike, 1)):
        ratio = gram[i, j] / norm[i] ** 2
        apart = sum(np.sum((w[:, j] - ratio * w[:, i]) ** 2) for w in signals)
        if apart <= (PROPORTIONAL * norm[j]) ** 2:
            return int(i), int(j)
    return None
