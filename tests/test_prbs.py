"""PRBS: the properties that define a maximum-length sequence, then the parameters and their errors."""

import json
import math
from itertools import combinations

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.generators import GENERATORS, prbs, regenerate
from excite.generators.prbs import TAPS
from excite.types.channel import Channel

ORDERS = range(2, 15)


def circular_correlation(a, b):
    """sum_k a(k) b(k + l) for all l."""
    return np.fft.ifft(np.conj(np.fft.fft(a)) * np.fft.fft(b)).real


def prime_factors(number):
    factors, divisor = set(), 2
    while divisor * divisor <= number:
        while number % divisor == 0:
            factors.add(divisor)
            number //= divisor
        divisor += 1
    return factors | ({number} if number > 1 else set())


def power_of_x(exponent, polynomial, degree):
    """x^exponent modulo a polynomial over GF(2), both as bit masks."""

    def product(a, b):
        result = 0
        while b:
            if b & 1:
                result ^= a
            a, b = a << 1, b >> 1
            if a >> degree & 1:
                a ^= polynomial
        return result

    result, base = 1, 2
    while exponent:
        if exponent & 1:
            result = product(result, base)
        base, exponent = product(base, base), exponent >> 1
    return result


def is_primitive(order, taps):
    """Whether x has the order 2^n - 1 modulo the feedback polynomial over GF(2): the definition."""
    polynomial = 1 << order | 1 | sum(1 << tap for tap in taps)
    length = 2**order - 1
    return power_of_x(length, polynomial, order) == 1 and all(
        power_of_x(length // q, polynomial, order) != 1 for q in prime_factors(length)
    )


def test_every_polynomial_is_primitive():
    assert sorted(TAPS) == list(range(2, 33))
    assert all(is_primitive(order, taps) for order, taps in TAPS.items())


def test_the_primitivity_test_rejects_a_short_cycle():
    assert not is_primitive(4, (2,))  # x^4 + x^2 + 1 = (x^2 + x + 1)^2, period 6
    assert not is_primitive(4, (3, 2, 1))  # irreducible, period 5


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
    ],
)
def test_the_recipe_is_json_and_regenerates_bit_for_bit(parameters):
    signal = prbs(**parameters)
    again = regenerate(json.loads(json.dumps(dict(signal.recipe), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes()
    assert (again.dt, again.channels, again.period, again.recipe) == (
        signal.dt, signal.channels, signal.period, signal.recipe,
    )  # fmt: skip


def test_regenerate_refuses_what_it_cannot_play():
    with pytest.raises(ExciteError, match="did you mean 'prbs'"):
        regenerate({"kind": "prsb"})
    with pytest.raises(ExciteError, match="order, dt"):
        regenerate({"kind": "prbs"})


def test_duration_of_whole_periods_gives_no_warning():
    signal = prbs(order=4, dt=0.1, hold=2, duration_s=6.0)
    assert len(signal.u) == 60 and signal.recipe["warnings"] == [] and signal.period == 30


@pytest.mark.parametrize(("duration_s", "whole", "period"), [(7.0, "1 whole", 62), (2.0, "not one is complete", None)])
def test_a_cut_signal_says_what_is_lost(duration_s, whole, period):
    signal = prbs(order=5, dt=0.1, hold=2, duration_s=duration_s)
    assert len(signal.u) == round(duration_s / 0.1)
    assert signal.period == period
    (warning,) = signal.recipe["warnings"]
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
        ({"order": 32}, "prbs: order: 32; 4294967295 samples x 1 channels exceed 200000000 values; lower order"),
        ({"periods": 10**12}, "exceed 200000000 values"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        prbs(**{"order": 5, "dt": 0.01} | parameters)
    assert message in str(caught.value)


def test_the_table_lists_the_generator():
    assert GENERATORS["prbs"] is prbs
