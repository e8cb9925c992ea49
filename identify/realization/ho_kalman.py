"""Ho-Kalman realization of impulse responses and free decays, after Kung."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from identify.method import Data, experiments
from identify.realization.impulse_responses import ResponseFactor, ResponseMethod, impulse_responses, response_columns
from identify.steps.hankel_svd import hankel_svd, kung


@dataclass(frozen=True)
class HoKalman(ResponseMethod):
    """Kung's method (Kung 1978; Ho and Kalman 1966; seed 001, sections 2.1-2.3).

    H = [G(i + j - 1)] of all parameters that the records hold is reduced to rank n by its SVD, H ~ (U S^1/2)(S^1/2 V^T)
    = Gamma Delta. C and B are the first blocks; A = pinv(Gamma without its last block row) (Gamma without its first):
    print (2.8) has the two exchanged, which gives A^-1. D is the first sample. `era` takes A from the shifted Hankel
    matrix instead.

    block_rows : rows of H; the columns are those that the shortest record leaves.
    """

    name: ClassVar[str] = "ho_kalman"
    summary: ClassVar[str] = "Kung's SVD realization of impulse responses or free decays; A from shift invariance"
    beyond: ClassVar[int] = 0

    def largest_order(self, data: Data) -> int:
        """Rank of H less the block row that the shift costs."""
        data = experiments(data)
        columns = self.most_columns(data) * response_columns(data)
        return min((self.block_rows - 1) * data[0].y.shape[1], columns)

    def prepare(self, data: Data) -> ResponseFactor:
        """Read the responses and factor H."""
        responses = impulse_responses(experiments(data))
        return ResponseFactor(responses, hankel_svd(responses.markov, self.block_rows))

    def system(self, factor: ResponseFactor, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A by shift invariance of Gamma."""
        return kung(factor.svd, order)
