"""Every method and every plant of the tables, against the conformance suites."""

import pytest

from identify import checks as method_checks
from identify.method import list_methods
from plants import checks as plant_checks
from plants.plant import list_plants, load_plant

PAIRS = [(name, check) for name in list_methods() for check in method_checks.checks_of(name)]


@pytest.mark.parametrize(("name", "check"), PAIRS, ids=lambda part: getattr(part, "__name__", part))
def test_method(name, check):
    check(name)


PLACES = [
    (name, place, check)
    for name in list_plants()
    for plant in [load_plant(name)]
    for place in plant.injections
    for check in plant_checks.checks_of(plant)
]


@pytest.mark.parametrize(("name", "place", "check"), PLACES, ids=lambda part: getattr(part, "__name__", part))
def test_plant(name, place, check):
    check(load_plant(name), place)
