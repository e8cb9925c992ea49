"""Records made fit for identification: gap-free parts, and what no method can use."""

from dataclasses import dataclass, replace

import numpy as np

from excite.errors import ExciteError
from excite.types.experiment import Experiment

LARGEST, SMALLEST = 1e100, 1e-100  # magnitudes whose squares and their sums stay far from overflow and underflow
PROPORTIONAL = 1e-9  # relative difference below which one channel is a multiple of another
BEGINNING = 1000  # samples that as a rule clear a record of suspicion


@dataclass(frozen=True, eq=False)
class GapFree:
    """Gap-free parts of several records.

    parts : experiments without missing samples, record after record; first, start : of each record's first part, its
    position in `parts` and its first sample in the record; samples, missing : in all, and with some value missing.
    """

    parts: tuple[Experiment, ...]
    first: tuple[int, ...]
    start: tuple[int, ...]
    samples: int
    missing: int

    def report(self, span: int) -> str:
        """Say what the gaps cost: missing samples, parts, windows of `span` samples (Hankel columns) left, late starts."""
        columns = sum(max(0, len(part) - span + 1) for part in self.parts)
        late = [f"that of record {k} is the state at its sample {s}" for k, s in enumerate(self.start) if s > 0]
        return (
            f"{self.missing} of {self.samples} samples are incomplete (NaN): {len(self.parts)} gap-free parts, "
            f"{columns} Hankel columns of {span} samples left" + ("; initial state: " + ", ".join(late) if late else "")
        )


def gap_free(data: tuple[Experiment, ...], shortest: int) -> GapFree:
    """Split records at their missing samples.

    Of a record with gaps, the parts with at least `shortest` samples are kept; where none is as long, the longest.
    Raises ExciteError when a record has no sample without a missing value.
    """
    parts, first, start, missing = [], [], [], 0
    for k, record in enumerate(data):
        first.append(len(parts))
        gap = record.incomplete
        if gap is None:
            parts.append(record)
            start.append(0)
            continue
        if gap.all():
            raise ExciteError(
                f"record {k}: each of its {len(record)} samples misses a value; drop the record, or the channel that is empty"
            )
        missing += int(gap.sum())
        edges = np.flatnonzero(np.diff(np.concatenate([[True], gap, [True]]))).reshape(-1, 2)
        lengths = edges[:, 1] - edges[:, 0]
        kept = edges[lengths >= min(shortest, lengths.max())]
        parts += [record.window(a, b) for a, b in kept]
        start.append(int(kept[0, 0]))
    return GapFree(tuple(parts), tuple(first), tuple(start), sum(map(len, data)), missing)


def without_dead_time(data: tuple[Experiment, ...], samples: int) -> tuple[Experiment, ...]:
    """Return y(t) beside u(t - samples), so that the input acts without that dead time; the first `samples` of y fall away."""
    if samples == 0:
        return data
    if samples >= (shortest := min(map(len, data))):
        raise ExciteError(f"input_delay {samples}: the shortest record has only {shortest} samples; give fewer")
    return tuple(replace(record.window(samples), u=record.u[:-samples]) for record in data)


def out_of_range(experiment: Experiment) -> str | None:
    """Return which channel is too large or too small for double precision to square, or None."""
    for values, channels in ((experiment.u, experiment.inputs), (experiment.y, experiment.outputs)):
        beginning = np.abs(values[:BEGINNING]).max(0, initial=0.0)
        if (beginning >= SMALLEST).all() and values.max(initial=0.0) <= LARGEST and values.min(initial=0.0) >= -LARGEST:
            continue  # without a copy of the record; what follows finds the channel
        for i, channel in enumerate(channels):
            size = np.abs(values[:, i])
            peak = np.fmax.reduce(size)
            if peak > LARGEST:
                return (
                    f"channel '{channel.name}' passes {LARGEST:g} at sample {int(np.argmax(size > LARGEST))} and reaches "
                    f"{peak:.3g}: a diverged run, whose squares overflow; keep the part before it grows"
                )
            if 0 < peak < SMALLEST:
                return (
                    f"channel '{channel.name}' stays below {SMALLEST:g}, so that its squares underflow; change its unit"
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
