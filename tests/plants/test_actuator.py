"""Nonlinear actuators: the elements, their place in front of any linear plant, and what becomes of the truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.types.signal import Signal
from plants.linear.actuator import IN_FRONT, Backlash, Quantiser, RateLimit, Saturation, actuate
from plants.registry import list_plants, load_plant

U = np.random.default_rng(0).choice([-1.0, 1.0], (300, 1))
SIZES = {"actuator_quantum": 0.3, "actuator_saturation": 0.8, "actuator_rate": 0.5, "actuator_backlash": 0.2}
ELEMENTS = {
    "actuator_quantum": Quantiser(0.3),
    "actuator_saturation": Saturation(-0.8, 0.8),
    "actuator_rate": RateLimit(0.5),
    "actuator_backlash": Backlash(0.2),
}


def stepped(elements, u):
    """Every element asked sample by sample, as a loop does."""
    for element in elements:
        memory, rows = element.start(u.shape[1:]), []
        for each in u:
            v, memory = element.advance(each, memory)
            rows.append(v)
        u = np.array(rows)
    return u


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=30), st.permutations(list(ELEMENTS.values())))
def test_a_sequence_is_the_samples_one_by_one(values, elements):
    u = np.array(values)[:, None]
    v = actuate(elements, u)
    np.testing.assert_array_equal(v, stepped(elements, u))
    for element in elements:
        assert element.passes(u) == np.array_equal(actuate([element], u), u)


@pytest.mark.parametrize("key", IN_FRONT)
def test_an_element_stands_in_front_of_a_plant_in_open_loop(key):
    plant = load_plant("miller_51", parameters={key: SIZES[key]})
    recording = plant.run(Signal(U, 1.0), noise=False)
    data = recording.experiment("plant")
    np.testing.assert_array_equal(data.u, actuate([ELEMENTS[key]], U))
    np.testing.assert_array_equal(recording.columns(("u",)), U)
    truth = plant.truth(recording, "plant")
    assert truth.kind == "exact" and recording.origin.parameters[key] == SIZES[key]
    np.testing.assert_allclose(truth.model.simulate(data.u), data.y, atol=1e-10)


@pytest.mark.parametrize("name, inject", [("mercere_closed", "plant_input"), ("inverted_pendulum", "setpoint")])
def test_elements_stand_in_front_of_a_plant_in_closed_loop(name, inject):
    plant = load_plant(name, parameters={"actuator_saturation": 0.6, "actuator_rate": 0.3 / load_plant(name).dt})
    size = 1e-2 * np.array([high for _, high in plant.injections[inject].limits])
    recording = plant.run(
        Signal(size * np.random.default_rng(1).choice([-1.0, 1.0], (400, len(size))), plant.dt), inject=inject
    )
    names = tuple(c.name for c in plant.inputs)
    u, v = recording.columns(names), recording.columns(tuple(f"{n}_actual" for n in names))
    np.testing.assert_array_equal(v, actuate([Saturation(-0.6, 0.6), RateLimit(0.3)], u))
    assert np.abs(u - v).max() > 0.01
    clean = plant.run(Signal(size * U[:, :1].repeat(len(size), 1), plant.dt), inject=inject, noise=False).experiment(
        "plant"
    )
    np.testing.assert_allclose(plant.truth(None, "plant").model.simulate(clean.u[:100]), clean.y[:100], atol=1e-6)


def test_the_order_is_quantiser_saturation_rate_limit_backlash():
    plant = load_plant("lti", parameters=dict(reversed(SIZES.items())))
    recording = plant.run(Signal(3 * U, 1.0), noise=False)
    np.testing.assert_array_equal(recording.columns(("u_actual",)), actuate(list(ELEMENTS.values()), 3 * U))


def test_rates_are_per_second_and_sizes_may_differ_by_input():
    matrices = {"A": [[0.5]], "B": [[1.0, 1.0]], "C": [[1.0]], "dt": 0.1}
    plant = load_plant("lti", parameters=matrices | {"actuator_rate": [1.0, 2.0]})
    v = plant.run(Signal(np.ones((20, 2)), 0.1), noise=False).columns(("u1_actual", "u2_actual"))
    np.testing.assert_allclose(v[:3], [[0.1, 0.2], [0.2, 0.4], [0.3, 0.6]])


def test_what_has_no_small_signal_truth_has_no_response_view():
    smooth, rough = (
        load_plant("mercere_closed", parameters={key: 0.1}) for key in ("actuator_saturation", "actuator_quantum")
    )
    assert smooth.truth(None, "input_response").kind == "linearised" and smooth.truth(None, "plant").kind == "exact"
    assert all(set(place.views) == {"plant"} for place in rough.injections.values())


def test_a_recording_knows_its_actuator():
    plant = load_plant("mercere_closed", parameters={"actuator_saturation": 0.5})
    recording = plant.run(Signal(U, 1.0), inject="plant_input")
    plain = load_plant("mercere_closed").truth(recording, "plant").model
    assert plain.inputs[0].name == "u_actual"


@pytest.mark.parametrize(
    "name, parameters, message",
    [
        ("miller_31", {"actuator_rate": 0.0}, r"miller_31 parameter 'actuator_rate': 0.0; it must be positive"),
        ("miller_31", {"actuator_rate": [1.0, 2.0]}, r"has 2 numbers; give one, or 1"),
        ("miller_31", {"actuator_rate": "fast"}, r"'fast' is not a number"),
        ("quadrotor", {"actuator_saturation": 1.0}, r"quadrotor parameter .* this plant brings its own actuators"),
    ],
)
def test_refusals(name, parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant(name, parameters=parameters)


def test_every_linear_plant_takes_an_actuator():
    taking = [name for name in list_plants() if hasattr(load_plant(name), "actuator")]
    assert {"lti", "miller_31", "inverted_pendulum"} <= set(taking) and "quadrotor" not in taking
    for name in taking:
        assert load_plant(name, parameters={"actuator_quantum": 0.1}).parameters["actuator_quantum"].value == 0.1
