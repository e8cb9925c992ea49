"""Many flights of the quadrotor at once: equal to single ones to the bit, in any number, process and preset."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from quadrotor_flights import PLANT, SMALL, random_binary

from excite.errors import SimulationStopped
from plants.quadrotor import plant as module
from plants.quadrotor.plant import Quadrotor

SEEDS = [4, 9, 4, 0]


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Even few flights at once."""
    monkeypatch.setattr(module, "MANY", 1)


@pytest.mark.parametrize("inject", SMALL)
@pytest.mark.parametrize(
    "preset, parameters", [("2013", {}), ("today", {}), ("outdoors", {}), ("outdoors", {"takeoff": 2.0})]
)
def test_many_are_what_each_is_alone(preset, parameters, inject):
    plant = Quadrotor(preset, parameters)
    signal = random_binary(SMALL[inject], 1.0)
    many = plant.run_many(signal, inject=inject, seeds=SEEDS)
    assert len(many) == len(SEEDS)
    for recording, seed in zip(many, SEEDS, strict=True):
        alone = plant.run(signal, inject=inject, seed=seed)
        np.testing.assert_array_equal(recording.values, alone.values)
        assert recording.origin == alone.origin and recording.channels == alone.channels


def test_the_first_flights_do_not_depend_on_how_many_follow(monkeypatch):
    signal = random_binary((10, 10, 50), 1.0)
    whole = PLANT.run_many(signal, seeds=range(5))
    monkeypatch.setattr(module, "MANY_SAMPLES", 1000)  # two flights of 500 steps at a time
    for parts, recording in zip(PLANT.run_many(signal, seeds=range(5)), whole, strict=True):
        np.testing.assert_array_equal(parts.values, recording.values)
    assert PLANT.run_many(signal, seeds=[]) == []


def test_few_flights_go_one_after_the_other(monkeypatch):
    signal = random_binary((10, 10, 50), 1.0)
    together = PLANT.run_many(signal, seeds=[1, 2])
    monkeypatch.setattr(module, "MANY", 3)
    monkeypatch.setattr(module, "fly_many", None)
    for single, recording in zip(PLANT.run_many(signal, seeds=[1, 2]), together, strict=True):
        np.testing.assert_array_equal(single.values, recording.values)


def test_without_noise_all_are_the_same():
    one, other = PLANT.run_many(random_binary((10, 10, 50), 1.0), seeds=[1, 2], noise=False)
    assert one.values.tobytes() == other.values.tobytes()


def test_the_unsafe_flight_is_named():
    signal, noise = random_binary((10, 10, 10), 2.0), {"gyro": 16.0}
    ends = {}
    for seed in range(12):
        try:
            PLANT.run(signal, noise=noise, seed=seed)
        except SimulationStopped as stop:
            ends[float(str(stop).split("stopped at ")[1].split(" s")[0])] = stop
    assert 0 < len(ends) < 12  # some stop, some do not
    with pytest.raises(SimulationStopped) as caught:
        PLANT.run_many(signal, noise=noise, seeds=range(12))
    assert str(caught.value) == str(ends[min(ends)])


def test_the_same_bits_in_another_process():
    code = (
        "import hashlib; from quadrotor_flights import random_binary; from plants.quadrotor.plant import Quadrotor;"
        "r = Quadrotor('outdoors').run(random_binary((10, 10, 50), 1.0), seed=3);"
        "import sys; sys.stdout.write(hashlib.sha256(r.values.tobytes()).hexdigest())"
    )
    there = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONPATH": ":".join(sys.path)}
    )
    here = Quadrotor("outdoors").run_many(random_binary((10, 10, 50), 1.0), seeds=[3])[0]
    assert there.stdout == hashlib.sha256(here.values.tobytes()).hexdigest()
