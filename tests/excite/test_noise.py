"""Random signals: their distribution, spectrum and switching, reproducibility, and their errors."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from excite.errors import ExciteError
from excite.generators import GENERATORS, noise, regenerate

FORMS = {
    "white": {"rms": [1.0, 0.2]},
    "band-limited": {"band_hz": [1, 5], "rms": 2.0},
    "binary": {"hold": 3},
    "gbn": {"mean_hold_s": 0.2, "amplitude": [1, 4]},
    "multilevel": {"levels": 5},
}
seeds = st.integers(0, 10**6)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("periods", [None, 2])
def test_recipes_are_json_and_regenerate_bit_for_bit(form, periods):
    signal = noise(
        form=form,
        dt=0.02,
        duration_s=4.0,
        channels=["a [N]", "b"],
        offset=[0, -3.5],
        seed=5,
        periods=periods,
        **FORMS[form],
    )
    again = regenerate(json.loads(json.dumps(signal.recipe.to_dict(), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes()
    assert (again.recipe, again.period, again.channels) == (signal.recipe, signal.period, signal.channels)
    deviation = signal.u - signal.recipe["offset"]
    np.testing.assert_allclose(np.sqrt((deviation**2).mean(0)), signal.recipe["realised_rms"])
    np.testing.assert_allclose(np.abs(deviation).max(0), signal.recipe["realised_peak"])


@pytest.mark.parametrize("form", FORMS)
def test_a_further_channel_leaves_the_others_and_differs_from_them(form):
    parameters = {"form": form, "dt": 0.02, "duration_s": 8.0, "seed": 1} | FORMS[form]
    parameters = {k: v[0] if isinstance(v, list) and k != "band_hz" else v for k, v in parameters.items()}
    two, three = noise(**parameters, channels=2).u, noise(**parameters, channels=3).u
    assert np.array_equal(two, three[:, :2])
    assert np.abs(np.corrcoef(three.T) - np.eye(3)).max() < 0.7
    assert not np.array_equal(two, noise(**parameters | {"seed": 2}, channels=2).u)


def test_white_is_gaussian_and_white():
    u = noise(dt=1.0, duration_s=20000, rms=3.0).u[:, 0]
    assert stats.kstest(u / 3, "norm").pvalue > 0.01
    lags = [np.mean(u[:-k] * u[k:]) / 9 for k in range(1, 20)]
    assert np.abs(lags).max() < 4 / math.sqrt(20000)


def test_the_first_draws_of_a_seed_never_change():
    raw = np.random.PCG64(np.random.SeedSequence(0).spawn(1)[0]).random_raw(3)
    expected = stats.norm.ppf([(int(word) // 2**12 + 0.5) / 2**52 for word in raw])
    np.testing.assert_allclose(noise(dt=1.0, duration_s=3).u[:, 0], expected, rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(40, 700), st.floats(0, 0.4), st.floats(0.05, 0.5), st.integers(1, 3), seeds)
def test_band_limited_noise_is_zero_outside_the_band(length, low, width, periods, seed):
    high = min(low + width, 0.5)
    signal = noise(
        form="band-limited",
        dt=1.0,
        duration_s=length * periods,
        band_hz=[low, high],
        seed=seed,
        periods=periods,
        channels=2,
    )
    assert signal.period == length
    assert np.array_equal(signal.u[:length], signal.u[-length:])
    lines = np.abs(np.fft.rfft(signal.u[:length], axis=0))
    f = np.fft.rfftfreq(length)
    inside = (f >= low * (1 - 1e-12)) & (f <= high * (1 + 1e-12)) & (f > 0)
    assert lines[~inside].max() < 1e-12 * lines.max() * length
    assert (lines[inside].min(0) > 0).all()
    assert signal.recipe["lines_hz"] == pytest.approx([f[inside][0], f[inside][-1]])


def test_band_limited_noise_has_its_rms():
    power = [
        noise(form="band-limited", dt=1.0, duration_s=400, band_hz=[0.1, 0.2], rms=2.0, seed=s).u.var()
        for s in range(50)
    ]
    assert np.mean(power) == pytest.approx(4.0, rel=0.07)  # 82 degrees of freedom in each of 50


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 1.0), st.integers(1, 5), seeds)
def test_gbn_switches_at_the_given_probability(p, hold, seed):
    signal = noise(form="gbn", dt=0.1, duration_s=0.1 * hold * 4000, hold=hold, switch_probability=p, seed=seed)
    chips = signal.u.reshape(-1, hold)
    assert (chips == chips[:, :1]).all() and set(np.abs(signal.u).ravel()) == {1.0}
    switches = np.count_nonzero(np.diff(chips[:, 0]))
    assert abs(switches - 3999 * p) <= 5.5 * math.sqrt(3999 * p * (1 - p)) + 1e-9  # 5.5 standard deviations
    assert signal.recipe["expected_hold_s"] == pytest.approx(0.1 * hold / p)


def test_gbn_by_its_mean_hold():
    by_time = noise(form="gbn", dt=0.1, duration_s=50, hold=2, mean_hold_s=1.0)
    assert by_time.recipe["probability"] == pytest.approx(0.2)
    assert np.array_equal(by_time.u, noise(form="gbn", dt=0.1, duration_s=50, hold=2, switch_probability=0.2).u)
    fastest = noise(form="gbn", dt=0.1, duration_s=5, mean_hold_s=0.1).u[:, 0]
    assert (np.diff(fastest) != 0).all()


def test_gbn_autocorrelation():
    u = noise(form="gbn", dt=1.0, duration_s=200000, switch_probability=0.1).u[:, 0]
    found = [np.mean(u[: len(u) - lag] * u[lag:]) for lag in range(8)]
    np.testing.assert_allclose(found, 0.8 ** np.arange(8), atol=0.03)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 9), st.integers(1, 4), seeds)
def test_multilevel_visits_equal_levels_equally(levels, hold, seed):
    u = noise(
        form="multilevel", dt=1.0, duration_s=1000 * hold * levels, levels=levels, hold=hold, amplitude=2, seed=seed
    ).u
    found, counts = np.unique(u, return_counts=True)
    np.testing.assert_allclose(found, np.linspace(-2, 2, levels), atol=1e-12)
    assert np.abs(counts / hold - 1000).max() < 5.5 * math.sqrt(1000)


def test_binary_is_balanced_and_held():
    u = noise(form="binary", dt=1.0, duration_s=30000, hold=3, amplitude=[2, 3], offset=[1, 0], channels=2).u
    assert [sorted(set(c)) for c in u.T] == [[-1, 3], [-3, 3]]
    assert np.abs((u - [1, 0]).mean(0) / [2, 3]).max() < 5 / math.sqrt(10000)
    assert (u.reshape(-1, 3, 2) == u.reshape(-1, 3, 2)[:, :1]).all()


def test_a_signal_that_never_changes_is_said():
    (warning,) = noise(form="gbn", dt=1.0, duration_s=5, switch_probability=1e-9).warnings
    assert "u1 never changes in 5 s" in warning


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"form": "pink"}, "noise: form: 'pink'; known: band-limited, binary"),
        ({"form": "whit"}, "did you mean 'white'?"),
        ({"dt": 0}, "noise: dt: 0;"),
        ({"duration_s": -1}, "noise: duration_s: -1; give a positive number of seconds"),
        (
            {"duration_s": 1e9},
            "noise: duration_s: 1000000000.0; 100000000000 samples x 1 channels exceed 200000000 values",
        ),
        ({"rms": 0}, "noise: rms: 0; every rms must be positive and finite"),
        ({"rms": math.nan}, "noise: rms: nan;"),
        ({"rms": [1, 2]}, "noise: rms: [1, 2]; give one number, or one for each of the 1 channels"),
        ({"amplitude": 2}, "noise: amplitude: 2; the form 'white' does not use it; leave it out"),
        ({"offset": math.inf}, "noise: offset: inf; every offset must be finite"),
        ({"periods": 3}, "noise: periods: 3; 100 samples are not 3 equal periods; play 0.99 s"),
        ({"periods": 0}, "noise: periods: 0;"),
        ({"periods": 200}, "noise: periods: 200; 100 samples are not 200 equal periods; play 2 s"),
        ({"seed": -1}, "noise: seed: -1;"),
        ({"channels": 0}, "noise: channels: 0;"),
        ({"channels": 3.5}, "noise: channels: 3.5; give their count, or their names"),
        ({"channels": [1, 2]}, "noise: channels: [1, 2]; give every channel a name"),
        ({"channels": 257}, "noise: channels: 257; at most 256 are played together"),
        ({"form": "band-limited"}, "noise: band_hz: None; the form 'band-limited' needs it"),
        ({"form": "band-limited", "band_hz": [1, 60]}, "noise: band_hz[1]: 60; it exceeds the Nyquist frequency 50 Hz"),
        ({"form": "band-limited", "band_hz": [5, 1]}, "noise: band_hz: [5, 1]; the band is empty"),
        (
            {"form": "band-limited", "band_hz": [5.1, 5.9]},
            "the lines of 100 samples are 1 Hz apart and none lies inside",
        ),
        ({"form": "band-limited", "band_hz": 5}, "noise: band_hz: 5; give [low, high] in Hz"),
        ({"form": "band-limited", "band_hz": [-1, 5]}, "noise: band_hz[0]: -1;"),
        ({"form": "binary", "hold": 0}, "noise: hold: 0;"),
        ({"form": "binary", "hold": 101}, "noise: hold: 101; a period has 100 samples"),
        ({"form": "binary", "rms": 1}, "noise: rms: 1; the form 'binary' does not use it"),
        ({"form": "gbn"}, "noise: switch_probability: None; mean_hold_s is None; give one of the two"),
        ({"form": "gbn", "switch_probability": 0.1, "mean_hold_s": 1}, "give one of the two"),
        (
            {"form": "gbn", "switch_probability": 0},
            "noise: switch_probability: 0; give a probability above 0, at most 1",
        ),
        ({"form": "gbn", "switch_probability": 1.1}, "noise: switch_probability: 1.1;"),
        ({"form": "gbn", "mean_hold_s": 0.005}, "noise: mean_hold_s: 0.005; give at least the 0.01 s of one hold"),
        ({"form": "multilevel", "levels": 1}, "noise: levels: 1; give a whole number of at least 2"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        noise(**{"dt": 0.01, "duration_s": 1.0} | parameters)
    assert message in str(caught.value)


def test_the_table_lists_the_generator():
    assert GENERATORS["noise"] is noise
