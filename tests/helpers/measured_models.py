"""Models and records for metrics."""

import numpy as np

from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment

DT = 0.1


def system(K=True, gain=1.0):
    """A stable pair of poles, one input, two outputs."""
    A = 0.9 * np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    noise = [[0.3, 0.1], [0.0, 0.2]] if K else None
    return StateSpaceModel(A, [[gain], [0.5 * gain]], [[1.0, 0.0], [0.3, 1.0]], [[0.0], [0.0]], DT, K=noise)


def record(model, samples=300, seed=0):
    u = np.random.default_rng(seed).standard_normal((samples, 1))
    return Experiment(u, model.simulate(u), dt=DT)
