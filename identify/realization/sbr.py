"""SBR: step-based realization, straight from step responses."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.simulate import observability
from excite.types.experiment import Experiment
from identify.data.records import Kind, Records
from identify.estimate import Estimate, Status
from identify.state_space_method import StateSpaceMethod
from identify.steps.completion import Inputs, complete
from identify.steps.compression import joint_segments, lq
from identify.steps.hankel_svd import HankelSvd, hankel_of
from identify.steps.shift import Shift

FORMS = ("printed", "projected")


@dataclass(frozen=True, eq=False)
class StepFactor:
    """The records, and the SVD of the outputs' Hankel matrix without its constant part, with that matrix shifted.

    Both come from one LQ factor of block_rows + 1 rows, in whose row space they are written.
    """

    experiments: tuple[Experiment, ...]
    svd: HankelSvd
    shifted: np.ndarray


@dataclass(frozen=True)
class Sbr(StateSpaceMethod[Records]):
    """Step-based realization (van Helmont et al. 1990; Miller and de Callafon 2009; Miller 2012, chapter 3).

    While the input is constant, Y = O_r X + T U has all columns of T U equal; without them Y = O_r (X - X_0) and, one
    sample later, Y' = O_r A (X - X_0). From the SVD of Y, A = S^-1/2 U^T Y' V S^-1/2 and C is the first block of U S^1/2;
    one LQ factor of r + 1 block rows holds both matrices. The response is never differentiated. A step is any change of
    the input, from 0 before the record, and the samples up to the next one are its response: any height, instant and
    number of steps, any number of inputs and any initial state will do.

    B, D and x0 follow by least squares on all samples (3.16). In (3.17) the print gives B the columns C, CA, …: they
    are the cumulative sums 0, C, C + CA, …, and "1" is the identity. A step recorded from its own instant cannot tell B
    from x0: the solution is then the one of minimum norm, with a warning.

    block_rows : r; form : "printed" subtracts the first column, M, from the others (3.3); "projected" projects the row
    of ones out of both matrices instead, which spreads the noise of M over all columns (and keeps the column of the
    step's own instant, where fast poles show); feedthrough : estimate D (else zero); at_rest : take x0 as zero.
    """

    name: ClassVar[str] = "sbr"
    summary: ClassVar[str] = "step-based realization; one or several steps"
    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.STEPS})

    block_rows: int = field(default=20, metadata={"minimum": 2})
    form: str = field(default="projected", metadata={"choices": FORMS})
    feedthrough: bool = False
    at_rest: bool = False

    def singular_values(self, factor: StepFactor) -> np.ndarray:
        """Return those of the Hankel matrix without its constant part."""
        return factor.svd.values

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: no steps, or responses too short for the block rows."""
        longest = max((b - a for e in data.measured for a, b in step_responses(e)), default=0)
        if longest == 0:
            return "no record has a step: every input is zero throughout"
        if longest < self.block_rows + 2:
            remedy = (
                f"give at most {longest - 2}"
                if longest > 3
                else "it is not a step (give it as commanded, without noise)"
            )
            return (
                f"block_rows {self.block_rows} needs an input that stays constant for {self.block_rows + 2} samples after a "
                f"step, and here it does so for {longest} at most; {remedy}"
            )
        for j, channel in enumerate(data.inputs):
            if not any(e.u[:, j].any() for e in data.measured):
                return f"input '{channel.name}' has no step in any record; record one, or leave the channel out"
        return None

    def required_excitation(self, order: int | None) -> int:
        """One: a step is persistently exciting of that order only; its transient excites the states."""
        return 1

    def largest_order(self, data: Records) -> int:
        """Rank of the Hankel matrix without its constant part."""
        columns = sum(b - a - self.block_rows - 1 for e in data.measured for a, b in self.long_enough(e))
        return min(self.block_rows * len(data.outputs), columns)

    def long_enough(self, experiment: Experiment) -> list[tuple[int, int]]:
        """Step responses that give the Hankel matrix at least one column and the first to subtract from it."""
        return [(a, b) for a, b in step_responses(experiment) if b - a >= self.block_rows + 2]

    def compress(self, data: Records) -> StepFactor:
        """Factor the Hankel matrices of all responses, side by side, without their constant parts."""
        outputs = joint_segments(tuple(e.without_inputs() for e in data.measured))
        ny, blocks = outputs[0].shape[1], []
        for e, y in zip(data.measured, outputs, strict=True):
            for a, b in self.long_enough(e):
                H = hankel_of(y[a:b][:, :, None], self.block_rows + 1)
                blocks.append(H[:, 1:] - H[:, :1] if self.form == "printed" else H - H.mean(1, keepdims=True))
        ((L,),) = lq(np.hstack(blocks))
        left, values, right = la.svd(L[:-ny], full_matrices=False, check_finite=False)
        return StepFactor(data.measured, HankelSvd(left, values, right, ny, 1), L[ny:])

    def realize(self, factor: StepFactor, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        shift = Shift.of_pair(factor.svd, factor.shifted, order)
        A, warnings = self.dynamics(shift)
        with np.errstate(over="ignore", invalid="ignore"):
            B, D, x0, surplus = self.input_parameters(factor.experiments, A, shift.C)
        if surplus:
            warnings += (
                f"{surplus} combinations of B, D and x0 leave the outputs unchanged (a step recorded from its own "
                "instant cannot tell an input from an initial state): the minimum-norm solution was taken, which "
                "reproduces these records only; record samples before each step, or set at_rest",
            )
        steps, used = (sum(len(found(e)) for e in factor.experiments) for found in (step_responses, self.long_enough))
        if used < steps:
            warnings += (
                f"{steps - used} of {steps} steps are held for fewer than block_rows + 2 = {self.block_rows + 2} samples: they "
                "serve B, D and x0 alone",
            )
        return complete(
            self.name,
            factor.experiments,
            A,
            shift.C,
            inputs=Inputs(B, D, x0),
            singular_values=factor.svd.values,
            warnings=warnings,
            status=Status.SUSPECT if surplus else Status.OK,
        )

    def input_parameters(
        self, data: tuple[Experiment, ...], A: np.ndarray, C: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...], int]:
        """Return B, D, x0 of each record and the number of parameter combinations that the records do not show."""
        n, ny, nu = len(A), len(C), data[0].u.shape[1]
        direct = n * nu
        initial = direct + (ny * nu if self.feedthrough else 0)
        blocks = []
        for k, e in enumerate(data):
            N, O = len(e), observability(A, C, len(e))
            reach = np.concatenate([np.zeros((1, ny, n)), np.cumsum(O[:-1], axis=0)])
            phi = np.zeros((N, ny, initial + (0 if self.at_rest else n * len(data))))
            for t, j in np.argwhere(changes(e)):
                phi[t:, :, j * n : (j + 1) * n] += changes(e)[t, j] * reach[: N - t]
            if self.feedthrough:
                phi[:, :, direct:initial] = np.kron(e.u[:, None], np.eye(ny))
            if not self.at_rest:
                phi[:, :, initial + k * n : initial + (k + 1) * n] = O
            blocks.append(phi.reshape(N * ny, -1))
        phi = np.vstack(blocks)
        scale = np.linalg.norm(phi, axis=0)
        scale[scale == 0] = 1.0
        if not np.isfinite(scale).all():
            raise ExciteError(
                f"sbr: the estimate of order {n} is so unstable that its responses overflow; lower the order"
            )
        theta, _, rank, _ = la.lstsq(phi / scale, np.concatenate([e.y.ravel() for e in data]), cond=1e-10)
        theta /= scale
        B = theta[:direct].reshape(nu, n).T
        D = theta[direct:initial].reshape(nu, ny).T if self.feedthrough else np.zeros((ny, nu))
        x0 = np.zeros((len(data), n)) if self.at_rest else theta[initial:].reshape(len(data), n)
        return B, D, tuple(x0), phi.shape[1] - rank


def changes(experiment: Experiment) -> np.ndarray:
    """Return u(t) - u(t-1) as (N, nu), with u = 0 before the record."""
    return np.diff(experiment.u, axis=0, prepend=0.0)


def step_responses(experiment: Experiment) -> list[tuple[int, int]]:
    """Return (start, stop) of each step's response: from a change of u to the next."""
    return list(pairwise([*np.flatnonzero(changes(experiment).any(1)).tolist(), len(experiment)]))
