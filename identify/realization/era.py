"""ERA: the eigensystem realization algorithm for impulse responses and free decays."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.errors import ExciteError
from identify.method import Data, experiments
from identify.realization.impulse_responses import ResponseFactor, ResponseMethod, impulse_responses, response_columns
from identify.steps.hankel_svd import era, hankel_of, hankel_svd


@dataclass(frozen=True)
class Era(ResponseMethod):
    """Eigensystem realization algorithm (Juang and Pappa 1985; seed 001, section 2.3.2).

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

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.block_columns
        if given is not None and (isinstance(given, bool) or not isinstance(given, int) or given < 1):
            raise ExciteError(f"era.block_columns: {given!r}; give a whole number of at least 1, or none for all")

    def unsupported(self, data: Data) -> str | None:
        """Return why these data do not suit: no impulses or decays, or too short for the blocks."""
        if reason := super().unsupported(data):
            return reason
        most = self.most_columns(experiments(data))
        if self.block_columns is not None and self.block_columns > most:
            return f"block_columns {self.block_columns} with block_rows {self.block_rows}: the records allow at most {most}"
        return None

    def columns(self, data: Data) -> int:
        """Block columns of H(0)."""
        return self.block_columns or self.most_columns(experiments(data))

    def largest_order(self, data: Data) -> int:
        """Rank of H(0)."""
        data = experiments(data)
        return min(self.block_rows * data[0].y.shape[1], self.columns(data) * response_columns(data))

    def prepare(self, data: Data) -> ResponseFactor:
        """Read the responses, factor H(0) and form H(1)."""
        responses = impulse_responses(experiments(data))
        markov = responses.markov[: self.block_rows + self.columns(data)]
        return ResponseFactor(
            responses, hankel_svd(markov[:-1], self.block_rows), hankel_of(markov[1:], self.block_rows)
        )

    def system(self, factor: ResponseFactor, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A from H(1)."""
        return era(factor.svd, factor.shifted, order)
