"""Every method and every plant of the tables, against the conformance suites."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest

from identify import conformance as method_checks
from identify.registry import list_methods, load_method
from plants import conformance as plant_checks
from plants.registry import list_plants, load_plant

PAIRS = [(name, check) for name in list_methods() for check in method_checks.checks_of(load_method(name))]


@pytest.mark.parametrize(("name", "check"), PAIRS, ids=lambda part: getattr(part, "__name__", part))
def test_method(name, check):
    check(load_method(name))


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


def digests():
    """Return a digest of a noisy run of every plant."""
    found = {}
    for name in list_plants():
        plant = load_plant(name)
        place = next(iter(plant.injections))
        values = plant.run(plant_checks.small_signal(plant, place), inject=place, seed=1).values
        found[name] = hashlib.sha256(values.tobytes()).hexdigest()
    return found


def test_another_process_gives_the_same_bits():
    script = "import sys; sys.path.insert(0, sys.argv[1]); from test_conformance import digests; print(digests())"
    run = subprocess.run(
        [sys.executable, "-c", script, str(Path(__file__).parent)], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == str(digests())
