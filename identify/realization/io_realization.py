"""Input-output realization: shift invariance in the output data, with an instrument against coloured noise."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.models.state_space import StateSpaceModel
from excite.numerics.hankel import HankelFactor, hankel_factor
from excite.types.experiment import Experiment
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.method import Data, Method, experiments, order_or_gap
from identify.realization.shifted_data import (
    BIASED,
    ShiftedData,
    check_input_rows,
    complete,
    covariance_input_matrices,
    covariances,
    reference_missing,
    shifted_data,
)
from identify.steps.compression import joint_segments, orthonormal
from identify.steps.hankel_svd import era
from identify.steps.input_matrices import input_matrices
from identify.steps.kalman import spectral_radius

INSTRUMENTS = ("auto", "none", "past_inputs", "reference")


@dataclass(frozen=True, eq=False)
class ShiftedRecords:
    """The shifted data of all records, with their instruments (N_i, m) or None, compressed by `hankel`."""

    experiments: tuple[Experiment, ...]
    instruments: tuple[np.ndarray, ...] | None
    hankel: HankelFactor
    shifted: ShiftedData


@dataclass(frozen=True)
class IoRealization(Method):
    """Realization by shift invariance in the output data (Miller and de Callafon; seed 001, chapter 4).

    Y_(0|r-1) = O X + T' U_(0|r) + V and Y_(1|r) = O A X + T U_(0|r) + V' are seen through an instrument Z that the
    noise does not reach, the inputs projected out of both, and A = S^-1/2 U^T Y' V S^-1/2 taken from the SVD of the
    first (4.27). With Q_Z an orthonormal basis of the rows of Z,

        H = Y_(0|r-1) Q_Z^T N,   H' = Y_(1|r) Q_Z^T N,   N the null space of U_(0|r) Q_Z^T.

    Z = [U_(-p|-1); U_(0|r)] ("past_inputs") is the seed's Y Pi_(U^perp) Z^T up to the weight of its columns. In closed
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
    closed_loop: ClassVar[bool] = True

    block_rows: int = 20
    past: int = 20
    instrument: str = "auto"
    feedthrough: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.instrument not in INSTRUMENTS:
            raise ExciteError(
                f"{self.name}.instrument: {self.instrument!r}; {did_you_mean(str(self.instrument), INSTRUMENTS)}"
            )

    def unsupported(self, data: Data) -> str | None:
        """Return why these data do not suit: no reference, or too few of them, where it has to be the instrument."""
        if reason := super().unsupported(data):
            return reason
        data = experiments(data)
        if self._instrument(data) == "reference" and (reason := reference_missing(data)):
            biased = (
                ""
                if self.instrument == "reference"
                else "; instrument = 'past_inputs' accepts the bias of a closed loop"
            )
            return reason + biased
        if self.largest_order(data) < 1:
            nu, m, rows = len(data[0].inputs), len(data[0].references), self.block_rows + 1
            return (
                f"{nu} inputs and {m} reference channels leave no order: past {self.past} is too short for {rows} rows of "
                f"the inputs; give past at least {rows * nu // m + 1 - rows}, or record as many references as inputs"
            )
        return None

    def span(self, order: int) -> int:
        """p + r + 1."""
        return self.past + self.block_rows + 1

    def required_excitation(self, order: int) -> int:
        """Block rows of the input, r + 1, which are projected out."""
        return self.block_rows + 1

    def sufficient_excitation(self, order: int) -> int:
        """Order + p + r + 1: Willems' lemma for all trajectories of length p + r + 1."""
        return order + self.span(order)

    def largest_order(self, data: Data) -> int:
        """r ny, and no more than the instrument's rows beyond those of the input."""
        data = experiments(data)
        rows, nu, ny = self.block_rows + 1, data[0].u.shape[1], data[0].y.shape[1]
        which = self._instrument(data)
        if which == "none":
            return self.block_rows * ny
        m = nu if which == "past_inputs" else data[0].reference.shape[1]
        return min(self.block_rows * ny, (self.past + rows) * m - rows * nu)

    def prepare(self, data: Data) -> ShiftedRecords:
        """Compress the records, bring the instrument in, project the inputs out."""
        data = gap_free(experiments(data), self.span(1)).parts
        which, rows = self._instrument(data), self.block_rows + 1
        past = 0 if which == "none" else self.past
        nu, ny = data[0].u.shape[1], data[0].y.shape[1]
        segments, instruments = joint_segments(data), tuple(e.u for e in data)
        if which == "reference":
            instruments = tuple(e.reference for e in data)
            segments = [np.hstack([w, z]) for w, z in zip(segments, instruments, strict=True)]
        hankel = hankel_factor(segments, past + rows)
        U = hankel.L[hankel.index(slice(0, nu), past, past + rows)]
        Y = hankel.L[hankel.index(slice(nu, nu + ny), past, past + rows)]
        if which == "none":
            check_input_rows(U, data, rows)
            return ShiftedRecords(data, None, hankel, shifted_data(U, Y, ny, len(hankel.L)))
        m = instruments[0].shape[1]
        channels = slice(0, nu) if which == "past_inputs" else slice(nu + ny, None)
        Z = hankel.L[hankel.index(channels, 0, past + rows)]
        Z = Z.reshape(-1, m, len(hankel.L))[::-1].reshape(Z.shape)  # lags of v on z ascend as z moves back
        W, Q = orthonormal(Z)
        U, Y = U @ Q.T, Y @ Q.T
        check_input_rows(U, data, rows)
        shifted = shifted_data(U, Y, ny, m)
        return ShiftedRecords(data, instruments, hankel, replace(shifted, columns=W.T @ shifted.columns))

    def realize(self, factor: ShiftedRecords, order: int | None) -> Estimate:
        """Return the model of one order."""
        data, first, shifted = factor.experiments, factor.experiments[0], factor.shifted
        n, warnings = order_or_gap(order, shifted.svd.values, self.largest_order(data))
        A, _, C = era(shifted.svd, shifted.shifted, n)
        reference = self._instrument(data) == "reference"
        biased = not reference and any(e.loop.closed for e in data)
        warnings += (BIASED,) * biased
        x0 = None
        if reference or biased or spectral_radius(A) >= 1:
            if not (reference or biased):
                warnings += (
                    "A is not stable, so B and D were fitted to covariances with the input, not by simulation",
                )
            instruments = factor.instruments or tuple(e.u for e in data)
            R_u, R_y = covariances(data, instruments, -self.past, 2 * self.block_rows)
            B, D = covariance_input_matrices(R_u, R_y, A, C, self.feedthrough)
        else:
            found = input_matrices(data, A, C, np.zeros((n, len(C))), self.feedthrough)
            B, D, x0 = found.B, found.D, found.x0
        model = StateSpaceModel(A, B, C, D, first.dt, inputs=first.inputs, outputs=first.outputs)
        return complete(
            self.name,
            model,
            shifted,
            data,
            None if biased else factor.instruments,
            warnings,
            x0=x0,
            condition=factor.hankel.condition,
            path=factor.hankel.path,
        )

    def _instrument(self, data: tuple[Experiment, ...]) -> str:
        if self.instrument != "auto":
            return self.instrument
        return "reference" if any(e.loop.closed for e in data) else "past_inputs"
