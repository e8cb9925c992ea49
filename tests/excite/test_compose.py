"""Compositions: parts found again where the recipe says, trim elsewhere, true periods, nested recipes, and their errors."""

import inspect
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators import in_sequence, multistep, noise, prbs, regenerate, rest, side_by_side, sweep, with_ramps
from excite.types.channel import Channel
from excite.types.signal import Signal

DT = 0.1


BASES = {
    "prbs": (prbs, {"order": 3, "dt": DT}),
    "prbs by duration": (prbs, {"dt": DT, "duration_s": 9.0}),
    "white": (noise, {"dt": DT, "duration_s": 3.0}),
    "band-limited": (noise, {"form": "band-limited", "dt": DT, "duration_s": 3.0, "band_hz": [1, 4]}),
    "gbn": (noise, {"form": "gbn", "dt": DT, "duration_s": 3.0, "mean_hold_s": 0.4}),
    "multilevel": (noise, {"form": "multilevel", "dt": DT, "duration_s": 3.0}),
    "log": (sweep, {"dt": DT, "start_hz": 0.5, "stop_hz": 4, "duration_s": 3.0}),
    "schroeder": (sweep, {"form": "schroeder", "dt": DT, "start_hz": 0.5, "stop_hz": 4, "duration_s": 3.0}),
    "stepped": (sweep, {"form": "stepped", "dt": DT, "start_hz": 0.5, "stop_hz": 4, "points": 3}),
    "doublet": (multistep, {"dt": DT, "unit_s": 0.3}),
    "staircase": (multistep, {"form": "staircase", "dt": DT, "unit_s": 0.3}),
    "rest": (rest, {"dt": DT, "duration_s": 0.3}),
}
FORMS = ("white", "binary", "log", "linear", "stepped", "pulse", "step", "shift", "hadamard", "sequences")


def part(index, channels, seed):
    """One of several short signals of different lengths."""
    makers = (
        lambda: prbs(3, dt=DT, channels=channels, seed=seed),
        lambda: noise(form="gbn", switch_probability=0.3, dt=DT, duration_s=1.3, channels=channels, seed=seed),
        lambda: sweep(dt=DT, start_hz=1, stop_hz=3, duration_s=2, channels=channels),
        lambda: multistep(form="3-2-1-1", dt=DT, unit_s=0.2, channels=channels),
        lambda: rest(dt=DT, duration_s=0.7, trim=0.5, channels=channels),
    )
    return makers[index]()


parts = st.lists(st.tuples(st.integers(0, 4), st.integers(0, 99)), min_size=1, max_size=4)


def round_trip(signal):
    again = regenerate(json.loads(json.dumps(signal.recipe.to_dict(), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes()
    assert (again.dt, again.channels, again.period, again.recipe) == (
        signal.dt,
        signal.channels,
        signal.period,
        signal.recipe,
    )


@settings(max_examples=30, deadline=None)
@given(parts, st.integers(0, 9), st.floats(-3, 3))
def test_in_sequence(chosen, pause, trim):
    signals = [part(index, 2, seed) for index, seed in chosen]
    signal = in_sequence(signals, rest_s=pause * DT, trim=trim)
    untouched = np.ones(len(signal.u), bool)
    for start, each in zip(signal.recipe["starts"], signals, strict=True):
        assert np.array_equal(signal.u[start : start + len(each.u)], each.u)
        untouched[start : start + len(each.u)] = False
    assert (signal.u[untouched] == trim).all()
    assert untouched.sum() == pause * (len(signals) - 1)
    assert signal.period == (signals[0].period if len(signals) == 1 else None)
    round_trip(signal)


@settings(max_examples=30, deadline=None)
@given(parts, st.floats(-3, 3))
def test_side_by_side(chosen, trim):
    signals = [part(index, 1 + seed % 2, seed) for index, seed in chosen]
    count = sum(len(s.channels) for s in signals)
    signal = side_by_side(signals, pad=True, trim=trim, channels=count)
    column = 0
    for each, padded in zip(signals, signal.recipe["padded_samples"], strict=True):
        block = signal.u[:, column : column + len(each.channels)]
        assert np.array_equal(block[: len(each.u)], each.u)
        assert len(block) - len(each.u) == padded and (block[len(each.u) :] == trim).all()
        column += len(each.channels)
    assert column == count
    if signal.period is not None:
        assert np.array_equal(signal.u[: -signal.period], signal.u[signal.period :])
    round_trip(signal)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 4), st.integers(0, 20), st.integers(0, 20), st.floats(-3, 3))
def test_ramps(index, up, down, trim):
    core = part(index, 2, 7)
    signal = with_ramps(core, up_s=up * DT, down_s=down * DT, trim=trim)
    start, length = signal.recipe["core_start"], signal.recipe["core_samples"]
    assert (start, length, len(signal.u)) == (up, len(core.u), up + len(core.u) + down)
    assert np.array_equal(signal.u[start : start + length], core.u)
    if up:
        assert (signal.u[0] == trim).all()
        steps = np.diff(signal.u[: up + 1], axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to((core.u[0] - trim) / up, steps.shape), atol=1e-12)
    if down:
        assert (signal.u[-1] == trim).all()
        steps = np.diff(signal.u[start + length - 1 :], axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to((trim - core.u[-1]) / down, steps.shape), atol=1e-12)
    assert signal.period == (None if up + down else core.period)
    round_trip(signal)


def test_compositions_nest():
    axes = [prbs(4, dt=DT, channels=f"{axis} [deg]", seed=seed) for seed, axis in enumerate("pqr")]
    flight = with_ramps(
        in_sequence(
            [side_by_side(axes), rest(dt=DT, duration_s=1, channels=[c for a in axes for c in a.channels])], rest_s=0.5
        ),
        up_s=0.4,
    )
    assert flight.channels == (Channel("p", "deg"), Channel("q", "deg"), Channel("r", "deg"))
    assert len(flight.u) == 4 + 15 + 5 + 10 + 4
    round_trip(flight)


def test_side_by_side_has_the_common_period():
    two = side_by_side([prbs(2, dt=DT, periods=35), prbs(3, dt=DT, periods=15)], channels=["a", "b"])
    assert two.period == 21
    assert np.array_equal(two.u[:-21], two.u[21:])
    assert side_by_side([prbs(4, dt=DT, periods=7), prbs(3, dt=DT, periods=15)], channels=2).period == 105
    assert side_by_side([prbs(4, dt=DT), prbs(4, dt=DT, duration_s=1.5, hold=2)], channels=2).period is None


def test_warnings_travel():
    cut = prbs(5, dt=DT, duration_s=4.0)
    signal = in_sequence([rest(dt=DT, duration_s=1.0), cut])
    assert signal.warnings == (f"signals[1]: {cut.warnings[0]}",)
    (padded, _) = side_by_side([rest(dt=DT, duration_s=1.0), cut], pad=True, channels=2).warnings
    assert padded == "signals[0] ends after 10 samples and rests at trim for 30"


toml = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.integers(-2, 9),
        st.floats(),
        st.floats(0, 9),
        st.text(max_size=5),
        st.sampled_from([10**400, -(10**30), 1e-320, 1e305, *FORMS]),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(sorted(BASES)), st.data())
