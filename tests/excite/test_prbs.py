"""PRBS: the properties that define a maximum-length sequence, then the parameters and their errors."""

import json
import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sequences import circular_correlation, is_primitive

from excite.errors import ExciteError
from excite.generators import GENERATORS, prbs, regenerate
from excite.types.channel import Channel
from excite.types.recipe import Recipe

ORDERS = range(2, 15)


@settings(max_examples=30, deadline=None)
@given(
    st.integers(2, 9), st.integers(1, 3), st.integers(0, 99), st.integers(1, 3), st.sampled_from(["shift", "hadamard"])
)
def test_inverse_repeat_has_no_even_lines(order, hold, seed, count, decorrelate):
    signal = prbs(
        order=order,
        dt=1.0,
        hold=hold,
        seed=seed,
        channels=count,
        decorrelate=decorrelate,
        inverse_repeat=True,
        amplitude=3,
    )
    half = signal.period // 2
    assert np.array_equal(signal.u[:half], -signal.u[half:])
    lines = np.abs(np.fft.fft(signal.u, axis=0)) / len(signal.u)
    assert lines[::2].max() < 1e-14
    assert signal.recipe["period_samples"] % (2 * (2**order - 1) * hold) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(3, 8), st.integers(2, 8), st.integers(0, 99), st.booleans())
def test_hadamard_channels_are_orthogonal(order, count, seed, inverse_repeat):
    signal = prbs(order=order, dt=1.0, channels=count, decorrelate="hadamard", inverse_repeat=inverse_repeat, seed=seed)
    u, length, recipe = signal.u, 2**order - 1, signal.recipe
    K = (1 + inverse_repeat) * 2 ** math.ceil(math.log2(count))
    assert len(u) == signal.period == K * length
    assert np.array_equal(u.T @ u, len(u) * np.eye(count))  # sums of +1 and -1 are exact
    assert recipe["usable_response_chips"] == length
    worst = 0.0
    for a, b in combinations(range(count), 2):
        correlation = np.abs(circular_correlation(u[:, a], u[:, b])) / len(u)
        worst = max(worst, correlation[:length].max(), correlation[-length + 1 :].max())
    assert worst <= recipe["cross_correlation"] + 1e-12 <= 1 / length + 1e-11
    if not inverse_repeat and count <= 1 + math.log2(K):
        assert recipe["cross_correlation"] == 0


def test_three_hadamard_channels_never_correlate():
    u = prbs(order=6, dt=1.0, channels=3, decorrelate="hadamard").u
    for a, b in combinations(range(3), 2):
        np.testing.assert_allclose(circular_correlation(u[:, a], u[:, b]), 0, atol=1e-9)


