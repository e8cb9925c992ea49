"""Input-output realization: shift invariance in the output data, with an instrument against coloured noise."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from excite.numerics.correlation import Joint
from excite.numerics.hankel import HankelFactor, hankel_factor
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
from identify.steps.compression import joint_segments, orthonormal
from identify.steps.input_matrices import input_matrices
from identify.steps.kalman import spectral_radius
from identify.steps.shift import Shift

INSTRUMENTS = ("auto", "none", "past_inputs", "reference")


@dataclass(frozen=True, eq=False)
class ShiftedRecords:
    """The shifted data of all records, with their instruments (N_i, m) or None, compressed by `hankel`."""

    experiments: tuple[Experiment, ...]
    instruments: tuple[np.ndarray, ...] | None
    hankel: HankelFactor
    shifted: ShiftedData


@dataclass(frozen=True)
class IoRealization(StateSpaceMethod[Records]):
    """Realization by shift invariance in the output data (Miller 2012, chapter 4).

    Y_(0|r-1) = O X + T' U_(0|r) + V and Y_(1|r) = O A X + T U_(0|r) + V' are seen through an instrument Z that the
    noise does not reach, the inputs projected out of both, and A = S^-1/2 U^T Y' V S^-1/2 taken from the SVD of the
    first (4.27). With Q_Z an orthonormal basis of the rows of Z,

        H = Y_(0|r-1) Q_Z^T N,   H' = Y_(1|r) Q_Z^T N,   N the null space of U_(0|r) Q_Z^T.

    Z = [U_(-p|-1); U_(0|r)] ("past_inputs") is Miller's Y Pi_(U^perp) Z^T up to the weight of its columns. In closed
    loop Y Pi_(U^perp) Z^T as printed is biased with any Z, since V U_(0|r)^T does not vanish; with the reference from p
    samples before to r after as Z, applied before the inputs are projected out, it is not. Without instrument (Q_Z = I)
    coloured noise biases the poles, also when it shares A's (4.4 denies that).

    B, D and x0 follow by least squares on all samples; with the reference as instrument (which a noisy input needs as
    well), in closed loop, or when A is not stable, B and D from the covariances with the instrument at lags -p to 2 r.
    The model has no noise part.

    block_rows : r; past : p; instrument : "none", "past_inputs", "reference" (any signal that moves the input and is
    free of the noise can be recorded as reference), or "auto": the reference in closed loop, past inputs in open loop;
    feedthrough : estimate D (else zero).
    """

    name: ClassVar[str] = "io_realization"
    summary: ClassVar[str] = "shift invariance in the output data with an instrument; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    block_rows: int = 20
    past: int = 20
    instrument: str = field(default="auto", metadata={"choices": INSTRUMENTS})
    feedthrough: bool = False

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: no reference, or too few of them, where it has to be the instrument."""
        if self._instrument(data) == "reference" and (reason := reference_missing(data)):
            biased = (
                ""
                if self.instrument == "reference"
                else "; instrument = 'past_inputs' accepts the bias of a closed loop"
            )
            return reason + biased
        if self.largest_order(data) < 1:
            nu, m, rows = len(data.inputs), len(data.measured[0].references), self.block_rows + 1
            return (
                f"{nu} inputs and {m} reference channels leave no order: past {self.past} is too short for {rows} rows of "
                f"the inputs; give past at least {rows * nu // m + 1 - rows}, or record as many references as inputs"
            )
        return None

    def span(self, order: int | None) -> int:
        """p + r + 1."""
        return self.past + self.block_rows + 1

    def required_excitation(self, order: int | None) -> int:
        """Block rows of the input, r + 1, which are projected out."""
        return self.block_rows + 1

    def sufficient_excitation(self, order: int | None) -> int:
        """Order + p + r + 1: Willems' lemma for all trajectories of length p + r + 1."""
        return (order or 0) + self.span(order)

    def largest_order(self, data: Records) -> int:
        """r ny, and no more than the instrument's rows beyond those of the input."""
        rows, nu, ny = self.block_rows + 1, len(data.inputs), len(data.outputs)
        which = self._instrument(data)
        if which == "none":
            return self.block_rows * ny
        m = nu if which == "past_inputs" else len(data.measured[0].references)
        return min(self.block_rows * ny, (self.past + rows) * m - rows * nu)

    def singular_values(self, factor: ShiftedRecords) -> np.ndarray:
        """Return those of the projected outputs."""
        return factor.shifted.svd.values

    def compress(self, data: Records) -> ShiftedRecords:
        """Compress the records, bring the instrument in, project the inputs out."""
        parts = data.parts(self.span(1))
        which, rows = self._instrument(data), self.block_rows + 1
        past = 0 if which == "none" else self.past
        nu, ny = len(data.inputs), len(data.outputs)
        segments, instruments = joint_segments(parts), instruments_of(parts, which == "reference")
        if which == "reference":
            segments = [Joint((*w.parts, z)) for w, z in zip(segments, instruments, strict=True)]
        hankel = hankel_factor(segments, past + rows)
        U = hankel.L[hankel.index(slice(0, nu), past, past + rows)]
        Y = hankel.L[hankel.index(slice(nu, nu + ny), past, past + rows)]
        if which == "none":
            check_input_rows(U, parts, rows)
            return ShiftedRecords(parts, None, hankel, shifted_data(U, Y, ny, len(hankel.L)))
        m = instruments[0].shape[1]
        channels = slice(0, nu) if which == "past_inputs" else slice(nu + ny, None)
        Z = hankel.L[hankel.index(channels, 0, past + rows)]
        Z = Z.reshape(-1, m, len(hankel.L))[::-1].reshape(Z.shape)  # lags of v on z ascend as z moves back
        W, Q = orthonormal(Z)
        U, Y = U @ Q.T, Y @ Q.T
        check_input_rows(U, parts, rows)
        shifted = shifted_data(U, Y, ny, m)
        return ShiftedRecords(parts, instruments, hankel, replace(shifted, columns=W.T @ shifted.columns))

    def realize(self, factor: ShiftedRecords, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        parts, shifted = factor.experiments, factor.shifted
        shift = Shift.of_pair(shifted.svd, shifted.shifted, order)
        A, notes = self.dynamics(shift)
        reference = self._instrument(data) == "reference"
        biased = not reference and data.closed
        notes += (BIASED,) * biased
        if reference or biased or spectral_radius(A) >= 1:
            if not (reference or biased):
                notes += ("A is not stable, so B and D were fitted to covariances with the input, not by simulation",)
            instruments = factor.instruments or tuple(e.u for e in parts)
            R_u, R_y = covariances(parts, instruments, -self.past, 2 * self.block_rows)
            inputs = Inputs(*covariance_input_matrices(R_u, R_y, A, shift.C, self.feedthrough))
        else:
            found = input_matrices(parts, A, shift.C, np.zeros(shift.C.T.shape), self.feedthrough)
            inputs = Inputs(found.B, found.D, found.x0)
        return complete(
            self.name,
            parts,
            A,
            shift.C,
            inputs=inputs,
            uncertainty=scatter(shifted, parts, None if biased else factor.instruments),
            singular_values=shifted.svd.values,
            warnings=notes,
            condition=factor.hankel.condition,
            route=factor.hankel.path,
        )

    def _instrument(self, data: Records) -> str:
        if self.instrument != "auto":
            return self.instrument
        return "reference" if data.closed else "past_inputs"
