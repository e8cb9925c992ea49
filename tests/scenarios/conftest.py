"""Fixtures that several files of tests share."""

import pytest
from command_line import excite, samples, write


@pytest.fixture
def data(tmp_path):
    return write(tmp_path / "data.csv", samples())


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A short flight of the quadrotor, played by the commands themselves, and the folder it lies in."""
    folder = tmp_path_factory.mktemp("flight")
    design = ("--order", "5", "--dt", "0.1", "--channels", "3", "--amplitude", "2,2,5")
    assert excite("design", "prbs", *design, "-o", folder / "played.csv")[0] == 0
    assert (
        excite("simulate", "quadrotor", "--input", folder / "played.csv", "--seed", "4", "-o", folder / "flight.npz")[0]
        == 0
    )
    return folder
