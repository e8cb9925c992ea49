"""The table of generators: conformance of ours, a generator of another package, and what is left out of the table."""

import numpy as np
import pytest
from installed import install, plug_in

from excite.errors import ExciteError
from excite.generators import GENERATORS, in_sequence, regenerate
from excite.generators.conformance import check_generator, checks_of
from excite.types.recipe import Recipe
from excite.types.signal import Signal

BAND = {"start_hz": 1.0, "stop_hz": 10.0}
NO_PEAK = {"check_amplitude": "Gaussian: it has an rms and no peak"}
EXAMPLES = [
    ("prbs", {"order": 5, "dt": 0.1}, {}),
    ("prbs", {"order": 6, "dt": 0.1, "decorrelate": "hadamard", "band_limit_hz": 2.0, "inverse_repeat": True}, {}),
    ("noise", {"dt": 0.1, "duration_s": 5.0, "form": "white"}, NO_PEAK),
    ("noise", {"dt": 0.1, "duration_s": 5.0, "form": "band-limited", "band_hz": [1.0, 3.0]}, NO_PEAK),
    ("noise", {"dt": 0.1, "duration_s": 5.0, "form": "gbn", "switch_probability": 0.3, "periods": 2}, {}),
    ("noise", {"dt": 0.1, "duration_s": 5.0, "form": "multilevel", "levels": 4}, {}),
    ("sweep", {"dt": 0.01, "duration_s": 3.0, **BAND}, {}),
    ("sweep", {"dt": 0.01, "form": "stepped", "points": 3, **BAND}, {}),
    ("sweep", {"dt": 0.01, "form": "schroeder", "duration_s": 3.0, "periods": 2, **BAND}, {}),
    ("multistep", {"dt": 0.1, "unit_s": 0.5, "form": "staircase"}, {}),
    ("multisine", {"dt": 0.01, "period_s": 2.0, "band_hz": [1.0, 5.0], "phases": "schroeder", "periods": 2}, {}),
    ("multisine", {"dt": 0.01, "period_s": 2.0, "lines": [3, 5, 9], "starts": 1, "orthogonal": "dft"}, {}),
]
STAIRS = '''
from collections.abc import Sequence
import numpy as np
from excite.types.recipe import Recipe
from excite.types.signal import Signal
from excite.generators.parameters import Channels, Parameters

check = Parameters("steps_up")

def steps_up(*, dt: float, count: int = 4, amplitude: float | Sequence[float] = 1.0, channels: Channels = 1,
             seed: int = 0) -> Signal:
    """Return a stair that goes up."""
    dt, named, seed = check.seconds("dt", dt), check.channels(channels), check.seed(seed)
    count, levels = check.whole("count", count), check.amplitudes("amplitude", amplitude, len(named))
    check.bounded("count", count, count, len(named), "give fewer")
    u = np.outer(np.arange(1, count + 1) / count, levels)
    recipe = Recipe.of(steps_up, dt=dt, count=count, amplitude=levels, channels=[str(c) for c in named], seed=seed)
    return Signal(u, dt, named, None, recipe)

def silent(dt, channels=1, seed=0) -> Signal:
    return Signal([0.0], dt)

def nothing(*, dt: float, channels: Channels = 1, seed: int = 0):
    return None

def without_seed(*, dt: float, channels: Channels = 1) -> Signal:
    return Signal([0.0], dt)

number = 3
'''


@pytest.mark.parametrize(("name", "example", "exceptions"), EXAMPLES, ids=lambda part: str(part)[:40])
def test_every_generator_conforms(name, example, exceptions):
    check_generator(GENERATORS[name], example, exceptions)


def test_every_generator_of_ours_has_an_example():
    assert {name for name, *_ in EXAMPLES} == set(GENERATORS)


