"""A known dead time of the inputs: taken out of the data, held in states of the model."""

from dataclasses import fields

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from identify.fit import fit
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors
from identify.orders.table import order_table
from identify.registry import METHODS, load_method, method_class
from scenarios.report.text import estimate_text

DEAD = 4
PLANT = StateSpaceModel(
    [[0.9, 0.2, 0], [-0.2, 0.9, 0], [0, 0, 0.6]],
    [[1.0, 0], [0.5, 1], [0.3, -0.8]],
    [[1.0, 0, 0.4], [0.2, -0.6, 1]],
    np.zeros((2, 2)),
    1.0,
    K=[[0.3, 0], [0, 0.2], [0.1, 0.1]],
    innovation_cov=0.01 * np.eye(2),
)
TAKING = [name for name in METHODS if "input_delay" in (setting.name for setting in fields(method_class(name)))]


def record(samples=2000, noise=0.0, seed=0, **more):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 2))
    y = PLANT.delayed(DEAD).simulate(u, rng.standard_normal(3 + 2 * DEAD)) + noise * rng.standard_normal((samples, 2))
    return Experiment(u, y, dt=1.0, **more)


def test_a_delayed_model_does_the_same_later():
    late, rng = PLANT.delayed(DEAD), np.random.default_rng(1)
    assert late.order == 3 + 2 * DEAD and PLANT.delayed(0) is PLANT
    np.testing.assert_array_equal(late.impulse(30)[:DEAD], 0)
    np.testing.assert_allclose(late.impulse(30)[DEAD:], PLANT.impulse(26), atol=1e-14)
    f = np.array([0.01, 0.1, 0.4])
    np.testing.assert_allclose(late.frf(f), PLANT.frf(f) * np.exp(-2j * np.pi * f * DEAD)[:, None, None], atol=1e-13)
    data = Experiment(rng.standard_normal((100, 2)), rng.standard_normal((100, 2)), dt=1.0)
    earlier = Experiment(np.vstack([np.zeros((DEAD, 2)), data.u[:-DEAD]]), data.y, dt=1.0)
    for horizon in (1, 7):
        np.testing.assert_allclose(late.predict(data, horizon), PLANT.predict(earlier, horizon), atol=1e-12)
    assert [m.f_hz for m in late.modes()] == pytest.approx([m.f_hz for m in PLANT.modes()])
    errors = pole_errors(PLANT.poles(), late.poles(), 1.0)
    assert errors.surplus == 0 and errors.relative.max() < 1e-9


@pytest.mark.parametrize("name", TAKING)
def test_the_order_is_that_of_the_plant_alone(name):
    """Without the setting three states cannot hold the plant and eight samples on their way."""
    data = record(noise=0.001)
    estimate = fit(data, name, 3, input_delay=DEAD)
    assert (estimate.order, estimate.model.order) == (3, 3 + 2 * DEAD)
    np.testing.assert_array_equal(estimate.model.impulse(DEAD), 0)
    truth, blind = PLANT.delayed(DEAD), fit(data, name, 3)
    error = impulse_error(estimate.model, truth)
    assert error < 0.01 and impulse_error(blind.model, truth) > 10 * error
    response = estimate.model.simulate(data.u, estimate.x0[0])
    assert np.abs(response - data.y).max() < 0.05 * data.y.std(), "from the first sample on"


def test_open_loop_estimates_are_exact_without_noise():
    for name in ("po_moesp", "moesp", "n4sid", "cva"):
        estimate = fit(record(), name, 3, input_delay=DEAD)
        assert pole_errors(PLANT.poles(), estimate.model.poles(), 1.0).z.max() < 1e-9
        np.testing.assert_allclose(estimate.model.impulse(40), PLANT.delayed(DEAD).impulse(40), atol=1e-8)


def test_gaps_several_records_and_closed_loops():
    first, second = record(seed=3), record(seed=4, samples=900)
    y = first.y.copy()
    y[[0, 700]] = np.nan
    both = (Experiment(first.u, y, dt=1.0), second)
    estimate = fit(both, "po_moesp", 3, input_delay=DEAD)
    assert impulse_error(estimate.model, PLANT.delayed(DEAD)) < 1e-8 and len(estimate.x0) == 2
    np.testing.assert_allclose(estimate.model.simulate(first.u[1:], estimate.x0[0]), first.y[1:], atol=1e-7)
    np.testing.assert_allclose(estimate.model.simulate(second.u, estimate.x0[1]), second.y, atol=1e-7)
    closed = fit(record(noise=0.01, loop=Loop("closed")), "ssarx", 3, input_delay=DEAD)
    assert impulse_error(closed.model, PLANT.delayed(DEAD)) < 0.02


def test_orders_count_the_plant_alone_and_share_what_is_prepared():
    table = order_table(record(noise=0.01), load_method("ssarx", input_delay=DEAD), range(1, 7))
    assert [row.order for row in table.rows] == [1, 2, 3, 4, 5, 6] and table.chosen["bic"] == 3
    assert {pole.order for pole in table.poles} == {1, 2, 3, 4, 5, 6}
    shared = {}
    data = record()
    for delay in (0, DEAD):
        fit(data, load_method("po_moesp", input_delay=delay), 3, shared=shared)
    assert len(shared) == 2


def test_the_text_names_poles_that_only_delay():
    estimate = fit(record(noise=0.01), "po_moesp", 3, input_delay=DEAD)
    text = estimate_text(estimate, {})
    assert "poles at the origin, which only delay: 8" in text and not any("0.0000 " in line for line in text)


@pytest.mark.parametrize(
    ("delay", "message"),
    [
        (-1, "po_moesp.input_delay: -1; give a whole number of at least 0"),
        (2.5, "po_moesp.input_delay: 2.5; give a whole number of at least 0"),
        (3000, "input_delay 3000: the shortest record has only 2000 samples; give fewer"),
        (1990, "the largest possible past"),
    ],
)
def test_what_cannot_be(delay, message):
    with pytest.raises(ExciteError, match=message):
        fit(record(), "po_moesp", 3, input_delay=delay)
