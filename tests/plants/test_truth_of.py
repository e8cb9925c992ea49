"""The truth behind a recording: that of the plant, preset, parameters and view it states."""

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.generators import prbs
from excite.types.origin import Origin
from plants.describe import describe_plant
from plants.registry import load_plant
from plants.truth_of import truth_of


@pytest.fixture(scope="module")
def record():
    plant = load_plant("two_mass_spring", parameters={"stiffness": 2.0})
    return plant.run(prbs(order=5, dt=0.1), seed=1)


def test_it_is_the_truth_of_the_plant_with_its_parameters(record):
    found, known = truth_of(record), load_plant("two_mass_spring", parameters={"stiffness": 2.0}).truth(record, "plant")
    np.testing.assert_array_equal(found.model.A, known.model.A)
    assert not np.allclose(found.model.A, load_plant("two_mass_spring").truth(None, "plant").model.A)


def test_a_decimated_view_has_the_lifted_truth(record):
    found = truth_of(record, "plant", dt=0.3)
    np.testing.assert_allclose(np.sort_complex(found.poles), np.sort_complex(truth_of(record).poles ** 3), atol=1e-9)
    assert found.model.dt == pytest.approx(0.3)
    for dt in (0.25, 0.04):
        with pytest.raises(ExciteError, match=f"dt {dt} s is no whole multiple of the recorded 0.1 s"):
            truth_of(record, dt=dt)


def test_a_recording_without_a_plant_has_none(record):
    with pytest.raises(ExciteError, match="does not say which plant and view it comes from"):
        truth_of(replace(record, origin=Origin(file="flight.csv")))


def test_a_description_holds_every_place_view_and_number():
    plant = load_plant("goland")
    described = describe_plant(plant)
    assert set(described["injections"]) == set(plant.injections) and set(described["views"]) == set(plant.views)
    view = described["views"]["plant"]
    np.testing.assert_array_equal(view["poles"], plant.truth(None, "plant").poles)
    assert view["closed"] is False and view["dt"] == plant.dt and described["parameters"]["speed"]["unit"] == "m/s"
    assert described["injections"]["input"]["channels"][0]["channel"] == "force [N]"
