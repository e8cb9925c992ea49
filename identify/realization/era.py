"""ERA: the eigensystem realization algorithm for impulse responses and free decays."""

from dataclasses import dataclass
from typing import ClassVar

from identify.data.records import Records
from identify.realization.impulse_responses import ResponseFactor, ResponseMethod, impulse_responses, response_columns
from identify.steps.hankel_svd import hankel_of, hankel_svd
from identify.steps.shift import Shift


@dataclass(frozen=True)
class Era(ResponseMethod):
    """Eigensystem realization algorithm (Juang and Pappa 1985; Miller 2012, section 2.3.2).

    From the Hankel matrices H(0) = U S V^T of h_1, h_2, … and H(1), one sample later, A = S^-1/2 U^T H(1) V S^-1/2; C and
    B are the first blocks of U S^1/2 and S^1/2 V^T, D is the first sample. Decays are columns beside those of the
    inputs. `ho_kalman` uses H(0) alone and takes A from the shift of U S^1/2.

    block_rows, block_columns : shape of H(0) in blocks (columns None: all that the shortest record leaves).
    """

    name: ClassVar[str] = "era"
    summary: ClassVar[str] = (
        "eigensystem realization of impulse responses or free decays; A from the shifted Hankel matrix"
    )
    beyond: ClassVar[int] = 1

    block_columns: int | None = None

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: no impulses or decays, or too short for the blocks."""
        if reason := super().unsupported(data):
            return reason
        most = self.most_columns(data)
        if self.block_columns is not None and self.block_columns > most:
            return f"block_columns {self.block_columns} with block_rows {self.block_rows}: the records allow at most {most}"
        return None

    def columns(self, data: Records) -> int:
        """Block columns of H(0)."""
        return self.block_columns or self.most_columns(data)

    def largest_order(self, data: Records) -> int:
        """Rank of H(0)."""
        return min(self.block_rows * len(data.outputs), self.columns(data) * response_columns(data.measured))

    def compress(self, data: Records) -> ResponseFactor:
        """Read the responses, factor H(0) and form H(1)."""
        responses = impulse_responses(data.measured)
        markov = responses.markov[: self.block_rows + self.columns(data)]
        return ResponseFactor(
            responses, hankel_svd(markov[:-1], self.block_rows), hankel_of(markov[1:], self.block_rows)
        )

    def shift(self, factor: ResponseFactor, order: int) -> Shift:
        """A from H(1)."""
        assert factor.shifted is not None  # `compress` keeps it
        return Shift.of_pair(factor.svd, factor.shifted, order)
