"""PO-MOESP: past-output MOESP, for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

from identify.subspace.moesp import Moesp


@dataclass(frozen=True)
class PoMoesp(Moesp):
    """Past-output MOESP (Verhaegen 1994) in the LQ form of Kee (2013), eq. (3.16)-(3.17).

    MOESP with past inputs and outputs as instrument: [U_f; U_p; Y_p; Y_f] = L Q over N - 2 s + 1 columns; range [L42 L43] =
    range Gamma_f. block_rows : s, rows of past and of future each.
    """

    name: ClassVar[str] = "po_moesp"
    summary: ClassVar[str] = "past-output MOESP; open loop"
    seen: ClassVar[tuple[int, int]] = (1, 3)
