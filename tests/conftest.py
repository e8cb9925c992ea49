"""What several test files need: the shared cases, fair timing, and repeatable property tests where CI is set."""

import importlib.util
import os
from time import perf_counter

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import settings
from paths import SHARED

from excite.models.state_space import StateSpaceModel

settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")

CASES = SHARED / "cases" / "cases.py"


@pytest.fixture(scope="session")
def cases():
    """The systems behind the published figures, as a module."""
    if not CASES.exists():
        pytest.skip("../shared/cases/cases.py is not there")
    spec = importlib.util.spec_from_file_location("cases", CASES)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def fastest():
    """Return (seconds, result) of the fastest of several runs: the one the machine disturbed least."""

    def best(repeats, run):
        times = []
        for _ in range(repeats):
            start = perf_counter()
            result = run()
            times.append(perf_counter() - start)
        return min(times), result

    return best


@pytest.fixture(scope="session")
def system():
    """Return a function: n states of modulus 0.9 spread over the circle (one real, 0.7, where n is odd), 2 inputs, 3 outputs."""

    def build(n, seed=0):
        rng = np.random.default_rng(seed)
        turns = [
            0.9 * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for w in np.linspace(0.3, 2.6, n // 2)
        ]
        A = la.block_diag(*turns, *[[[0.7]]] * (n % 2))
        B, C, D = (rng.standard_normal(shape) for shape in ((n, 2), (3, n), (3, 2)))
        return StateSpaceModel(A, B, C, D, 1.0)

    return build


@pytest.fixture(scope="session")
def miller_31():
    """Example 3.1 of Miller (2012): two lightly damped modes seen by two outputs."""
    A = la.block_diag([[0.95, 0.1], [-0.1, 0.95]], [[0.93, 0.3], [-0.3, 0.93]])
    C = [[0.4039, 0.4039, -0.0955, -0.2196], [0.2, 0.3, -0.4, 0.3]]
    return StateSpaceModel(A, [[-0.01209], [0.2429], [0], [0.4246]], C, np.zeros((2, 1)), 1.0)