@pytest.mark.parametrize(("order", "count"), [(5, 3), (7, 4), (10, 3), (13, 2)])
def test_different_sequences_state_their_correlation(order, count):
    signal = prbs(order=order, dt=1.0, channels=count, decorrelate="sequences", seed=2)
    length, recipe = 2**order - 1, signal.recipe
    assert len({tuple(t) for t in recipe["taps"]}) == count
    assert all(is_primitive(order, taps) for taps in recipe["taps"])
    worst = max(
        np.abs(circular_correlation(signal.u[:, a], signal.u[:, b])).max() for a, b in combinations(range(count), 2)
    )
    assert recipe["cross_correlation"] == pytest.approx(worst / length)
    assert worst <= 2 ** (order // 2 + 1) + 1 + 1e-9  # Gold's preferred pairs; more than two exist at these orders
    assert recipe["usable_response_chips"] == length == signal.period


@pytest.mark.parametrize(("highest_hz", "hold"), [(2.0, 10), (20.0, 1), (6.6, 3), (0.01, 2000)])
def test_the_clock_follows_the_highest_frequency(highest_hz, hold):
    signal = prbs(order=2, dt=0.02, highest_hz=highest_hz)
    assert signal.recipe["hold"] == hold
    assert signal.recipe["clock_hz"] >= 2.5 * highest_hz * (1 - 1e-12)
    assert signal.warnings == ()


def test_a_clock_that_is_too_slow_is_said():
    (warning,) = prbs(order=4, dt=0.02, highest_hz=23).warnings
    assert "50 Hz" in warning and "2.17 x highest_hz" in warning


def test_levels_of_each_channel():
    u = prbs(order=5, dt=0.1, channels=3, amplitude=[1, 2, 0.5], offset=[0, 10, -1]).u
    assert [sorted(set(c)) for c in u.T] == [[-1, 1], [8, 12], [-1.5, -0.5]]


@settings(max_examples=25, deadline=None)
@given(st.integers(5, 10), st.integers(1, 4), st.floats(0.1, 0.9), st.booleans())
def test_band_limited(order, hold, fraction, inverse_repeat):
    limit = fraction * 0.5
    parameters = {"order": order, "dt": 1.0, "hold": hold, "inverse_repeat": inverse_repeat, "amplitude": 2.0}
    signal, binary = prbs(**parameters, band_limit_hz=limit), prbs(**parameters)
    lines, before = np.fft.rfft(signal.u[:, 0]), np.fft.rfft(binary.u[:, 0])
    inside = np.fft.rfftfreq(len(signal.u)) <= limit * (1 + 1e-12)
    assert np.abs(lines[~inside]).max(initial=0) < 1e-10 * np.abs(lines).max()
    kept = inside & (np.abs(before) > 1e-9 * np.abs(before).max())
    gain = lines[kept] / before[kept]
    np.testing.assert_allclose(gain, gain.real.mean(), rtol=1e-8)
    assert np.abs(signal.u).max() == 2.0
    assert signal.recipe["rms"] == pytest.approx([np.sqrt((signal.u**2).mean())])


def test_a_recipe_from_before_the_newer_parameters_still_plays():
    signal = prbs(order=7, dt=0.02, hold=3, amplitude=[1, 2], channels=["a [V]", "b"], periods=2, seed=9)
    newer = ("highest_hz", "inverse_repeat", "decorrelate", "offset", "band_limit_hz")
    older = {key: value for key, value in signal.recipe.parameters.items() if key not in newer}
    assert regenerate(Recipe("prbs", older)).u.tobytes() == signal.u.tobytes()


@pytest.mark.parametrize("order", ORDERS)
def test_autocorrelation_is_M_then_minus_one(order):
    u = prbs(order, dt=1.0).u[:, 0]
    expected = np.full(2**order - 1, -1.0)
    expected[0] = 2**order - 1
    np.testing.assert_allclose(circular_correlation(u, u), expected, atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
def test_two_valued_balanced_and_with_equal_lines(order):
    signal = prbs(order, dt=1.0, amplitude=2.5)
    u, length = signal.u[:, 0], 2**order - 1
    assert set(u) == {2.5, -2.5}
    assert abs(u.sum()) == 2.5
    lines = np.abs(np.fft.fft(u)) / length / 2.5
    np.testing.assert_allclose(lines[1:], math.sqrt(length + 1) / length, rtol=1e-9)
    assert lines[0] == pytest.approx(1 / length)


@pytest.mark.parametrize("order", range(15, 21))
def test_long_sequences_visit_every_state_once(order):
    chips = (prbs(order, dt=1.0, seed=3).u[:, 0] > 0).astype(np.int64)
    padded = np.concatenate([chips, chips[: order - 1]])
    states = sum(padded[i : i + len(chips)] << i for i in range(order))
    assert np.array_equal(np.sort(states), np.arange(1, 2**order)) or np.array_equal(
        np.sort(states), np.arange(2**order - 1)
    )  # a negative sign maps the all-one state to the all-zero one


def test_hold_and_period():
    signal = prbs(order=7, dt=0.01, hold=5, periods=3)
    assert signal.period == 127 * 5 == signal.recipe["period_samples"]
    assert len(signal.u) == 3 * signal.period
    assert (signal.u[: signal.period] == signal.u[signal.period : 2 * signal.period]).all()
    chips = signal.u.reshape(-1, 5)
    assert (chips == chips[:, :1]).all()
    shorter = [k for k in range(1, 127) if (np.roll(chips[:127, 0], k) == chips[:127, 0]).all()]
    assert shorter == []


def test_hold_attenuates_as_the_zero_order_hold_does():
    u = prbs(order=10, dt=1.0, hold=4).u[:, 0]
    power = np.abs(np.fft.rfft(u)) ** 2
    at = round(0.4 * len(u) / 4)  # 0.4 f_clock; the published figure is -2.3 dB
    assert 10 * np.log10(power[at] / power[1]) == pytest.approx(-2.3, abs=0.05)
    f = np.arange(1, len(power)) / len(u)
    shape = np.abs(np.sin(np.pi * f * 4) / (4 * np.sin(np.pi * f)))
    gain = np.abs(np.fft.rfft(u))[1:] / (4 * math.sqrt(1024))
    np.testing.assert_allclose(gain, shape, atol=1e-9)


@pytest.mark.parametrize(("order", "count"), [(3, 2), (5, 3), (10, 3), (9, 7), (2, 3)])
def test_channels_are_decorrelated_within_the_usable_response(order, count):
    signal = prbs(order=order, dt=1.0, channels=count, seed=1)
    length, usable = 2**order - 1, signal.recipe["usable_response_chips"]
    assert length // (2 * count) <= usable <= length // count
    for a, b in combinations(range(count), 2):
        sign = signal.recipe["signs"][a] * signal.recipe["signs"][b]
        for first, second in ((a, b), (b, a)):
            correlation = circular_correlation(signal.u[:, first], signal.u[:, second])
            np.testing.assert_allclose(correlation[:usable], -sign, atol=1e-6)


def test_channels_are_shifts_of_one_sequence():
    signal = prbs(order=8, dt=1.0, channels=4, seed=5)
    recipe = signal.recipe
    base = signal.u[:, 0] * recipe["signs"][0]
    for c in range(4):
        rolled = np.roll(base, recipe["shifts"][0] - recipe["shifts"][c])
        assert (signal.u[:, c] == recipe["signs"][c] * rolled).all()
    assert sorted(recipe["shifts"]) == [0, 63, 126, 189]  # 63: no smaller spacing puts products farther behind


@pytest.mark.parametrize(("order", "channels"), [(7, 3), (8, 2), (8, 3), (9, 4), (10, 3)])
def test_products_of_channels_stay_far_behind_every_channel(order, channels):
    signal = prbs(order=order, dt=1.0, channels=channels, seed=3)
    claimed, length = signal.recipe["product_lag_chips"], len(signal.u)
    assert claimed >= length // (2 * channels)
    found = []
    for a in range(channels):
        for b in range(a + 1, channels):
            product = signal.u[:, a] * signal.u[:, b]
            for c in range(channels):
                response = circular_correlation(signal.u[:, c], product)  # product(k) against channel(k - lag)
                found.append(int(np.argmax(np.abs(response))))
    assert min(found) == claimed


def test_the_documented_call():
    signal = prbs(order=10, dt=0.02, hold=4, amplitude=10.0, channels=3)
    assert signal.u.shape == (4092, 3)
    assert signal.recipe["usable_response_s"] == pytest.approx(315 * 0.08)
    assert [c.name for c in signal.channels] == ["u1", "u2", "u3"]


def test_names_units_and_amplitudes():
    signal = prbs(order=5, dt=0.1, channels=["roll_ref [deg]", Channel("thrust", "N")], amplitude=[10, 0.5])
    assert signal.channels == (Channel("roll_ref", "deg"), Channel("thrust", "N"))
    assert np.abs(signal.u).max(axis=0).tolist() == [10.0, 0.5]
    assert prbs(order=5, dt=0.1, channels="flap [deg]").channels == (Channel("flap", "deg"),)


def test_seeds_are_fresh_and_reproducible():
    realisations = [prbs(order=10, dt=1.0, channels=3, seed=seed) for seed in range(20)]
    assert len({signal.u.tobytes() for signal in realisations}) == 20
    assert len({(tuple(s.recipe["shifts"]), tuple(s.recipe["signs"])) for s in realisations}) > 10
    assert (realisations[7].u == prbs(order=10, dt=1.0, channels=3, seed=7).u).all()


def test_the_draw_of_a_seed_never_changes():
    recipe = prbs(order=10, dt=1.0, channels=3, seed=0).recipe
    words = np.random.SeedSequence(0).generate_state(7, np.uint64)
    assert recipe["state"] == 1 + int(words[0]) % 1023
    assert recipe["shifts"] == [315 * int(k) for k in np.argsort(words[1:4])]


@pytest.mark.parametrize(
    "parameters",
    [
        {"order": 7, "dt": 0.02, "hold": 3, "amplitude": [1, 2], "channels": ["a [V]", "b"], "periods": 2, "seed": 9},
        {"dt": 0.05, "duration_s": 12.3, "channels": 2},
        {"order": 32, "dt": 1e-3, "duration_s": 1.0, "channels": 5},
        {"order": 6, "dt": 0.02, "highest_hz": 2.0, "inverse_repeat": True, "channels": 2, "offset": [1, -0.3]},
        {"order": 4, "dt": 0.02, "channels": 3, "decorrelate": "hadamard", "amplitude": 0.1},
        {"order": 6, "dt": 0.02, "channels": 3, "decorrelate": "sequences", "duration_s": 2.0},
        {"order": 5, "dt": 0.02, "taps": [4, 3, 2], "band_limit_hz": 7, "hold": 2, "amplitude": 0.3},
    ],
)
def test_the_recipe_is_json_and_regenerates_bit_for_bit(parameters):
    signal = prbs(**parameters)
    again = regenerate(json.loads(json.dumps(signal.recipe.to_dict(), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes()
    assert (again.dt, again.channels, again.period, again.recipe) == (
        signal.dt,
        signal.channels,
        signal.period,
        signal.recipe,
    )


def test_regenerate_refuses_what_it_cannot_play():
    with pytest.raises(ExciteError, match="did you mean 'prbs'"):
        regenerate({"kind": "prsb", "parameters": {}})
    with pytest.raises(ExciteError, match="dt missing"):
        regenerate({"kind": "prbs", "parameters": {}})


def test_duration_of_whole_periods_gives_no_warning():
    signal = prbs(order=4, dt=0.1, hold=2, duration_s=6.0)
    assert len(signal.u) == 60 and signal.warnings == () and signal.period == 30


@pytest.mark.parametrize(("duration_s", "whole", "period"), [(7.0, "1 whole", 62), (2.0, "not one is complete", None)])
def test_a_cut_signal_says_what_is_lost(duration_s, whole, period):
    signal = prbs(order=5, dt=0.1, hold=2, duration_s=duration_s)
    assert len(signal.u) == round(duration_s / 0.1)
    assert signal.period == period
    (warning,) = signal.warnings
    assert whole in warning and f"{len(signal.u)} samples" in warning


def test_a_cut_signal_is_the_head_of_the_whole_one():
    whole, cut = prbs(order=9, dt=1.0, channels=3, hold=2), prbs(order=9, dt=1.0, channels=3, hold=2, duration_s=701)
    assert (cut.u == whole.u[:701]).all()


@pytest.mark.parametrize(("duration_s", "order"), [(3.0, 2), (6.99, 3), (62.0, 5), (63.0, 6), (1000.0, 9)])
def test_order_chosen_from_the_duration(duration_s, order):
    signal = prbs(dt=1.0, duration_s=duration_s)
    assert signal.recipe["order"] == order
    assert signal.period == 2**order - 1 <= len(signal.u)


def test_a_cut_of_a_huge_order_is_instant():
    signal = prbs(order=32, dt=1e-3, channels=4, duration_s=5.0)
    assert signal.u.shape == (5000, 4)
    assert signal.period is None


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"order": 1}, "prbs: order: 1; give a whole number of at least 2"),
        ({"order": 33}, "prbs: order: 33; orders from 2 to 32 are known"),
        ({"order": 7.0}, "prbs: order: 7.0; give a whole number"),
        ({"order": True}, "prbs: order: True; give a whole number"),
        ({"order": None}, "prbs: order: None; give a whole number from 2 to 32, or duration_s"),
        (
            {"order": 4, "taps": [2]},
            "taps: [2]; x^4 + x^2 + 1 is not primitive: the sequence repeats after at most 6 chips",
        ),
        ({"order": 4, "taps": [3, 2, 1]}, "is not primitive: the sequence repeats after at most 5 chips instead of 15"),
        ({"taps": []}, "prbs: taps: []; give a list of whole numbers from 1 to 4"),
        ({"taps": [5]}, "prbs: taps: [5]; give different whole numbers from 1 to 4"),
        ({"taps": [2, 2]}, "prbs: taps: [2, 2];"),
        ({"taps": [2.0]}, "prbs: taps: [2.0];"),
        ({"taps": "2"}, "prbs: taps: '2';"),
        ({"taps": [[3], [2]]}, "give one list"),
        ({"taps": [[3], [3]], "channels": 2, "decorrelate": "sequences"}, "give 2 different lists"),
        ({"order": None, "taps": [3], "duration_s": 9.0}, "prbs: order: None; taps belong to one order"),
        ({"highest_hz": 60}, "prbs: highest_hz: 60; it exceeds the Nyquist frequency 50 Hz"),
        ({"highest_hz": 1, "hold": 3}, "prbs: hold: 3; highest_hz = 1 asks for 40"),
        ({"highest_hz": 0}, "prbs: highest_hz: 0; give a positive number of Hz"),
        ({"inverse_repeat": 1}, "prbs: inverse_repeat: 1; give true or false"),
        ({"decorrelate": "shifts"}, "prbs: decorrelate: 'shifts'; did you mean 'shift'?"),
        ({"decorrelate": "sequences", "channels": 7}, "prbs: channels: 7; order 5 has only 6 primitive polynomials"),
        ({"decorrelate": "sequences", "channels": 2, "order": 21}, "prbs: order: 21; different sequences are chosen"),
        ({"offset": math.inf}, "prbs: offset: inf; every offset must be finite"),
        ({"band_limit_hz": 60}, "prbs: band_limit_hz: 60; it exceeds the Nyquist frequency 50 Hz"),
        ({"band_limit_hz": 1}, "prbs: band_limit_hz: 1.0; the lowest line is at 3.22581 Hz"),
        ({"band_limit_hz": 9, "order": 32, "duration_s": 1.0}, "band_limit_hz filters whole periods"),
        ({"hold": 0}, "prbs: hold: 0; give a whole number of at least 1"),
        ({"hold": 2.5}, "prbs: hold: 2.5; give a whole number"),
        ({"dt": 0}, "prbs: dt: 0; give a positive number of seconds"),
        ({"dt": -0.1}, "prbs: dt: -0.1;"),
        ({"dt": math.nan}, "prbs: dt: nan;"),
        ({"dt": "fast"}, "prbs: dt: 'fast';"),
        ({"amplitude": 0}, "prbs: amplitude: 0; every amplitude must be positive and finite"),
        ({"amplitude": -1.0}, "prbs: amplitude: -1.0;"),
        ({"amplitude": math.nan}, "prbs: amplitude: nan;"),
        ({"amplitude": math.inf}, "prbs: amplitude: inf;"),
        ({"amplitude": "large"}, "prbs: amplitude: 'large';"),
        ({"amplitude": [1, 2]}, "prbs: amplitude: [1, 2]; give one number, or one for each of the 1 channels"),
        ({"channels": 0}, "prbs: channels: 0;"),
        ({"channels": []}, "prbs: channels: []; name at least one"),
        ({"channels": 32}, "prbs: channels: 32; order 5 has only 31 distinct shifts; raise the order"),
        ({"channels": 10**12}, "prbs: channels: 1000000000000;"),
        ({"channels": ["a", "a"]}, "duplicate names"),
        ({"periods": 0}, "prbs: periods: 0;"),
        ({"periods": 1.5}, "prbs: periods: 1.5;"),
        ({"periods": 2, "duration_s": 3.0}, "prbs: periods: 2; duration_s = 3.0 is given too"),
        ({"duration_s": 0}, "prbs: duration_s: 0;"),
        ({"duration_s": 1e-9}, "prbs: duration_s: 1e-09; it must span at least one sample"),
        ({"order": None, "duration_s": 0.02}, "prbs: duration_s: 0.02; the shortest period takes 0.03 s; play longer"),
        ({"seed": -1}, "prbs: seed: -1;"),
        ({"seed": 0.5}, "prbs: seed: 0.5;"),
        (
            {"order": 32},
            "prbs: order: 32; 4294967295 samples x 1 channels exceed 200000000 values (1.6 GB); lower order",
        ),
        ({"periods": 10**12}, "exceed 200000000 values"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        prbs(**{"order": 5, "dt": 0.01} | parameters)
    assert message in str(caught.value)


def test_the_table_lists_the_generator():
    assert GENERATORS["prbs"] is prbs
