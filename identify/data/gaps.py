"""Gaps: a record with missing samples falls into gap-free parts."""

from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from excite.types.experiment import Experiment


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
    parts: list[Experiment] = []
    first: list[int] = []
    start: list[int] = []
    missing = 0
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
