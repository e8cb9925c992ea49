"""Example data with a known truth: what methods are tested on, for each kind of data."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.models.frequency_response import FrequencyResponse
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from excite.numerics.simulate import simulate
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from identify.data.records import Kind
from identify.method import Method, Need

Example = tuple[tuple[Any, ...], Any]
DT = 0.1


def series(noise: float = 0.1, samples: int = 1500, seed: int = 0) -> tuple[Experiment, StateSpaceModel]:
    """Return open-loop data and truth of a stable 2 x 2 fourth-order innovation model with ARX structure.

    K is chosen so that A - K C is nilpotent: the model is an ARX model of two lags, in the class of every method.
    """
    rng = np.random.default_rng(seed)
    A, B, C = _system(rng)
    K = _deadbeat(A, C)
    model = StateSpaceModel(A, B, C, np.zeros((2, 2)), DT, K=K, innovation_cov=noise**2 * np.eye(2))
    u, e = rng.standard_normal((samples, 2)), noise * rng.standard_normal((samples, 2))
    y = model.simulate(u) + simulate(A, K, C, np.eye(2), e)
    return Experiment(u, y, dt=DT), model


def _system(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    A = la.block_diag([[0.8, 0.3], [-0.3, 0.8]], [[0.5, 0.4], [-0.4, 0.5]])
    return A, rng.standard_normal((4, 2)), rng.standard_normal((2, 4))


def _deadbeat(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return K with (A - K C)^2 = 0 for observability indices (2, 2): ARX coefficients C A^2 = a1 C A + a2 C."""
    O = np.vstack([C, C @ A])
    a2, a1 = np.split(C @ A @ A @ la.inv(O), 2, axis=1)
    return la.solve(O, np.vstack([a1, a2 + a1 @ a1]))


def closed_loop(samples: int, seed: int) -> tuple[Experiment, StateSpaceModel]:
    """Return data and truth of the loop of Mercère, Markovsky and Ramos (2016), section V-B."""
    rng = np.random.default_rng(seed)
    r, e = rng.standard_normal((2, samples))
    u, y, z, v = np.zeros((4, samples))
    for k in range(2, samples):
        v[k] = -1.5 * v[k - 1] - 0.7 * v[k - 2] + e[k] + 0.5 * e[k - 1]
        u[k - 1] = -0.5 * y[k - 1] + r[k]
        z[k] = 1.5 * z[k - 1] - 0.7 * z[k - 2] + u[k - 1] + 0.5 * u[k - 2]
        y[k] = z[k] + 0.8 * v[k]
    A, B, C, D = (np.array(each) for each in ([[1.5, -0.7], [1, 0]], [[1], [0]], [[1, 0.5]], [[0]]))
    truth = StateSpaceModel(A, B, C, D, 1.0)
    reference = np.append(r[1:], 0.0)  # r(k) moves u(k - 1)
    return Experiment(u, y, dt=1.0, reference=reference, loop=Loop("closed")), truth


def _series(noise: float, length: int) -> Example:
    data, truth = series(noise, 1500 * length)
    return (data,), truth


def white_output_noise(noise: float, length: int) -> Example:
    """Return the series with white noise on its outputs alone, which a method without an instrument stands."""
    (data,), truth = _series(0.0, length)
    y = data.y + noise * np.random.default_rng(1).standard_normal(data.y.shape)
    return (replace(data, y=y),), truth


def _responses(noise: float, length: int, shape: Callable[[np.ndarray], np.ndarray]) -> Example:
    """One record for each input, which alone moves, at a sample of its own; white noise on the outputs."""
    rng = np.random.default_rng(0)
    A, B, C = _system(rng)
    truth = StateSpaceModel(A, B, C, np.zeros((2, 2)), DT)
    records = []
    for j in range(2):
        u = np.zeros((150 * length, 2))
        u[:, j] = 10 * shape(np.arange(len(u)) - 10 * (j + 1))
        records.append(Experiment(u, truth.simulate(u) + noise * rng.standard_normal((len(u), 2)), dt=DT))
    return tuple(records), truth


def _outputs(noise: float, length: int) -> Example:
    """Outputs of two lightly damped modes driven by white process noise, with a little noise of their own.

    The modes of the series hardly show in its noise: with 1500 samples no method finds them within 0.05.
    """
    rng = np.random.default_rng(0)
    modes = ((0.97, 0.4), (0.95, 1.2))
    A = la.block_diag(*(r * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for r, w in modes))
    C = _system(rng)[2]
    K, cov = kalman_gain(A, C, np.eye(4), noise**2 * np.eye(2), np.zeros((4, 2)))
    truth = StateSpaceModel(A, np.empty((4, 0)), C, np.empty((2, 0)), DT, K=K, innovation_cov=cov)
    e = rng.standard_normal((1500 * length, 2)) @ la.cholesky(cov)
    return (Experiment(np.empty((len(e), 0)), simulate(A, K, C, np.eye(2), e), dt=DT),), truth


def _frequencies(noise: float, length: int) -> Example:
    """The frequency response of the series' plant on a uniform grid up to Nyquist, with complex noise on every entry."""
    _, truth = series(0.0, 2)
    count = 128 * length
    f = np.arange(count + 1) / (2 * count * DT)
    rng = np.random.default_rng(0)
    G = truth.frf(f)
    G = G + 0.1 * noise * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
    G[[0, -1]] = G[[0, -1]].real
    return (FrequencyResponse(f, G, dt=DT, inputs=truth.inputs, outputs=truth.outputs),), truth


# Kind of data -> (noise, length in units of the usual record) -> data and truth.
EXAMPLES: dict[Kind, Callable[[float, int], Example]] = {
    Kind.SERIES: _series,
    Kind.IMPULSES: lambda noise, length: _responses(noise, length, lambda t: t == 0),
    Kind.STEPS: lambda noise, length: _responses(noise, length, lambda t: t >= 0),
    Kind.OUTPUTS: _outputs,
    Kind.FREQUENCY: _frequencies,
}


def example_of(method: Method, noise: float = 0.1, length: int = 1) -> Example:
    """Return data of the kind that a method takes, and their truth: its own example, or the usual one of its kind."""
    own = method.example(noise, length)
    if own is not None:
        return own
    data, truth = next(EXAMPLES[kind] for kind in Kind if kind in method.takes and kind in EXAMPLES)(noise, length)
    return tuple(with_needs(method, record) for record in data), truth


def with_needs(method: Method, record: Any) -> Any:
    """Return a record with the reference that a method needs: in open loop, what is played."""
    if Need.REFERENCE not in method.needs:
        return record
    return replace(record, reference=record.u, references=None)
