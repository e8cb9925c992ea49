"""Loop and level of data files: what the file states, what is given, and that the two never contradict silently."""

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.files import load_experiment, save_experiment, save_recording
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.level import Level
from excite.types.loop import Loop
from excite.types.recording import Recording, Roles

ROLES = {"inputs": 0, "outputs": 1, "dt": 0.1}
CONTROLLER = StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)


@pytest.fixture
def foreign(tmp_path):
    np.savetxt(tmp_path / "data.csv", np.random.default_rng(0).standard_normal((30, 2)), delimiter=",")
    return tmp_path / "data.csv"


def own(path, **said):
    rng = np.random.default_rng(0)
    save_experiment(Experiment(rng.standard_normal(30), rng.standard_normal(30), dt=0.1, **said), path)
    return path


def test_a_file_that_states_nothing_takes_what_is_given(foreign):
    assert load_experiment(foreign, **ROLES).loop == Loop("open")
    assert load_experiment(foreign, **ROLES).level == Level("zero")
    for loop in ("open", "closed", "unknown"):
        assert load_experiment(foreign, **ROLES, loop=loop).loop == Loop(loop)
    closed = Loop("closed", CONTROLLER)
    assert load_experiment(foreign, **ROLES, loop=closed).loop is closed
    for level in ("zero", "unknown"):
        assert load_experiment(foreign, **ROLES, level=level).level == Level(level)
    assert load_experiment(foreign, **ROLES, level=(1.0, 2.0)).level == Level("known", (1.0,), (2.0,))


@pytest.mark.parametrize("extension", [".npz", ".csv"])
def test_what_an_own_file_states_wins_over_nothing_said(extension, tmp_path):
    path = own(tmp_path / f"e{extension}", loop=Loop("closed", CONTROLLER), level=([1.0], [2.0]))
    plain = load_experiment(path)
    assert plain.loop.closed and plain.loop.controller is not None and plain.level == Level("known", (1.0,), (2.0,))
    agreed = load_experiment(path, loop="closed", level=(1.0, 2.0))
    assert agreed.loop.controller is not None and agreed.level == plain.level


def test_what_is_given_completes_what_is_stated(tmp_path):
    path = own(tmp_path / "e.npz", loop=Loop("unknown"), level="unknown")
    assert load_experiment(path).loop == Loop("unknown") and load_experiment(path).level == Level("unknown")
    given = load_experiment(path, loop="closed", level="zero")
    assert given.loop == Loop("closed") and given.level == Level("zero")
    closed = own(tmp_path / "c.npz", loop=Loop("closed"))
    assert load_experiment(closed, loop=Loop("closed", CONTROLLER)).loop.controller is CONTROLLER


@pytest.mark.parametrize(
    ("said", "given", "message"),
    [
        (
            {"loop": Loop("closed")},
            {"loop": "open"},
            "loop 'open' is given, but the file says 'closed'; drop your loop",
        ),
        ({"loop": Loop("open")}, {"loop": "closed"}, "loop 'closed' is given, but the file says 'open'"),
        ({"loop": Loop("closed")}, {"loop": "unknown"}, "loop 'unknown' is given, but the file says 'closed'"),
        ({"level": "zero"}, {"level": "unknown"}, "level 'unknown' is given, but the file says 'zero'"),
        ({"level": ([1.0], [2.0])}, {"level": "zero"}, "level 'zero' is given, but the file says 'known'"),
        ({"level": ([1.0], [2.0])}, {"level": (1.0, 3.0)}, "level 'known' is given, but the file says 'known'"),
    ],
)
def test_contradictions_are_refused(said, given, message, tmp_path):
    with pytest.raises(ExciteError, match=message) as caught:
        load_experiment(own(tmp_path / "e.npz", **said), **given)
    assert "e.npz" in str(caught.value)


def test_the_loop_of_a_recording_is_that_of_the_view(tmp_path):
    views = {"plant": Roles(("u",), ("y",), closed=True), "response": Roles(("r",), ("y",))}
    values = np.random.default_rng(0).standard_normal((30, 3))
    channels = (Channel("u"), Channel("y"), Channel("r"))
    path, loop = tmp_path / "r.npz", Loop("closed", CONTROLLER)
    save_recording(Recording(np.arange(30) * 0.1, values, channels, 0.1, views, "plant", loop=loop), path)
    assert load_experiment(path, loop="closed").loop.controller is not None
    assert load_experiment(path, view="response", loop="open").loop == Loop("open")
    for view, given in (("plant", "open"), ("response", "closed")):
        with pytest.raises(ExciteError, match=rf"r\.npz: loop '{given}' is given, .* or choose the view"):
            load_experiment(path, view=view, loop=given)
    with pytest.raises(ExciteError, match="but the file says 'closed'"):
        load_experiment(path, inputs="r", outputs="y", loop="open")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"loop": "opne"}, r"Loop\.state: 'opne'; did you mean 'open'"),
        ({"level": "known"}, "level: known with u0 = None"),
        ({"level": "nought"}, "level: 'nought'"),
        ({"level": 3}, "level: 3"),
    ],
)
def test_words_that_mean_nothing_are_refused(given, message, foreign):
    with pytest.raises(ExciteError, match=message):
        load_experiment(foreign, **ROLES, **given)
