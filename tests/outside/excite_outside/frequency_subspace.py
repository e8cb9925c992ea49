"""A method on frequency data: a frequency response in, a state space out."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from excite.models.frequency_response import FrequencyResponse
from excite.models.state_space import StateSpaceModel
from excite_outside.etfe import Etfe
from identify.data.records import Kind
from identify.estimate import Estimate
from identify.method import Method
from identify.state_space_method import StateSpaceMethod
from identify.steps.shift import Shift


@dataclass(frozen=True)
class FrequencySubspace(StateSpaceMethod):
    """Impulse response of a response at 0 Hz … Nyquist, its Hankel matrix, and B, D by least squares (McKelvey 1996)."""

    name: ClassVar[str] = "frequency_subspace"
    summary: ClassVar[str] = "subspace method on a frequency response"
    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.FREQUENCY})

    block_rows: int = field(default=20, metadata={"meaning": "block rows of the Hankel matrix"})
    response: Method = field(default=Etfe(), metadata={"meaning": "what makes a frequency response of records"})

    def unsupported(self, data: FrequencyResponse) -> str | None:
        """The grid is uniform from 0 Hz to the Nyquist frequency."""
        grid = None if data.dt is None else np.linspace(0, 0.5 / data.dt, len(data.f_hz))
        uniform = grid is not None and np.allclose(data.f_hz, grid, rtol=1e-9)
        return None if uniform else "the frequencies are not evenly spaced from 0 Hz to the Nyquist frequency"

    def largest_order(self, data: FrequencyResponse) -> int:
        """Rows of the Hankel matrix without the last block."""
        return (self.block_rows - 1) * len(data.outputs)

    def compress(self, data: FrequencyResponse) -> tuple[np.ndarray, np.ndarray]:
        """Left singular vectors and singular values of the Hankel matrix."""
        r, h = self.block_rows, np.fft.irfft(data.values, axis=0)
        blocks = h[1 + np.add.outer(np.arange(r), np.arange(r))]
        U, s, _ = np.linalg.svd(blocks.transpose(0, 2, 1, 3).reshape(r * h.shape[1], r * h.shape[2]))
        return U, s

    def singular_values(self, compressed: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Those of the Hankel matrix."""
        return compressed[1]

    def realize(self, compressed: tuple[np.ndarray, np.ndarray], order: int, data: FrequencyResponse) -> Estimate:
        """Return the model of one order."""
        U, s = compressed
        ny, nu = len(data.outputs), len(data.inputs)
        shift = Shift.of_gamma(U[:, :order] * np.sqrt(s[:order]), ny)
        A, notes = self.dynamics(shift)
        z = np.exp(2j * np.pi * data.f_hz * data.dt)
        states = np.linalg.solve(z[:, None, None] * np.eye(order) - A, np.eye(order)[None])
        X = np.concatenate([shift.C @ states, np.broadcast_to(np.eye(ny), (len(z), ny, ny))], axis=2)
        X, G = X.reshape(-1, order + ny), data.values.reshape(-1, nu)
        B, D = np.split(np.linalg.lstsq(np.vstack([X.real, X.imag]), np.vstack([G.real, G.imag]))[0], [order])
        model = StateSpaceModel(A, B, shift.C, D, data.dt, inputs=data.inputs, outputs=data.outputs)
        return Estimate(model, self.name, order, singular_values=s, warnings=notes)
