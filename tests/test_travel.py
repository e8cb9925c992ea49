"""What goes from room to room, or to another process, comes out of a pickle or a copy as it went in."""

import copy
import pickle
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass
from functools import cache
from multiprocessing import get_context

import numpy as np
import pytest

from excite.generators import in_sequence, prbs
from excite.models.fir import FirModel
from excite.models.foster import FosterModel
from excite.models.frequency_response import FrequencyResponse
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import certify
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.frozen import Frozen
from excite.types.level import Level
from excite.types.origin import Origin
from excite.types.recording import Recording
from excite.types.signal import Signal
from identify import list_methods, load_method
from identify.compare import compare
from identify.fit import fit
from plants import list_plants, load_plant
from plants.plant import Plant
from scenarios.run.plan import make_plan
from scenarios.scenario.reading import load_scenario


@cache
def travellers():
    """One of each type that goes from room to room, and to another process."""
    signal = prbs(order=5, dt=1.0, hold=2, channels=["flap [deg]"], amplitude=0.5)
    model = StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], 1.0, K=[[0.1]], innovation_cov=[[0.2]])
    plant = load_plant("mercere_closed")
    run = plant.run(signal, seed=1)
    found = {
        "channel": Channel("flap", "deg"),
        "frozen": Frozen(a=(1, 2), b=Frozen(c="d")),
        "signal": signal,
        "composition": in_sequence([signal, signal], rest_s=2.0),
        "recipe": signal.recipe,
        "roles": run.views["plant"],
        "loop": run.loop,
        "level": Level("known", (1.0,), (2.0,)),
        "origin": Origin("lti", "example", {"A": [[0.5]]}, "input", {"output": 0.1}, 3, preparation=("decimated",)),
        "recording": run,
        "experiment": run.experiment("plant"),
        "state space": model,
        "polynomial": PolynomialModel([[[1.0]], [[-0.5]]], [[[0.0]], [[1.0]]], 1.0),
        "truth": plant.truth(run, "setpoint_response"),
        "certificate": certify(signal, 5),
        "continuous": StateSpaceModel(*map(np.array, ([[0.5]], [[1.0]], [[1.0]], [[0.0]])), 1.0).to_continuous(),
        "fir": FirModel(np.ones((3, 1, 1)), 1.0),
        "foster": FosterModel(np.ones((2, 1, 1)), np.array([0.1, 1.0])),
        "frequency response": FrequencyResponse(np.array([0.1, 0.2]), np.ones((2, 1, 1), complex), 1.0),
        "estimate": fit(run.experiment("plant"), "arx", order=2),
        "comparison": compare(run.experiment("plant"), ["arx", "n4sid"], [1, 40], run.experiment("plant")),
        "plan": make_plan(load_scenario("two_mass_spring")),
    }
    return found | {name: load_method(name) for name in list_methods()}


def same(a, b):
    """Whether two values hold the same, down to the bits of arrays."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Mapping):
        return type(a) is type(b) and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("name", travellers())
def test_types_that_travel_pickle_and_copy(name):
    value = travellers()[name]
    for again in (pickle.loads(pickle.dumps(value)), copy.copy(value), copy.deepcopy(value)):
        assert same(again, value)
    if isinstance(value, (Signal, Recording, Experiment, StateSpaceModel)):
        again = pickle.loads(pickle.dumps(value))
        arrays = [getattr(again, f.name) for f in fields(again) if isinstance(getattr(again, f.name), np.ndarray)]
        assert arrays and not any(array.flags.writeable for array in arrays)


@pytest.mark.parametrize("name", list_plants())
def test_plants_travel_and_play_the_same(name):
    plant = load_plant(name)
    place = next(iter(plant.injections.values()))
    low, high = np.array(place.limits).T
    signal = Signal(np.tile((low + high) / 2 + 0.01 * (high - low), (10, 1)), 2 * plant.dt)
    expected = plant.run(signal, seed=3)
    for again in (pickle.loads(pickle.dumps(plant)), copy.copy(plant), copy.deepcopy(plant)):
        run = again.run(signal, seed=3)
        assert run.values.tobytes() == expected.values.tobytes() and run.origin == expected.origin
        view = expected.default
        assert same(again.truth(run, view).model, plant.truth(expected, view).model)


def test_a_plant_and_a_signal_go_to_another_process():
    """As a pool of workers takes them: a fresh interpreter, nothing inherited."""
    plant, signal = load_plant("quadrotor"), Signal(np.ones((10, 3)), 0.004)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        run = pool.submit(Plant.run, plant, signal, seed=3)
        judged = pool.submit(certify, prbs(order=5, dt=1.0), 10)
        assert run.result().values.tobytes() == plant.run(signal, seed=3).values.tobytes()
        assert judged.result().order == certify(prbs(order=5, dt=1.0), 10).order