@pytest.fixture
def outside(tmp_path, monkeypatch):
    names = ["steps_up", "silent", "nothing", "without_seed", "number", "gone"]
    entries = {name: f"outside_signals:{name}" for name in names} | {"stairs": "outside_signals:steps_up"}
    entries |= {"prbs": "outside_signals:steps_up", "absent": "no_such_module:it"}
    install(tmp_path, "outside", {"outside_signals.py": STAIRS}, {GENERATORS.group: entries})
    plug_in(monkeypatch, GENERATORS, tmp_path)


def test_a_generator_of_another_package_is_one_of_the_table(outside):
    assert {"steps_up", "stairs", "prbs"} < set(GENERATORS)
    steps_up = GENERATORS["stairs"]
    assert GENERATORS.distribution("stairs") == ("outside", "0.1") and GENERATORS.distribution("prbs") is None
    check_generator(steps_up, {"dt": 0.1})
    signal = steps_up(dt=0.5, channels=["a", "b"], amplitude=[1, 2])
    several = in_sequence([signal, signal], rest_s=1.0)
    for each in (signal, several):
        assert regenerate(each.recipe).u.tobytes() == each.u.tobytes()
        assert regenerate(each.recipe.to_dict()).u.tobytes() == each.u.tobytes()


def test_what_is_no_generator_is_left_out_with_the_reason(outside):
    reasons = {text.split(" ")[0]: reason for text, reason in GENERATORS.skipped.items()}
    assert "parameter 'dt' has no annotation" in reasons["silent"]
    assert "annotate it with -> Signal" in reasons["nothing"]
    assert "no parameter 'seed'" in reasons["without_seed"]
    assert "no function" in reasons["number"] and "AttributeError" in reasons["gone"]
    assert "the name is taken by excite" in reasons["prbs"] and "ModuleNotFoundError" in reasons["absent"]
    with pytest.raises(ExciteError, match="generator 'silent' does not exist"):
        GENERATORS["silent"]


def test_a_recipe_of_a_package_that_is_not_installed_is_refused():
    with pytest.raises(ExciteError, match=r"recipe: kind: 'steps_up'; .*known: .*prbs"):
        regenerate(Recipe("steps_up", {"dt": 0.1}))


def bad_generator(fault):
    """A stair with one fault."""

    def stair(*, dt: float, amplitude: float = 1.0, channels: int = 1, seed: int = 0) -> Signal:
        if fault != "accepts all" and not (isinstance(dt, float) and 0 < dt < np.inf):
            raise ExciteError(f"stair: dt: {dt!r}; give a positive number")
        names = channels if isinstance(channels, list) else [f"u{i}" for i in range(channels)]
        u = np.outer([1.0, 2.0, 3.0], np.resize(np.asarray(amplitude, float), len(names)))
        u = u / 3 if fault != "too large" else u
        if fault == "random":
            u = u * np.random.default_rng().uniform()
        recipe = None
        if fault != "no recipe":
            recipe = Recipe.of(stair, dt=dt, amplitude=amplitude, channels=names, seed=seed)
        return Signal(u, dt, names, 1 if fault == "no period" else None, recipe)

    return stair


@pytest.mark.parametrize(
    ("fault", "check"),
    [
        ("too large", "check_amplitude"),
        ("random", "check_seed"),
        ("random", "check_recipe_regenerates"),
        ("no recipe", "check_signal"),
        ("no period", "check_period"),
        ("accepts all", "check_refusals"),
    ],
)
def test_conformance_finds_a_fault(fault, check):
    with pytest.raises(AssertionError, match=check):
        check_generator(bad_generator(fault), {"dt": 0.1})


def test_exceptions_are_declared_with_a_reason():
    stair = bad_generator("too large")
    names = [check.__name__ for check in checks_of(stair, {"check_amplitude": "it is a stair"})]
    assert "check_amplitude" not in names and "check_seed" in names
    with pytest.raises(ExciteError, match=r"no check 'check_amplitde'; did you mean 'check_amplitude'"):
        checks_of(stair, {"check_amplitde": "it is a stair"})
    with pytest.raises(ExciteError, match="has no reason"):
        checks_of(stair, {"check_amplitude": ""})
