"""What a plant is: one of another package, written against `plants.plant.Plant` alone, and what conformance finds in it."""

import numpy as np
import pytest
from installed import install, plug_in
from tank import Tank, tank

from excite.errors import DesignRefused, ExciteError
from excite.types.signal import Signal
from plants import list_plants, load_plant
from plants.conformance import CHECKS, check_plant, checks_of
from plants.linear.plant import LinearPlant
from plants.noise import draw, draw_start
from plants.registry import PLANTS


def test_a_plant_of_three_functions_conforms():
    check_plant(Tank())
    check_plant(Tank(parameters={"decay": 0.5, "dt": 0.01}))


@pytest.mark.parametrize(
    ("fault", "check"),
    [
        ("another unit", "check_records_what_it_says"),
        ("unseeded", "check_deterministic"),
        ("unseeded", "check_copies"),
        ("shows what acts", "check_records_what_is_played"),
        ("not finite", "check_finite_or_stopped"),
        ("wrong truth", "check_truth"),
    ],
)
def test_conformance_finds_a_fault_and_says_where(fault, check):
    with pytest.raises(AssertionError, match=rf"{check} at valve"):
        check_plant(tank(fault))


def test_exceptions_are_declared_with_a_reason():
    plant = tank("wrong truth")
    check_plant(plant, exceptions={"check_truth": "its truth is a sketch"})
    plant.conformance_exceptions = {"check_truth": "its truth is a sketch"}
    check_plant(plant)
    assert len(checks_of(plant)) == len(checks_of(Tank())) - 1 < len(CHECKS)
    with pytest.raises(ExciteError, match=r"no check 'check_trut'; did you mean 'check_truth'"):
        checks_of(plant, {"check_trut": "a misprint"})
    with pytest.raises(ExciteError, match="'check_limits': has no reason; say why"):
        checks_of(plant, {"check_limits": ""})


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda p, s: p.run(s, inject="pump"), "tank injection 'pump' does not exist; known: valve"),
        (lambda p, s: p.run(s, seed=-1), "tank seed: -1; give a whole number of at least 0"),
        (lambda p, s: p.run(s, noise={"inflw": 1.0}), "noise 'inflw' does not exist; did you mean 'inflow'"),
        (lambda p, s: p.run(s, noise="loud"), "tank noise: 'loud'; give true, false, or"),
        (lambda p, s: p.run(Signal(s.u, 0.7)), r"tank: signal dt 0\.7 s is not a whole multiple of 0\.5 s"),
        (lambda p, s: p.run(Signal(np.ones((4, 2)), 0.5)), "tank: the signal has 2 channels; give 1: valve"),
        (lambda p, s: p.truth(None, "lvel"), "tank view 'lvel' does not exist; did you mean 'level'"),
        (
            lambda p, s: p.truth(load_plant("miller_31").run(s), "level"),
            "recording is of 'miller_31'; pass one of this",
        ),
        (lambda p, s: p.with_actuator({"actuator_rate": 1.0}), "'actuator_rate': this plant brings its own actuators"),
    ],
)
def test_what_users_ask_for_is_checked_once_for_all_plants(ask, message):
    with pytest.raises(ExciteError, match=message):
        ask(Tank(), Signal(np.ones(4), 1.0))


def test_limits_are_kept_before_anything_is_simulated():
    with pytest.raises(DesignRefused, match=r"tank valve: 3 1 exceeds the limit 2 1; reduce the amplitude"):
        Tank().prepare(Signal(np.full(4, 3.0), 1.0))
    task = Tank().prepare(Signal(np.ones(4), 1.0), noise=False)
    assert task.hold == 2 and task.inject == "valve" and task.levels == {"inflow": 0.0} and task.u.shape == (8, 1)
    assert Tank().run_many(Signal(np.ones(4), 1.0), seeds=[]) == []


