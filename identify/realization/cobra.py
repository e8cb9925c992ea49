"""COBRA: realization from covariance functions, for open- and closed-loop data of any length."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.estimate import Estimate
from identify.realization.shifted_data import (
    BIASED,
    ShiftedData,
    check_input_rows,
    covariance_input_matrices,
    covariances,
    instruments_of,
    reference_missing,
    scatter,
    shifted_data,
)
from identify.state_space_method import StateSpaceMethod
from identify.steps.completion import Inputs, complete
from identify.steps.compression import joint_segments
from identify.steps.hankel_svd import hankel_of
from identify.steps.shift import Shift

INSTRUMENTS = ("auto", "inputs", "reference")


@dataclass(frozen=True, eq=False)
class CovarianceFunctions:
    """R_u (lags, nu, m) and R_y (lags, ny, m) over all records with instruments (N_i, m), and what all orders share."""

    experiments: tuple[Experiment, ...]
    instruments: tuple[np.ndarray, ...]
    R_u: np.ndarray
    R_y: np.ndarray
    shifted: ShiftedData


@dataclass(frozen=True)
class Cobra(StateSpaceMethod[Records]):
    """Covariance-based realization (Miller 2012, chapter 5).

    R_u(tau) = E u(t + tau) xi(t)^T and R_y with an instrument xi that the noise does not reach obey the plant's own
    equations, R_x(tau + 1) = A R_x(tau) + B R_u(tau), R_y = C R_x + D R_u, whatever the noise. Their block-Hankel
    matrices over first_lag to last_lag are realized as data are: the input rows projected out of r + 1 output block
    rows, A from the shift (5.5), B and D by least squares on the covariances (5.6), which was found as accurate as
    least squares on the samples (medians within 13 %) and holds in closed loop too. Consistent in closed loop with the
    reference as instrument, also when the noise reaches the measured input.

    Every lag is averaged over the same instants, so that noise-free data give the exact system; the estimate as printed
    in 5.1 has ends of relative size lags / N. The number of lags must be at least 2 r + 1 + n (as many inputs as
    instruments). Lags before 0 matter for a coloured input; later lags matter for lightly damped modes, and harm where
    the response has died out. The model has no noise part.

    block_rows : r; first_lag, last_lag : lags in samples, -r and 2 r when not given; instrument : "inputs",
    "reference", or "auto" (inputs in open loop, reference in closed loop); segments : 1, or the pieces of Welch's
    smoothed covariance (5.4.2; 8 in Miller's software, no gain on its Example 5.1); feedthrough : estimate D (else zero).
    """

    name: ClassVar[str] = "cobra"
    summary: ClassVar[str] = (
        "realization from covariance functions with an instrument; open and closed loop, long records"
    )
    consistent_in_closed_loop: ClassVar[bool] = True

    block_rows: int = 20
    first_lag: int | None = field(default=None, metadata={"minimum": -(10**9)})
    last_lag: int | None = field(default=None, metadata={"minimum": -(10**9)})
    instrument: str = field(default="auto", metadata={"choices": INSTRUMENTS})
    segments: int = 1
    feedthrough: bool = False

    def lags(self) -> tuple[int, int]:
        """First and last lag."""
        first = -self.block_rows if self.first_lag is None else self.first_lag
        return first, 2 * self.block_rows if self.last_lag is None else self.last_lag

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: no instrument, or fewer lags than block rows need."""
        if self._uses_reference(data) and (reason := reference_missing(data)):
            accept = (
                ""
                if self.instrument == "reference"
                else " (or accept the bias of a closed loop: instrument = 'inputs')"
            )
            return reason + accept
        if self.largest_order(data) < 1:
            first, last = self.lags()
            nu, m = len(data.inputs), self._channels(data)
            needed = self.block_rows + -(-((self.block_rows + 1) * nu + 1) // m)
            return (
                f"first_lag {first} to last_lag {last} are {max(0, last - first + 1)} lags; block_rows {self.block_rows} with "
                f"{nu} inputs and {m} instruments need at least {needed} for order 1, and more for more; widen the range "
                "or lower block_rows"
            )
        return None

    def span(self, order: int | None) -> int:
        """Samples that one product at every lag reaches over."""
        first, last = self.lags()
        return max(0, last) - min(0, first) + 1

    def required_excitation(self, order: int | None) -> int:
        """Block rows of the input, r + 1, which are projected out."""
        return self.block_rows + 1

    def sufficient_excitation(self, order: int | None) -> int:
        """All lags and the order: then the covariances hold every trajectory of that length."""
        first, last = self.lags()
        return last - first + 1 + (order or 0)

    def largest_order(self, data: Records) -> int:
        """Columns left when the input rows are projected out, at most r ny."""
        first, last = self.lags()
        columns = (last - first + 1 - self.block_rows) * self._channels(data)
        return min(self.block_rows * len(data.outputs), columns - (self.block_rows + 1) * len(data.inputs))

    def singular_values(self, factor: CovarianceFunctions) -> np.ndarray:
        """Return those of the projected block-Hankel matrix."""
        return factor.shifted.svd.values

    def compress(self, data: Records) -> CovarianceFunctions:
        """Covariance functions of all records over the lags."""
        parts = data.parts(self.span(1))
        joint_segments(parts)  # refuses constant channels
        reference, (first, last) = self._uses_reference(data), self.lags()
        instruments = instruments_of(parts, reference)
        R_u, R_y = covariances(parts, instruments, first, last, self.segments)
        check_input_rows(hankel_of(R_u, self.block_rows + 1), parts, self.block_rows + 1)
        return CovarianceFunctions(parts, instruments, R_u, R_y, shifted_covariances(R_u, R_y, self.block_rows))

    def realize(self, factor: CovarianceFunctions, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        parts, shifted = factor.experiments, factor.shifted
        shift = Shift.of_pair(shifted.svd, shifted.shifted, order)
        A, notes = self.dynamics(shift)
        B, D = covariance_input_matrices(factor.R_u, factor.R_y, A, shift.C, self.feedthrough)
        start, stop = self.lags()
        reference = self._uses_reference(data)
        biased = not reference and data.closed
        products = sum(max(0, len(e) - self.span(order) + 1) for e in parts)
        return complete(
            self.name,
            parts,
            A,
            shift.C,
            inputs=Inputs(B, D),
            uncertainty=scatter(shifted, parts, None if biased else factor.instruments, products),
            singular_values=shifted.svd.values,
            warnings=(*notes, *(BIASED,) * biased),
            route=f"covariances with {'the reference' if reference else 'the inputs'}, lags {start} to {stop}",
        )

    def _uses_reference(self, data: Records) -> bool:
        return self.instrument == "reference" or (self.instrument == "auto" and data.closed)

    def _channels(self, data: Records) -> int:
        """Channels of the instrument."""
        return len(data.measured[0].references if self._uses_reference(data) else data.inputs)


def shifted_covariances(R_u: np.ndarray, R_y: np.ndarray, rows: int) -> ShiftedData:
    """Block-Hankel matrices of covariance functions with the input rows projected out, Miller (2012), eq. (5.2)-(5.4)."""
    return shifted_data(hankel_of(R_u, rows + 1), hankel_of(R_y, rows + 1), *R_y.shape[1:])
