"""MOESP: ordinary multivariable output-error state space, and what its family shares; for open-loop data."""

from dataclasses import dataclass
from typing import ClassVar

from identify.examples import Example, white_output_noise
from identify.steps.compression import PastFuture, future_lq, left_svd
from identify.subspace.subspace_method import Subspace, SubspaceMethod


@dataclass(frozen=True)
class Moesp(SubspaceMethod):
    """Ordinary MOESP (Verhaegen and Dewilde 1992): no instrument.

    [U_f; W; Y_f] = L Q with W the instrument, here none: the range of what U_f leaves of Y_f, seen through W, is range
    Gamma_f; A and C by shift invariance, K by regression on the state that Gamma_f and the past give, B, D and x0 by
    least squares on all samples (simulation; one-step predictor when the data are from a closed loop). Without an
    instrument it is consistent only for white noise of equal size on the outputs. Biased in closed loop, as its whole
    family: there u is correlated with past noise.

    block_rows : s, rows of past and of future each.
    """

    name: ClassVar[str] = "moesp"
    summary: ClassVar[str] = "ordinary MOESP, no instrument; open loop, white output noise"
    seen: ClassVar[tuple[int, int]] = (1, 4)  # groups of Q in [U_f; U_p; Y_p; Y_f] = L Q that Y_f is seen through

    feedthrough: bool = True
    block_rows: int = 20

    def horizons(self) -> tuple[int, int]:
        """(s, s)."""
        return self.block_rows, self.block_rows

    def example(self, noise: float, length: int) -> Example | None:
        """White noise on the outputs, which is all that this method stands without an instrument."""
        return white_output_noise(noise, length) if type(self) is Moesp else None

    def decompose(self, factor: PastFuture) -> Subspace:
        """SVD of the part of Y_f that the instrument explains beyond U_f."""
        future = future_lq(factor)
        left, values = left_svd(future.L[future.groups(3, 4), future.groups(*self.seen)])
        return Subspace.of_gamma(left, values, future.on_past)
