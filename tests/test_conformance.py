"""Every method and every plant of the tables, against the conformance suites."""

import pytest

from identify import checks as method_checks
from identify.method import list_methods
from plants import checks as plant_checks
from plants.plant import list_plants, load_plant


@pytest.mark.parametrize("check", method_checks.CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", list_methods())
def test_method(name, check):
    check(name)


PLACES = [(name, place) for name in list_plants() for place in load_plant(name).injections]


@pytest.mark.parametrize("check", plant_checks.CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize(("name", "place"), PLACES)
def test_plant(name, place, check):
    check(load_plant(name), place)