def test_the_truth_of_a_recording_has_its_parameters():
    flown = Tank(parameters={"decay": 0.5}).run(Signal(np.ones(4), 1.0))
    assert Tank().truth(flown, "level").model.A[0, 0] == 0.5
    stranger = load_plant("miller_31", parameters={"dt": 2.0}).run(Signal(np.ones(4), 2.0))
    plain = load_plant("miller_31")
    assert plain.truth(stranger, "plant").model.dt == 2.0
    alone = LinearPlant(**{name: getattr(plain, name) for name in plain.__dataclass_fields__} | {"make": None})
    with pytest.raises(
        ExciteError, match=r"miller_31: nothing says how it is made with other parameters; give .* `make`"
    ):
        alone.truth(stranger, "plant")


def test_what_a_plant_records_is_known_without_a_sample(monkeypatch):
    def never(*given):
        raise AssertionError("simulated")

    for name in list_plants():
        plant = load_plant(name)
        monkeypatch.setattr(type(plant), "simulate", never)
        for inject, place in plant.injections.items():
            layout = plant.records(inject)
            blank = layout.blank()
            assert layout.default in layout.views and blank.values.shape == (1, len(layout.channels))
            for view, roles in place.views.items():
                assert [c.name for c in blank.experiment(view).outputs] == list(roles.outputs)
        monkeypatch.undo()
    ladder = load_plant("thermal_ladder", parameters={"samples_per_decade": 20.0})
    assert ladder.records().dt is None and load_plant("thermal_ladder").records().dt == ladder.dt
    check_plant(ladder)


OUTSIDE = """
from tank import Tank

def tank_of(preset="small", parameters=None):
    return Tank(preset, parameters)

def no_plant(preset=None, parameters=None):
    return 3

def without_parameters(preset):
    return None
"""


def test_a_plant_of_another_package_is_one_of_the_table(tmp_path, monkeypatch):
    entries = {
        name: f"outside_tanks:{name}" for name in ("tank_of", "no_plant", "without_parameters", "Tank", "gone")
    } | {"quadrotor": "outside_tanks:Tank"}
    install(tmp_path, "outside", {"outside_tanks.py": OUTSIDE}, {PLANTS.group: entries})
    plug_in(monkeypatch, PLANTS, tmp_path)
    assert {"tank_of", "Tank", "quadrotor"} < set(list_plants())
    assert load_plant("Tank", parameters={"decay": 0.5}).values["decay"] == 0.5
    assert type(load_plant("quadrotor")).__name__ == "Quadrotor"
    reasons = {text.split(" ")[0]: reason for text, reason in PLANTS.skipped.items()}
    assert "cannot be called with preset and parameters" in reasons["without_parameters"]
    assert "AttributeError" in reasons["gone"] and "the name is taken by excite" in reasons["quadrotor"]
    with pytest.raises(
        ExciteError, match=r"plant 'no_plant': makes a int; a plant is a subclass of plants\.plant\.Plant"
    ):
        load_plant("no_plant")
    with pytest.raises(ExciteError, match="plant 'tnk' does not exist"):
        load_plant("tnk")


def test_noise_sources_have_streams_of_their_own_in_their_order():
    widths, levels = {"a": 2, "b": 1}, {"a": 1.0, "b": 3.0}
    both, quiet = draw(widths, levels, 7, 5), draw(widths, {"a": 0.0, "b": 3.0}, 7, 5)
    np.testing.assert_array_equal(both["b"], quiet["b"])
    assert not quiet["a"].any() and both["a"].shape == (5, 2)
    np.testing.assert_array_equal(both["a"], draw({**widths, "c": 4}, levels | {"c": 1.0}, 7, 5)["a"])
    many = draw({"a": 1}, {"a": 5.0}, 0, 100_000)["a"]
    assert abs(many.mean()) < 0.02 and abs(many.std() - 1) < 0.01  # of unit variance, whatever the level
    start = draw_start(widths, 7, 3)
    assert start.shape == (3,) and not np.isin(start, [*both["a"].ravel(), *both["b"].ravel()]).any()
