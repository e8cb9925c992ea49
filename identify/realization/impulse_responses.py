"""Impulse responses and free decays: what the records must hold, and the Markov parameters in them."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.types.experiment import Experiment
from identify.data.records import Kind, Records
from identify.estimate import Estimate
from identify.state_space_method import StateSpaceMethod
from identify.steps.completion import Inputs, complete
from identify.steps.compression import joint_segments
from identify.steps.hankel_svd import HankelSvd, onto
from identify.steps.shift import Shift


@dataclass(frozen=True, eq=False)
class ImpulseResponses:
    """Columns of responses side by side: one for each input, then one for each free decay.

    markov (count, ny, m) : h_1, h_2, …; of an input h_i = C A^(i-1) B_j, of a decay h_i = y(i-1) = C A^(i-1) x0;
    D (ny, nu) : the inputs' h_0; columns : the column of each record.
    """

    experiments: tuple[Experiment, ...]
    markov: np.ndarray
    D: np.ndarray
    columns: tuple[int, ...]


def impulse_of(experiment: Experiment) -> tuple[int | None, int]:
    """Return (input, sample) of the record's one impulse, (None, 0) for a free decay."""
    found = np.argwhere(experiment.u != 0)
    return (int(found[0, 1]), int(found[0, 0])) if len(found) else (None, 0)


def not_impulses(data: tuple[Experiment, ...]) -> str | None:
    """Return why the records are not impulse responses or free decays, or None."""
    for k, experiment in enumerate(data):
        if (count := np.count_nonzero(experiment.u)) > 1:
            record = f"record {k}: " if len(data) > 1 else ""
            return (
                f"{record}the input is not an impulse ({count} of its samples differ from 0); give one record an "
                "input, with one sample that is not 0, or none at all for a free decay"
            )
    driven = {impulse_of(experiment)[0] for experiment in data} - {None}
    for j, channel in enumerate(data[0].inputs):
        if driven and j not in driven:
            return f"input '{channel.name}' has no impulse in any record; record one, or leave the channel out"
    return None


def response_length(data: tuple[Experiment, ...]) -> int:
    """Parameters h_1, h_2, … that the shortest record holds."""
    return min(len(e) - sample - (j is not None) for e in data for j, sample in [impulse_of(e)])


def response_columns(data: tuple[Experiment, ...]) -> int:
    """Columns of a response: inputs, where impulses drive them, and free decays."""
    decays = sum(impulse_of(e)[0] is None for e in data)
    return decays + (len(data[0].inputs) if decays < len(data) else 0)


def impulse_responses(data: tuple[Experiment, ...]) -> ImpulseResponses:
    """Read the records: outputs per unit impulse (repetitions averaged by least squares), and decays as they are."""
    outputs = joint_segments(tuple(e.without_inputs() for e in data))
    impulses, count = [impulse_of(e) for e in data], response_length(data)
    decays = [k for k, (j, _) in enumerate(impulses) if j is None]
    width = response_columns(data)
    nu = width - len(decays)
    h = np.zeros((count + 1, outputs[0].shape[1], width))
    energy = np.zeros(nu)
    columns = []
    for k, (e, y, (j, sample)) in enumerate(zip(data, outputs, impulses, strict=True)):
        if j is None:
            columns.append(nu + decays.index(k))
            h[1:, :, columns[-1]] = y[:count]
        else:
            columns.append(j)
            height = e.u[sample, j]
            h[:, :, j] += height * y[sample : sample + count + 1]
            energy[j] += height**2
    h[:, :, :nu] /= energy
    return ImpulseResponses(data, h[1:], h[0, :, :nu], tuple(columns))


@dataclass(frozen=True, eq=False)
class ResponseFactor:
    """The responses, the SVD of their Hankel matrix, and that matrix one sample later (for methods that use it)."""

    responses: ImpulseResponses
    svd: HankelSvd
    shifted: np.ndarray | None = None


@dataclass(frozen=True)
class ResponseMethod(StateSpaceMethod[Records]):
    """A method over the Hankel matrix of impulse responses or free decays.

    An impulse may have any height and instant; the record must be at rest before it. With decays alone the model has
    no input. Each decay's initial state is returned; that of an impulse record is zero.
    """

    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.IMPULSES})
    beyond: ClassVar[int]  # parameters used beyond those of the Hankel matrix

    block_rows: int = field(default=20, metadata={"minimum": 2})

    @abstractmethod
    def shift(self, factor: ResponseFactor, order: int) -> Shift:
        """Return A and C."""

    def most_columns(self, data: Records) -> int:
        """Block columns that the shortest record allows."""
        return response_length(data.measured) - self.beyond - self.block_rows + 1

    def singular_values(self, factor: ResponseFactor) -> np.ndarray:
        """Return those of the Hankel matrix."""
        return factor.svd.values

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: no impulses or decays, or too short for the block rows."""
        if reason := not_impulses(data.measured):
            return reason
        if (columns := self.most_columns(data)) < 1:
            most = self.block_rows + columns - 1
            remedy = f"give at most {most}" if most > 1 else "record more samples"
            return (
                f"block_rows {self.block_rows} leaves no Hankel column of responses {response_length(data.measured)} "
                f"samples long (the shortest record's, after its impulse); {remedy}"
            )
        return None

    def realize(self, factor: ResponseFactor, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        responses, nu = factor.responses, factor.responses.D.shape[1]
        warnings: tuple[str, ...] = ()
        shift = self.shift(factor, order)
        A, notes = self.dynamics(shift)
        columns = onto(A, shift.C, responses.markov) if notes else factor.svd.delta(order)[:, : factor.svd.m]
        x0 = tuple(columns[:, c] if c >= nu else np.zeros(order) for c in responses.columns)
        if data.inputs and not nu:
            warnings += ("every input is zero throughout: these are free decays, and the model has no input",)
        if len(set(map(len, responses.experiments))) > 1:
            warnings += (f"the records' lengths differ; all were cut to {len(responses.markov)} samples of response",)
        return complete(
            self.name,
            responses.experiments,
            A,
            shift.C,
            inputs=Inputs(columns[:, :nu], responses.D, x0),
            singular_values=factor.svd.values,
            warnings=(*warnings, *notes),
        )
