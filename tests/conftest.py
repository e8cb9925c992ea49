"""What several test files need: the shared cases, fair timing, and repeatable property tests where CI is set."""

import importlib.util
import os
from pathlib import Path
from time import perf_counter

import pytest
from hypothesis import settings

settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")

CASES = Path(__file__).parents[2] / "shared" / "cases" / "cases.py"


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
