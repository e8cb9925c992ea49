"""The figure of a plant: its truth, told alike by picture and data."""

import numpy as np
import pytest
from drawings import check_figure

from excite.figures.figure import Points
from excite.models.modes import continuous_poles
from excite.models.state_space import StateSpaceModel
from excite.types.truth import Truth
from plants.figures.plant import plant_figure
from plants.registry import PLANTS, load_plant

DT = 0.1


def truths(name):
    plant = load_plant(name)
    return {view: plant.truth(None, view) for view in plant.views}


@pytest.mark.parametrize("name", PLANTS)
def test_every_plant_is_drawn(name):
    figure = plant_figure(name, truths(name))
    check_figure(figure, most=2_000_000)
    assert figure.grid == (len(truths(name)), 4)


def lag(time_constant_s, gain):
    """A first-order lag, sampled exactly."""
    pole = np.exp(-DT / time_constant_s)
    return StateSpaceModel(
        [[pole]], [[gain * (1 - pole)]], [[1.0]], [[0.0]], DT, inputs=["<valve> [%]"], outputs=["$flow$ [l/s]"]
    )


def test_a_lag_is_drawn_as_the_textbook_has_it():
    figure = plant_figure("lag", {"only": Truth(lag(2.0, 5.0), "exact")})
    step, magnitude, phase, poles = (panel.marks[-1] for panel in figure.panels)
    np.testing.assert_allclose(step.y, 5 * (1 - np.exp(-step.x / 2)), atol=1e-9)
    assert step.x[-1] == pytest.approx(12, abs=0.2) and step.steps  # six time constants
    ideal = 5 / np.abs(1 + 2j * np.pi * magnitude.x * 2)
    near = magnitude.x < 0.1  # where sampling has no part in it
    np.testing.assert_allclose(magnitude.y[near], 20 * np.log10(ideal[near]), atol=0.02)
    assert -90 - 180 * phase.x[-1] * DT * 1.01 < phase.y[-1] < phase.y[0] < 0  # half a sample of delay by the hold
    np.testing.assert_allclose([poles.x, poles.y], [[-0.5], [0.0]], atol=1e-9)
    assert figure.verdict == "only: 1 pole, the slowest with 2 s."
    assert step.label == "<valve> → $flow$"


def test_poles_are_those_of_the_upper_half_plane():
    found = truths("quadrotor")
    figure = plant_figure("quadrotor", found)
    for row, truth in enumerate(found.values()):
        (panel,) = [p for p in figure.panels if (p.row, p.column) == (row, 3)]
        (crosses,) = [mark for mark in panel.marks if isinstance(mark, Points)]
        s = continuous_poles(truth.poles, truth.model.dt)
        assert (crosses.y > -1e-6).all()
        assert set(np.round(crosses.x + 1j * crosses.y, 6)) <= set(np.round(s, 6))


def test_what_integrates_or_grows_is_said():
    integrator = StateSpaceModel([[1.0]], [[1.0]], [[1.0]], [[0.0]], DT)
    growing = StateSpaceModel([[np.exp(0.3 * DT)]], [[1.0]], [[1.0]], [[0.0]], DT)
    said = plant_figure("two", {"a": Truth(integrator, "exact"), "b": Truth(growing, "exact")}).verdict
    assert said == "a: 1 pole, integrating; b: 1 pole, unstable, the fastest growing at 0.3 rad/s."