def test_any_value_of_a_toml_file_is_played_or_refused(kind, data):
    """Nothing but an ExciteError, never a number that is not finite, and every recipe is strict JSON."""
    generator, base = BASES[kind]
    names = sorted(inspect.signature(generator).parameters)
    changed = data.draw(st.dictionaries(st.sampled_from(names), toml, min_size=1, max_size=2))
    try:
        signal = generator(**base | changed)
    except ExciteError:
        return
    if len(signal.u) < 10**5:
        round_trip(signal)


a, b, slow = prbs(3, dt=DT), prbs(4, dt=DT), prbs(3, dt=0.2)


@pytest.mark.parametrize(
    ("compose", "message"),
    [
        (
            lambda: in_sequence([a, slow]),
            "in_sequence: signals[1].dt: 0.2; signals[0] has dt = 0.1 s; bring both to one dt",
        ),
        (lambda: side_by_side([a, slow], channels=2), "side_by_side: signals[1].dt: 0.2;"),
        (lambda: side_by_side([a, b], channels=2), "side_by_side: signals[0]: 7; the longest has 15 samples"),
        (lambda: side_by_side([a, a]), "side_by_side: channels: ['u1', 'u1']; some names meet twice"),
        (lambda: side_by_side([a, a], channels=3), "the signals have 2 channels; give one name for each"),
        (lambda: side_by_side([a, a], channels=2, trim=[1, 2, 3]), "side_by_side: trim: [1, 2, 3];"),
        (lambda: in_sequence([]), "in_sequence: signals: []; give at least one Signal, in a list"),
        (lambda: in_sequence(a), "in_sequence: signals: 'Signal'; give at least one Signal, in a list"),
        (lambda: in_sequence([a, 3]), "in_sequence: signals: ['Signal', 'int']; give at least one Signal"),
        (
            lambda: in_sequence([a, prbs(3, dt=DT, channels="x")]),
            "in_sequence: signals[1]: 'x'; signals[0] has the channels u1",
        ),
        (lambda: in_sequence([a, a], rest_s=-1), "in_sequence: rest_s: -1; give a number of seconds, 0 for none"),
        (lambda: in_sequence([a, a], rest_s=1e9), "exceed 200000000 values"),
        (lambda: in_sequence([a], trim=float("nan")), "in_sequence: trim: nan; every trim must be finite"),
        (lambda: rest(dt=DT, duration_s=0), "rest: duration_s: 0;"),
        (lambda: rest(dt=DT, duration_s=1e9), "exceed 200000000 values"),
        (lambda: with_ramps(a, up_s=-1), "with_ramps: up_s: -1;"),
        (lambda: with_ramps(a, up_s=1e9), "exceed 200000000 values"),
        (lambda: with_ramps([a], up_s=1), "with_ramps: signals: ['list'];"),
    ],
)
def test_what_does_not_fit_is_named(compose, message):
    with pytest.raises(ExciteError) as caught:
        compose()
    assert message in str(caught.value)


def test_a_signal_without_recipe_is_played_but_not_regenerated():
    signal = in_sequence([Signal([1.0, 2.0], DT), Signal([3.0], DT)])
    assert signal.u[:, 0].tolist() == [1, 2, 3]
    with pytest.raises(ExciteError, match=r"recipe: signals\[0\]: this part was not made by a generator"):
        regenerate(signal.recipe)
