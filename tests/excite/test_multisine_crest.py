"""Crest factors of multisines: known ones, bounds, and what the search reaches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from multisines import FLAT, N, two_modes

from excite.generators import crest
from excite.generators.multisine import multisine

# Crest factors


def test_schroeder_crest_factors_are_the_known_ones():
    for count, known in ((31, 1.781), (100, 1.676), (330, 1.661), (3300, 1.684)):
        lines, flat = np.arange(1, count + 1), np.ones(count)
        assert crest.crest_factor(lines, flat, crest.schroeder(lines, flat))[0] == pytest.approx(known, abs=0.01)


@pytest.mark.parametrize(
    ("lines", "starts", "most"),
    [
        (np.arange(1, 32), 48, 1.40),
        (np.arange(1, 101), 8, 1.41),
        (np.arange(1, 331), 4, 1.39),
        (np.arange(1, 3301), 1, 1.44),
        (np.arange(1, 62, 2), 48, 1.38),
    ],
)
def test_flat_crest_factors(lines, starts, most):
    found = crest.optimise(lines, np.ones(len(lines)), starts=starts, seed=0)
    assert found.crest[0] <= most


def test_odd_random_and_log_crest_factors():
    odd = multisine(dt=0.01, period_s=10.24, band_hz=(0, 28.6), spacing="odd-random", starts=4)
    assert len(odd.recipe["decided"]["lines"][0]) == 110 and odd.recipe["crest_factor"][0] <= 1.50
    lines = np.unique(np.geomspace(1, 400, 30).round().astype(int))
    assert len(lines) == 26 and crest.optimise(lines, np.ones(26), starts=16).crest[0] <= 2.1


@settings(max_examples=25, deadline=None)
@given(data=st.data(), count=st.integers(1, 20), seed=st.integers(0, 2**32))
def test_bound_is_above_the_continuous_peak(data, count, seed):
    lines = np.array(sorted(data.draw(st.sets(st.integers(1, 60), min_size=count, max_size=count))))
    rng = np.random.default_rng(seed)
    amplitudes, phases = rng.uniform(0.1, 1, count), rng.uniform(0, 7, count)
    t = rng.uniform(0, 1, 20000)
    dense = np.abs((amplitudes * np.cos(2 * np.pi * np.outer(t, lines) + phases)).sum(1)).max()
    rms = np.sqrt((amplitudes**2).sum() / 2)
    fine = crest.crest_factor(lines, amplitudes, phases, 4096)[0]
    for grid in (8, 16, 128):
        bound = crest.crest_bound(lines, amplitudes, phases, grid)[0]
        assert bound >= max(dense / rms, fine) * (1 - 1e-12)
        assert bound <= fine / np.cos(np.pi / grid) * (1 + 1e-12)


def test_recipe_bound_covers_the_played_samples_and_the_waveform_between():
    s = multisine(**FLAT, amplitude=2.0, starts=16)
    padded = np.zeros(64 * N // 2 + 1, complex)
    padded[: N // 2 + 1] = np.fft.rfft(s.u[:, 0]) * 64
    between = np.abs(np.fft.irfft(padded)).max()
    assert 2.0 <= between <= s.recipe["peak_bound"][0] <= 1.001 * between


def test_clipping_lies_between_schroeder_and_the_optimum():
    lines, flat = np.arange(1, 101), np.ones(100)
    start = crest.schroeder(lines, flat)
    clipped = crest.clipping(lines, flat, start)
    values = [crest.crest_factor(lines, flat, p)[0] for p in (crest.l2p(lines, flat, start)[0], clipped, start)]
    assert values == sorted(values) and values[1] < 1.5


def test_norm_and_polish_never_make_it_worse():
    lines, flat = np.arange(1, 21), np.ones(20)
    phases = crest.l2p(lines, flat, np.random.default_rng(0).uniform(0, 7, (4, 20)))
    before = crest.crest_factor(lines, flat, phases, 64)[:, 0]
    after = [crest.crest_factor(lines, flat, crest.minimax(lines, flat, p), 64)[0] for p in phases]
    assert (np.array(after) <= before + 1e-12).all() and min(after) < before.min() - 1e-3


def test_no_better_phases_for_two_lines():
    t = np.linspace(0, 2 * np.pi, 20001)
    least = min(np.abs(np.cos(t) + np.cos(2 * t + p)).max() for p in np.linspace(0, np.pi, 181))
    lines, flat = np.array([1, 2]), np.ones(2)
    found = crest.optimise(lines, flat, starts=4)
    assert crest.crest_factor(lines, flat, found.phases, 4096)[0] == pytest.approx(least, abs=2e-3)


def test_search_is_deterministic_for_a_seed():
    one, same, other = (multisine(**FLAT, starts=20, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(one.u, same.u) and not np.array_equal(one.u, other.u)


def test_chirp_likeness_tells_a_sweep_from_noise():
    for lines in (np.arange(5, 200), np.arange(1, 400, 2), np.array([1, 2, 4, 5, 7, 8, 9, 13, 14, 16, 17, 19])):
        flat = np.ones(len(lines))
        assert crest.chirp_likeness(lines, flat, crest.schroeder(lines, flat)) > 0.99
    assert crest.chirp_likeness(np.arange(1, 201), np.ones(200), np.random.default_rng(0).uniform(0, 7, 200)) < 0.25


def test_joint_input_and_output_crest_factor():
    band = {"dt": 0.01, "period_s": 10.24, "band_hz": (0.05, 9.8), "model": two_modes()}
    anchor = multisine(**band, phases="schroeder")
    assert len(anchor.recipe["decided"]["lines"][0]) == 100 and anchor.recipe["output_crest_factor"][0] > 2.5
    s = multisine(**band, starts=6, periods=4)
    assert max(s.recipe["crest_factor"] + s.recipe["output_crest_factor"]) <= 1.54
    y = two_modes().simulate(s.u)[-1024:, 0]  # the steady state of a plant whose transient has decayed
    assert np.abs(y).max() / y.std() == pytest.approx(s.recipe["output_crest_factor"][0], rel=0.01)
