"""Ho-Kalman realization of impulse responses and free decays, after Kung."""

from dataclasses import dataclass
from typing import ClassVar

from identify.data.records import Records
from identify.realization.impulse_responses import ResponseFactor, ResponseMethod, impulse_responses, response_columns
from identify.steps.hankel_svd import hankel_svd
from identify.steps.shift import Shift


@dataclass(frozen=True)
class HoKalman(ResponseMethod):
    """Kung's method (Kung 1978; Ho and Kalman 1966; Miller 2012, sections 2.1-2.3).

    H = [G(i + j - 1)] of all parameters that the records hold is reduced to rank n by its SVD, H ~ (U S^1/2)(S^1/2 V^T)
    = Gamma Delta. C and B are the first blocks; A = pinv(Gamma without its last block row) (Gamma without its first):
    print (2.8) has the two exchanged, which gives A^-1. D is the first sample. `era` takes A from the shifted Hankel
    matrix instead.

    block_rows : rows of H; the columns are those that the shortest record leaves.
    """

    name: ClassVar[str] = "ho_kalman"
    summary: ClassVar[str] = "Kung's SVD realization of impulse responses or free decays; A from shift invariance"
    beyond: ClassVar[int] = 0

    def largest_order(self, data: Records) -> int:
        """Rank of H less the block row that the shift costs."""
        columns = self.most_columns(data) * response_columns(data.measured)
        return min((self.block_rows - 1) * len(data.outputs), columns)

    def compress(self, data: Records) -> ResponseFactor:
        """Read the responses and factor H."""
        responses = impulse_responses(data.measured)
        return ResponseFactor(responses, hankel_svd(responses.markov, self.block_rows))

    def shift(self, factor: ResponseFactor, order: int) -> Shift:
        """A by shift invariance of Gamma."""
        return Shift.of_gamma(factor.svd.gamma(order), factor.svd.ny)
