"""Multisine: exact lines, small crest factors with a bound that holds, orthogonal inputs, recipes, refusals."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from multisines import BASE, FLAT, N, two_modes

from excite.errors import ExciteError
from excite.generators import allocation, regenerate
from excite.generators.multisine import multisine
from excite.models.state_space import StateSpaceModel


def spectrum(u):
    """Complex amplitude of every line, (N // 2 + 1, channels)."""
    return 2 * np.fft.rfft(u, axis=0) / len(u)


# Lines


@settings(max_examples=25, deadline=None)
@given(
    size=st.integers(8, 300),
    spacing=st.sampled_from(["full", "odd", "odd-odd", "odd-random"]),
    phases=st.sampled_from(["schroeder", "newman", "random"]),
    peak=st.floats(1e-3, 1e3),
    seed=st.integers(0, 99),
    tilt=st.floats(-2, 2),
)
def test_lines_are_exact_and_alone(size, spacing, phases, peak, seed, tilt):
    s = multisine(
        dt=0.01,
        period_s=size * 0.01,
        band_hz=(0, 49),
        spacing=spacing,
        phases=phases,
        amplitude=peak,
        seed=seed,
        spectrum=lambda f: f**tilt,
    )
    lines, amplitudes = (np.array(s.recipe["decided"][key][0]) for key in ("lines", "line_amplitudes"))
    found = spectrum(s.u)[:, 0]
    expected = np.zeros(len(found))
    expected[lines] = amplitudes
    assert np.abs(np.abs(found) - expected).max() <= 1e-12 * peak
    assert np.allclose(amplitudes / amplitudes[0], (lines / lines[0]) ** tilt, rtol=1e-12)
    assert np.abs(s.u).max() == pytest.approx(peak, rel=1e-15) and np.abs(s.u).max() <= peak
    if spacing != "full":
        assert np.abs(found[::2]).max() <= 1e-12 * peak
        assert (lines % (4 if spacing == "odd-odd" else 2) == 1).all()


def test_optimised_lines_are_exact():
    s = multisine(**FLAT, amplitude=3.0, starts=4, seed=1)
    expected = np.zeros(N // 2 + 1)
    expected[1:32] = s.recipe["decided"]["line_amplitudes"][0][0]
    assert np.abs(np.abs(spectrum(s.u)[:, 0]) - expected).max() <= 1e-12 * expected[1]


def test_detection_lines_are_one_odd_line_of_every_four():
    s = multisine(**BASE, band_hz=(0, 49), spacing="odd-random", phases="random", seed=5)
    played, detection = s.recipe["decided"]["lines"][0], s.recipe["decided"]["detection_lines"]
    every = sorted(played + detection)
    assert every == list(range(1, 2 * len(every), 2))
    assert [l // 8 for l in detection] == list(range(len(every) // 4))
    assert (
        detection
        != multisine(**BASE, band_hz=(0, 49), spacing="odd-random", phases="random", seed=6).recipe["decided"][
            "detection_lines"
        ]
    )


def test_log_spacing_is_even_on_a_log_axis():
    s = multisine(dt=0.01, period_s=100.0, band_hz=(0.1, 40), spacing="log", count=20, phases="random")
    assert np.diff(np.log(s.recipe["decided"]["lines"][0])) == pytest.approx(np.log(400) / 19, rel=0.07)
    assert not s.warnings
    few = multisine(**BASE, band_hz=(0.3, 4), spacing="log", count=20, phases="random")
    assert "remain after rounding" in few.warnings[0]


def test_spectrum_forms_agree():
    forms = [lambda f: 1 + f, (1 + np.arange(1, 32) / 2.56).tolist(), [(0, 1), (50, 51)]]
    signals = [multisine(**FLAT, phases="schroeder", spectrum=form) for form in forms]
    assert all(np.allclose(s.u, signals[0].u, rtol=0, atol=1e-12) for s in signals)


def test_periods_repeat():
    s = multisine(**FLAT, phases="newman", periods=3)
    assert s.period == N and np.array_equal(s.u[:N], s.u[N : 2 * N]) and len(s.u) == 3 * N


# Several inputs


def test_interleaved_inputs_share_no_line_and_reach_the_peak_factor():
    s = multisine(
        **BASE, lines=list(range(1, 37)), channels=["a [deg]", "b [deg]", "c [deg]"], starts=32, amplitude=[1, 2, 3]
    )
    active = np.abs(spectrum(s.u)) > 1e-9
    assert active.sum(0).tolist() == [12, 12, 12] and active.sum(1).max() == 1
    gram = s.u.T @ s.u / N
    assert np.abs(gram - np.diag(np.diag(gram))).max() < 1e-13
    assert max(s.recipe["relative_peak_factor"]) < 1.12
    assert np.abs(s.u).max(0) == pytest.approx([1, 2, 3], rel=1e-15)
    for lines in s.recipe["decided"]["lines"]:  # every channel covers the band
        assert lines[0] <= 9 and lines[-1] >= 28 and np.diff(lines).max() <= 9


def test_single_axis_peak_factor():
    assert multisine(**FLAT, starts=32).recipe["relative_peak_factor"][0] <= 1.0


def test_given_allocation_is_played():
    lines = [[1, 4, 9], [2, 3]]
    s = multisine(**BASE, lines=lines, channels=2, phases=[[0, 1, 2], [3, 4]], spectrum=[1, 2, 3, 4, 5])
    found = spectrum(s.u)
    assert [np.flatnonzero(np.abs(found[:, c]) > 1e-9).tolist() for c in (0, 1)] == lines
    assert np.angle(found[[1, 4, 9], 0]) == pytest.approx([0, 1, 2])
    assert np.abs(found[[1, 4, 9], 0]) / np.abs(found[1, 0]) == pytest.approx([1, 4, 5])


@pytest.mark.parametrize(("orthogonal", "channels", "experiments"), [("dft", 3, 3), ("dft", 2, 2), ("hadamard", 3, 4)])
@pytest.mark.parametrize("phases", ["optimal", "random", "schroeder"])
def test_condition_of_every_line_is_one(orthogonal, channels, experiments, phases):
    s = multisine(
        **BASE,
        lines=[2, 3, 5, 8, 13, 21],
        channels=channels,
        orthogonal=orthogonal,
        phases=phases,
        periods=2,
        starts=8,
        amplitude=np.arange(1.0, channels + 1),
    )
    assert s.period == len(s.u) == experiments * 2 * N and s.recipe["experiments"] == experiments
    runs = s.u.reshape(experiments, 2, N, channels) / np.arange(1.0, channels + 1)
    assert np.array_equal(runs[:, 0], runs[:, 1])
    matrices = np.stack([spectrum(run) for run in runs[:, 1]], axis=-1)[[2, 3, 5, 8, 13, 21]]
    values = np.linalg.svd(matrices, compute_uv=False)
    assert (values[:, 0] / values[:, -1]).max() - 1 < 1e-12


def test_rotated_copies_are_optimised_together():
    s = multisine(**FLAT, channels=3, orthogonal="dft", periods=2, starts=16)
    runs = s.u.reshape(3, 2, N, 3)[:, 0]
    assert np.abs(runs).max() == pytest.approx(1, rel=1e-15) and max(s.recipe["crest_factor"]) < 1.62
    assert min((np.abs(runs).max(1) / runs.std(1)).min(1)) > 1.3


@pytest.mark.parametrize(
    "form", [{}, {"channels": 3}, {"channels": 2, "orthogonal": "hadamard", "periods": 2}, {"model": two_modes()}]
)
def test_zero_start(form):
    s = multisine(**FLAT, **form, zero_start=True, starts=4)
    free = multisine(**FLAT, **form, starts=4)
    blocks = s.u.reshape(s.recipe["experiments"], -1, len(s.channels))
    assert np.abs(blocks[:, 0]).max() < 1e-12
    fine = {"rel": 2e-3}  # the waveform only moves in time; the grids see it at other instants
    assert s.recipe["crest_factor_bound"] == pytest.approx(free.recipe["crest_factor_bound"], **fine)
    assert s.recipe["output_crest_factor"] == pytest.approx(free.recipe["output_crest_factor"], rel=0.02)


def test_allocation_search_keeps_the_counts():
    lines = np.arange(1, 14)
    owner, phases, _ = allocation.allocate(lines, np.ones(13), 3, rounds=3)
    assert sorted(np.bincount(owner)) == [4, 4, 5] and np.isfinite(phases).all()


# Recipes


@pytest.mark.parametrize(
    "form",
    [
        {"lines": list(range(1, 20)), "starts": 4},
        {"lines": list(range(1, 20)), "time_limit_s": 0.05},
        {"band_hz": (1, 20), "spacing": "odd-random", "phases": "random", "seed": 9, "spectrum": [(1, 2), (9, 1)]},
        {"band_hz": (1, 20), "spacing": "log", "count": 7, "phases": "schroeder", "zero_start": True},
        {"band_hz": (1, 9), "channels": ["a [N]", "b"], "starts": 2, "periods": 2, "amplitude": [0.1, 7]},
        {"band_hz": (1, 9), "channels": 3, "orthogonal": "dft", "starts": 2, "periods": 2},
        {"band_hz": (1, 9), "model": two_modes(), "starts": 2, "crest_target": 1.1, "zero_start": True},
        {"lines": [[1, 3], [2]], "channels": 2, "phases": [[0.1, 0.2], np.array([0.3])]},
    ],
)
def test_recipe_regenerates_the_same_bits(form):
    s = multisine(**BASE, **form)
    again = regenerate(json.loads(json.dumps(s.recipe.to_dict(), allow_nan=False)))
    assert np.array_equal(again.u, s.u) and again.period == s.period and again.channels == s.channels
    assert again.recipe.to_dict() == s.recipe.to_dict()


def test_missed_target_returns_the_best_and_says_so():
    s = multisine(**FLAT, crest_target=1.2, starts=4)
    value = s.recipe["crest_factor"][0]
    assert len(s.warnings) == 1 and f"{value:.4f} misses the target 1.2 after 4 starts" in s.warnings[0]
    met = multisine(**FLAT, crest_target=1.45, starts=400)
    assert not met.warnings and met.recipe["decided"]["starts"] < 400


def test_no_time_still_gives_a_signal_no_worse_than_schroeder():
    s = multisine(dt=0.01, period_s=100.0, band_hz=(0, 40), time_limit_s=1e-6, crest_target=1.3)
    assert s.recipe["crest_factor"][0] < 1.75 and "misses" in s.warnings[0]


def test_one_line_and_extreme_levels_stay_finite():
    for level in (1e-150, 1.0, 1e299):
        s = multisine(**BASE, lines=[3], amplitude=level, zero_start=True)
        assert np.isfinite(s.u).all() and np.abs(s.u).max() == pytest.approx(level)
        assert s.recipe["crest_factor"][0] == pytest.approx(np.sqrt(2), rel=1e-6)
        json.dumps(s.recipe.to_dict(), allow_nan=False)


def test_one_period_of_several_experiments_warns():
    s = multisine(**FLAT, channels=2, orthogonal="dft", phases="newman")
    assert "transient" in s.warnings[0]


# Refusals


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0}, "dt: 0; give a positive"),
        ({"period_s": 0.005}, "period_s: 0.005; it must hold at least 3 samples"),
        (
            {"period_s": 2.555},
            "period_s: 2.555; 255.5 samples of dt = 0.01 s; the nearest whole periods are 2.55 s and 2.56 s",
        ),
        ({"period_s": float("nan")}, "period_s: nan"),
        ({"period_s": 1e9}, "period_s: .* exceed"),
        ({"lines": None}, "band_hz: None; give the lowest"),
        ({"lines": None, "band_hz": (5, 60)}, "band_hz: .*60 Hz is not below the Nyquist frequency 50 Hz"),
        ({"lines": None, "band_hz": (9, 5)}, "band_hz: .* in that order"),
        ({"lines": None, "band_hz": (5,)}, "band_hz: .* in that order"),
        ({"lines": None, "band_hz": "ab"}, "band_hz: 'ab'; give the lowest"),
        ({"lines": None, "band_hz": (1, float("inf"))}, "band_hz: .* must be finite"),
        ({"lines": None, "band_hz": (0.4, 0.6)}, "band_hz: .* no full line, a multiple of 0.390625 Hz"),
        ({"lines": None, "band_hz": (0.7, 0.9), "spacing": "odd"}, "band_hz: .* no odd line"),
        ({"lines": None, "band_hz": (1, 9), "count": 5}, "count: 5; only the spacing 'log'"),
        ({"lines": None, "band_hz": (1, 9), "spacing": "log", "count": 0}, "count: 0; give a whole number"),
        ({"spacing": "od"}, "spacing: 'od'; did you mean 'odd'"),
        ({"band_hz": (1, 9)}, "lines: .* they replace band_hz"),
        ({"lines": [1, 128]}, "lines: 128; it is not below the Nyquist line 128 of a period of 256 samples"),
        ({"lines": [0, 1]}, "lines: .* increasing whole numbers"),
        ({"lines": [2, 1]}, "lines: .* increasing whole numbers"),
        ({"lines": [1.5]}, "lines: .* increasing whole numbers"),
        ({"lines": []}, "lines: .* increasing whole numbers"),
        ({"lines": "abc"}, "lines: .* increasing whole numbers"),
        ({"lines": [[1, 2], [2, 3]], "channels": 2}, "lines: .* share a line"),
        ({"lines": [[1, 2], [3]], "channels": 3}, "lines: .* needs 3 lists"),
        ({"lines": [1, 2], "channels": 3}, "channels: 3; only 2 lines to share"),
        ({"amplitude": 0}, "amplitude: 0; every amplitude must be positive"),
        ({"amplitude": [1, 2]}, "amplitude: .* give one number"),
        ({"amplitude": float("inf")}, "amplitude: inf"),
        ({"spectrum": [1, 2]}, "spectrum: .* 31 lines are played"),
        ({"spectrum": lambda f: f - 5}, "spectrum: .* must be positive"),
        ({"spectrum": lambda f: f * np.nan}, "spectrum: .* must be finite"),
        ({"spectrum": [(2, 1), (1, 1)]}, "spectrum: .* breakpoints must increase"),
        ({"phases": "schroder"}, "phases: 'schroder'; did you mean 'schroeder'"),
        ({"phases": [1, 2]}, "phases: '2 numbers'; give one per line: 31"),
        ({"phases": [np.nan] * 31}, "phases: .* must be finite"),
        ({"phases": 3.0}, "phases: '1 numbers'; give one per line: 31"),
        ({"channels": 0}, "channels: 0"),
        ({"orthogonal": "hadamar"}, "orthogonal: 'hadamar'; did you mean 'hadamard'"),
        ({"periods": 0}, "periods: 0"),
        ({"seed": -1}, "seed: -1"),
        ({"starts": 0}, "starts: 0"),
        ({"time_limit_s": -1}, "time_limit_s: -1"),
        ({"crest_target": 0.9}, "crest_target: 0.9; give peak over rms, at least 1"),
        ({"zero_start": 1}, "zero_start: 1; give true or false"),
        (
            {"zero_start": True, "channels": 3, "orthogonal": "dft"},
            "zero_start: True; channels of 'dft' are not in phase",
        ),
        ({"model": 3}, "model: 'int'; give a StateSpaceModel"),
        ({"model": {"A": 1}}, r"model: \['A'\]; give the matrices"),
        ({"model": two_modes(0.02)}, "model: 'dt 0.02 s'; the signal is sampled every 0.01 s"),
        ({"model": two_modes(), "channels": 2}, "model: '1 inputs'; the signal has 2 channels"),
        ({"model": StateSpaceModel([[1.0]], [[1.0]], [[1.0]], [[0.0]], 0.01)}, "model: 'pole of modulus 1'"),
        ({"decided": {}}, "decided: 'dict'; pass the entry"),
        (
            {"decided": {"lines": [[200]], "line_amplitudes": [[1]], "phases": [[0]], "starts": 0, "seconds": 0}},
            "decided: 'lines that do not fit",
        ),
        ({"period_s": 1e300}, "period_s: .* "),
    ],
)
def test_refusals_name_parameter_value_and_remedy(change, message):
    with pytest.raises(ExciteError, match=f"multisine: {message}"):
        multisine(**{**FLAT, "starts": 1, **change})
