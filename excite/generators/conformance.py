"""Conformance of generators: what every function of the table must satisfy, ours and those of other packages.

`check_generator(function, example)` runs everything; a test runner may take the callables of `checks_of` one by one.
"""

import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.generators.registry import Generator, regenerate
from excite.plain import plain
from excite.types.recipe import Recipe
from excite.types.signal import Signal

Example = Mapping[str, Any]
JUNK: tuple[Any, ...] = (float("nan"), float("inf"), -1.0, "no such thing", [], {}, True, object())
MUST_REFUSE = {"dt": (0, -1.0, float("nan"), "fast", None), "channels": (0, -1, [], ["a", "a"]), "seed": (-1, 0.5, "x")}


def check_signal(generator: Generator, example: Example) -> None:
    """A Signal of the sampling time and the channels asked for, with a recipe in plain values."""
    named = {**example, "channels": ["first [V]", "second [deg]"]}
    signal = generator(**named)
    assert isinstance(signal, Signal), f"a {type(signal).__name__} is no Signal"
    assert signal.dt == example["dt"] and [str(c) for c in signal.channels] == named["channels"]
    assert generator(**{**example, "channels": 3}).u.shape[1] == 3
    assert isinstance(signal.recipe, Recipe), "there is no recipe; give Signal one by Recipe.of"
    json.dumps(plain(signal.recipe.to_dict(), "recipe", finite=False), allow_nan=False)


def check_recipe_regenerates(generator: Generator, example: Example) -> None:
    """The recipe gives the same bits again, also when it has been through a file."""
    for channels in (1, 2):
        signal = generator(**{**example, "channels": channels, "seed": 3})
        assert signal.recipe is not None, "a generated signal has a recipe"
        written = json.loads(json.dumps(signal.recipe.to_dict()))
        for recipe in (signal.recipe, written):
            again = regenerate(recipe, generator)
            assert again.u.tobytes() == signal.u.tobytes() and again.period == signal.period
            assert again.recipe is not None and again.recipe.to_dict() == signal.recipe.to_dict()


def check_seed(generator: Generator, example: Example) -> None:
    """The same seed gives the same bits, whatever was played between."""
    first = generator(**{**example, "seed": 5})
    generator(**{**example, "seed": 6})
    assert first.u.tobytes() == generator(**{**example, "seed": 5}).u.tobytes()


def check_amplitude(generator: Generator, example: Example) -> None:
    """Levels lie within the amplitude about the offset, and grow with it; so for each channel."""
    known = inspect.signature(generator).parameters
    if "amplitude" not in known:
        return
    peaks, offsets = np.array([0.5, 20.0]), np.array([1.0, -3.0])
    offsets = offsets if "offset" in known else np.zeros(2)
    given = {"amplitude": peaks.tolist()} | ({"offset": offsets.tolist()} if "offset" in known else {})
    signal = generator(**{**example, "channels": 2, **given})
    assert (np.abs(signal.u - offsets) <= peaks * (1 + 1e-12)).all(), "a level leaves the amplitude"
    assert (np.abs(signal.u - offsets).max(axis=0) > 0).all(), "a channel plays nothing"
    twice = generator(**{**example, "channels": 2, **given, "amplitude": (2 * peaks).tolist()})
    np.testing.assert_allclose(twice.u - offsets, 2 * (signal.u - offsets), atol=1e-9 * peaks.max())


def check_period(generator: Generator, example: Example) -> None:
    """A period that is stated is one."""
    signal = generator(**example)
    if signal.period is not None and signal.period < len(signal.u):
        np.testing.assert_allclose(signal.u[signal.period :], signal.u[: -signal.period], rtol=0, atol=1e-9)


def check_refusals(generator: Generator, example: Example) -> None:
    """What no generator can play is refused by name; other junk is refused in words, or played, but never crashes."""
    for name, values in MUST_REFUSE.items():
        for value in values:
            try:
                generator(**{**example, name: value})
            except ExciteError as error:
                assert name in str(error) and ";" in str(error), f"names no place or no remedy: {error}"
            else:
                raise AssertionError(f"{name} = {value!r} is played; refuse it")
    for name in inspect.signature(generator).parameters:
        for value in JUNK:
            try:
                generator(**{**example, name: value})
            except ExciteError as error:
                assert ";" in str(error), f"no remedy: {error}"


CHECKS: tuple[Callable[[Generator, Example], None], ...] = (
    check_signal,
    check_recipe_regenerates,
    check_seed,
    check_amplitude,
    check_period,
    check_refusals,
)


def checks_of(generator: Generator, exceptions: Mapping[str, str] | None = None) -> list[Callable]:
    """Return the checks but for those excepted: name of a check -> why the generator need not pass it."""
    known = [check.__name__ for check in CHECKS]
    for name, reason in (exceptions or {}).items():
        if name not in known:
            raise ExciteError(f"{generator.__name__} exceptions: no check '{name}'; {did_you_mean(name, known)}")
        if not reason:
            raise ExciteError(f"{generator.__name__} exceptions '{name}': has no reason; say why it need not pass")
    return [check for check in CHECKS if check.__name__ not in (exceptions or {})]


def check_generator(generator: Generator, example: Example, exceptions: Mapping[str, str] | None = None) -> None:
    """Check a generator, ours or anybody's.

    Parameters
    ----------
    generator : the function.
    example : parameters that make a short signal, without channels and seed; dt among them.
    exceptions : name of a check -> why this generator need not pass it.

    Raises
    ------
    AssertionError listing every check that fails; ExciteError for an exception that names no check, or gives no reason.

    Example
    -------
    >>> from excite import prbs
    >>> check_generator(prbs, {"dt": 0.1, "order": 5})
    """
    failures = []
    for check in checks_of(generator, exceptions):
        try:
            check(generator, example)
        except Exception as error:  # whatever somebody's generator raises is the finding
            failures.append(f"{check.__name__}: {type(error).__name__}: {error}")
    if failures:
        raise AssertionError(f"{generator.__name__}: {len(failures)} checks fail:\n" + "\n".join(failures))
