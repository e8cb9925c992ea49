"""PI-MOESP: past-input MOESP, for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

from identify.data.records import Records
from identify.subspace.moesp import Moesp


@dataclass(frozen=True)
class PiMoesp(Moesp):
    """Past-input MOESP (Verhaegen 1993): MOESP with the past inputs as instrument.

    Consistent for output noise of any colour, which past inputs are not correlated with; states that only the noise
    drives stay hidden. block_rows : s, rows of past and of future each.
    """

    name: ClassVar[str] = "pi_moesp"
    summary: ClassVar[str] = "MOESP with past inputs as instrument; open loop, output noise of any colour"
    seen: ClassVar[tuple[int, int]] = (1, 2)

    def largest_order(self, data: Records) -> int:
        """At most as many as the instrument has rows."""
        return min(super().largest_order(data), self.block_rows * len(data.inputs))
