"""The one checker of user values: what passes comes back plain, what does not is refused as `place: value; remedy`."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from excite import arguments
from excite.errors import ExciteError

ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.floats(), max_size=3),
    st.just(10**400),
    st.just({}),
    st.just(1j),
    st.just(np.float32(0.5)),
    st.just(np.int64(7)),
    st.just(np.bool_(True)),
)
CHECKS = {
    "whole": arguments.whole,
    "number": arguments.number,
    "positive": arguments.positive,
    "flag": arguments.flag,
    "text": arguments.text,
    "choice": lambda value, place: arguments.choice(value, place, ("a", "b")),
    "numbers": arguments.numbers,
    "one_per_channel": lambda value, place: arguments.one_per_channel(value, place, 2),
}


@given(ANYTHING, st.sampled_from(sorted(CHECKS)))
def test_every_value_is_returned_plain_or_refused_in_one_form(value, name):
    try:
        found = CHECKS[name](value, "here: it")
    except ExciteError as error:
        assert str(error).startswith(f"here: it: {value!r}") or "here: it[" in str(error)
        assert "; " in str(error)
    else:
        assert type(found) in (int, float, bool, str, list)
        if isinstance(found, (int, float)):
            assert math.isfinite(found) and found == value


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: arguments.whole(0, "x"), "x: 0; give a whole number of at least 1"),
        (lambda: arguments.whole(1.0, "x"), "x: 1.0; give a whole number"),
        (lambda: arguments.whole(2**64, "x"), "at most 64 bits"),
        (lambda: arguments.whole(9, "x", 1, 8), "x: 9; give a whole number of at most 8"),
        (lambda: arguments.number("a", "x"), "x: 'a' is not a number; give one"),
        (lambda: arguments.number(math.nan, "x"), "x: nan is not finite; give a finite number"),
        (lambda: arguments.number(10**400, "x"), "is not finite"),
        (lambda: arguments.number(-1, "x", 0, most=1), "x: -1; give a number, at least 0 and at most 1"),
        (lambda: arguments.number(0, "x", above=0), "x: 0; give a number, above 0"),
        (lambda: arguments.number(2, "x", most=1), "x: 2; give a number, at most 1"),
        (lambda: arguments.number(2, "x", most=1, remedy="lower it"), "x: 2; lower it"),
        (lambda: arguments.positive(True, "x"), "x: True is not a positive finite number; give a number above 0"),
        (lambda: arguments.flag(1, "x"), "x: 1; give true or false"),
        (lambda: arguments.choice("lgo", "x", ["log", "linear"]), "x: 'lgo'; did you mean 'log'?"),
        (lambda: arguments.numbers([1, "a"], "x"), "x[1]: 'a' is not a number"),
        (lambda: arguments.numbers(1, "x"), "x: 1; give a list of numbers"),
        (lambda: arguments.one_per_channel([1, 2, 3], "x", 2), "give one number, or one for each of the 2 channels"),
        (lambda: arguments.one_per_channel(math.inf, "x", 2), "x: inf; every number must be finite"),
    ],
)
def test_refusals_name_place_value_and_remedy(check, message):
    with pytest.raises(ExciteError) as caught:
        check()
    assert message in str(caught.value)


def test_values_come_back_in_plain_types():
    assert type(arguments.whole(np.int32(3), "x")) is int and type(arguments.number(np.float32(0.5), "x")) is float
    assert arguments.one_per_channel(2, "x", 3) == [2.0, 2.0, 2.0]
    assert arguments.one_per_channel(np.array([1, 2]), "x", 2) == [1.0, 2.0]
    assert arguments.whole(2**70, "seed", 0, math.inf) == 2**70


@given(st.floats(1e-6, 1e3), st.integers(1, 10_000))
def test_sampling_times_are_the_same_but_for_what_files_round(dt, count):
    assert arguments.same_dt(dt, float(f"{dt:.8g}")) and arguments.same_dt(float(f"{dt:.8g}"), dt)
    assert not arguments.same_dt(dt, dt * (1 + 3e-6)) and not arguments.same_dt(dt * (1 - 3e-6), dt)
    assert arguments.multiple(count * dt, dt) == count
    assert arguments.multiple((count + 0.4) * dt, dt) is None and arguments.multiple(0.4 * dt, dt) is None
