"""Sweeps: where the frequency is when, what the ends look like, whole measured periods, and their errors."""

import json
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators import GENERATORS, regenerate, sweep

DT = 0.001
band = st.tuples(st.floats(0.5, 50), st.floats(0.5, 50)).filter(lambda f: max(f) > 1.5 * min(f))


def frequency(u):
    """Zero crossings per second around each crossing: (times, Hz), times in samples."""
    k = np.flatnonzero(u[:-1] * u[1:] < 0)
    crossing = k + u[k] / (u[k] - u[k + 1])
    return (crossing[1:] + crossing[:-1]) / 2, 0.5 / (np.diff(crossing) * DT)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["linear", "log"]), band)
def test_the_frequency_follows_its_law(form, limits):
    f0, f1 = limits
    u = sweep(form=form, dt=DT, start_hz=f0, stop_hz=f1, duration_s=20.0).u[:, 0]
    at, found = frequency(u)
    x = at / (len(u) - 1)
    law = f0 + (f1 - f0) * x if form == "linear" else f0 * (f1 / f0) ** x
    settled = np.abs(f1 - f0) / (law**2 * 20.0) < 0.02  # the frequency hardly changes between two crossings
    assume(settled.sum() > 10)
    np.testing.assert_allclose(found[settled], law[settled], rtol=0.01)
    assert u[0] == 0 and np.abs(u).max() == pytest.approx(1, abs=0.02)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 3), st.integers(2, 4))
def test_a_log_sweep_spends_equal_time_in_each_octave(f0, octaves):
    u = sweep(dt=DT, start_hz=f0, stop_hz=f0 * 2**octaves, duration_s=30.0 * octaves).u[:, 0]
    at, found = frequency(u)
    counts = np.diff([np.interp(f0 * 2**i, found, at) for i in range(octaves + 1)])
    np.testing.assert_allclose(counts[1:-1], 30 / DT, rtol=0.03)
    cycles = np.count_nonzero(u[:-1] * u[1:] < 0) / 2
    assert cycles == pytest.approx(30 * octaves * f0 * (2**octaves - 1) / (octaves * math.log(2)), abs=1)


def test_phase_is_the_integral_of_the_frequency():
    u = sweep(dt=DT, start_hz=1, stop_hz=10, duration_s=5.001).u[:, 0]
    t = np.linspace(0, 5, 50001)
    f = 10 ** (t / 5)
    phase = np.concatenate([[0], np.cumsum((f[1:] + f[:-1]) / 2 * np.diff(t))])
    np.testing.assert_allclose(u, np.sin(2 * np.pi * phase[::10]), atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["linear", "log"]), st.floats(0.1, 5), st.floats(0.1, 5), st.floats(0.1, 5))
def test_faded_ends_are_zero_and_the_middle_is_not_touched(form, fade_in, fade_out, amplitude):
    parameters = {"form": form, "dt": 0.01, "start_hz": 1, "stop_hz": 10, "duration_s": 12, "amplitude": amplitude}
    plain = sweep(**parameters).u[:, 0]
    faded = sweep(**parameters, fade_in_s=fade_in, fade_out_s=fade_out).u[:, 0]
    assert faded[0] == 0 and faded[-1] == 0
    middle = slice(math.ceil(fade_in / 0.01), len(plain) - math.ceil(fade_out / 0.01) - 1)
    np.testing.assert_allclose(faded[middle], plain[middle], atol=1e-12 * amplitude)
    assert (np.abs(faded) <= np.abs(plain) + 1e-15).all()


def test_the_flight_test_sweep_of_ardupilot():
    """The formulas of AP_Math/chirp.cpp at its sample times, record 70 s from the first to the last sample."""
    dt, record, fade_in, fade_out = 0.0025, 70.0, 15.0, 2.0
    low, dwell, B = 2 * np.pi * 0.5, 4.0, math.log(40 / 0.5)
    t = np.arange(28001) * dt
    s = t - dwell
    phase = np.where(t <= dwell, low * s, low * (record - dwell) / B * (np.exp(B * s / (record - dwell)) - 1))
    window = np.minimum(
        np.where(t <= fade_in, 0.5 - 0.5 * np.cos(np.pi * t / fade_in), 1),
        np.where(t <= record - fade_out, 1, 0.5 - 0.5 * np.cos(np.pi * (t - record + fade_out) / fade_out + np.pi)),
    )
    u = sweep(
        dt=dt, start_hz=0.5, stop_hz=40, duration_s=record + dt, fade_in_s=15, fade_out_s=2, dwell_cycles=2, amplitude=3
    ).u
    np.testing.assert_allclose(u[:, 0], 3 * window * np.sin(phase), atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(st.integers(100, 2000), st.floats(0.01, 0.3), st.floats(0.05, 0.5), st.integers(1, 3))
def test_schroeder_has_flat_lines_in_the_band_only(length, low, width, periods):
    high = min(low + width, 0.5)
    assume(low * length >= 1)
    signal = sweep(
        form="schroeder", dt=1.0, start_hz=low, stop_hz=high, duration_s=length, periods=periods, amplitude=2.5
    )
    assert signal.period == length and len(signal.u) == periods * length
    lines = np.abs(np.fft.rfft(signal.u[:length, 0]))
    k = np.arange(len(lines))
    inside = (k >= low * length * (1 - 1e-12)) & (k <= high * length * (1 + 1e-12)) & (2 * k < length)
    np.testing.assert_allclose(lines[inside], lines.max(), rtol=1e-9)
    assert lines[~inside].max() < 1e-10 * lines.max()
    assert np.abs(signal.u).max() == 2.5
    assert signal.recipe["crest_factor"] == pytest.approx(2.5 / np.sqrt((signal.u**2).mean()))


def test_schroeder_phases_give_the_published_crest_factor():
    signal = sweep(form="schroeder", dt=1 / 1024, start_hz=1, stop_hz=31, duration_s=1.0)  # 31 lines, 16 x oversampled
    assert signal.recipe["crest_factor"] == pytest.approx(1.781, abs=0.01)


frequencies = st.lists(st.floats(0.2, 40), min_size=1, max_size=6)


@settings(max_examples=40, deadline=None)
@given(frequencies, st.integers(1, 8), st.floats(0, 5), st.integers(1, 2))
def test_stepped_sines_measure_whole_periods(asked, measure, settle, count):
    profile = [1 + i / 10 for i in range(len(asked))]
    signal = sweep(
        form="stepped",
        dt=0.01,
        frequencies_hz=asked,
        measure_periods=measure,
        settle_periods=settle,
        profile=profile,
        channels=count,
        amplitude=2.0,
    )
    segments = signal.recipe["segments"]
    assert len(segments) == count * len(asked)
    end = 0
    for i, step in enumerate(segments):
        assert step["start"] == end
        begin, end = step["start"] + step["settle"], step["start"] + step["settle"] + step["measure"]
        assert step["f_hz"] * step["measure"] * 0.01 == pytest.approx(measure, rel=1e-12)
        assert step["settle"] * 0.01 >= settle / step["f_hz"] - 1e-9
        assert (
            abs(step["measure"] - measure / (step["asked_hz"] * 0.01)) <= 0.5 + 1e-9
            or step["measure"] == 2 * measure + 1
        )
        lines = np.fft.rfft(signal.u[begin:end, step["channel"]]) / step["measure"] * 2
        assert abs(lines[measure]) == pytest.approx(2.0 * profile[i % len(asked)], rel=1e-9)
        assert step["amplitude"] == pytest.approx(abs(lines[measure]))
        lines[measure] = 0
        assert np.abs(lines).max() < 1e-9
        others = [c for c in range(count) if c != step["channel"]]
        assert (signal.u[step["start"] : end, others] == 0).all()
    assert end == len(signal.u)


def test_stepped_phase_is_continuous():
    u = sweep(form="stepped", dt=0.001, start_hz=1, stop_hz=20, points=12).u[:, 0]
    assert np.abs(np.diff(u)).max() <= 2 * math.sin(math.pi * 20.1 * 0.001)
    assert u[0] == 0


def test_stepped_defaults_to_thirty_log_spaced_frequencies():
    recipe = sweep(form="stepped", dt=0.001, start_hz=1, stop_hz=100).recipe
    asked = [step["asked_hz"] for step in recipe["segments"]]
    np.testing.assert_allclose(asked, np.geomspace(1, 100, 30))
    assert recipe["points"] == 30 and recipe.warnings == ()
    np.testing.assert_allclose([step["f_hz"] for step in recipe["segments"]], asked, rtol=0.01)


def test_a_coarse_grid_is_said():
    moved, together = sweep(form="stepped", dt=0.01, frequencies_hz=[23, 24], measure_periods=1).warnings
    assert "moves 23 Hz to 25 Hz" in moved and "fall together" in together


def test_channels_in_turn():
    signal = sweep(
        dt=0.01, start_hz=1, stop_hz=5, duration_s=3, channels=["p [deg]", "q"], amplitude=[1, 2], offset=[5, -5]
    )
    assert signal.u.shape == (600, 2) and signal.recipe["starts"] == [0, 300] and signal.period is None
    assert (signal.u[:300, 1] == -5).all() and (signal.u[300:, 0] == 5).all()
    np.testing.assert_allclose((signal.u[300:, 1] + 5) / 2, signal.u[:300, 0] - 5, atol=1e-12)


@pytest.mark.parametrize(
    "parameters",
    [
        {"start_hz": 0.5, "stop_hz": 20, "duration_s": 9, "dwell_cycles": 2, "fade_in_s": 1, "fade_out_s": 0.3},
        {"form": "linear", "start_hz": 20, "stop_hz": 1, "duration_s": 5},
        {"form": "schroeder", "start_hz": 1, "stop_hz": 10, "duration_s": 3, "periods": 2},
        {"form": "stepped", "start_hz": 1, "stop_hz": 10, "points": 4},
        {"form": "stepped", "frequencies_hz": 3},
        {"form": "stepped", "frequencies_hz": np.array([1, 3.3]), "profile": [1, 0.5], "settle_periods": 0},
    ],
)
def test_recipes_are_json_and_regenerate_bit_for_bit(parameters):
    signal = sweep(dt=0.02, amplitude=[0.1, 3], channels=2, offset=0.7, seed=3, **parameters)
    again = regenerate(json.loads(json.dumps(signal.recipe.to_dict(), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes() and again.recipe == signal.recipe


STEPPED = {"form": "stepped", "start_hz": None, "stop_hz": None, "duration_s": None}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"form": "chirp"}, "sweep: form: 'chirp'; known: linear, log, schroeder, stepped"),
        ({"start_hz": None}, "sweep: start_hz: None; the form 'log' needs it"),
        ({"start_hz": 0}, "sweep: start_hz: 0; give a positive number of Hz"),
        ({"stop_hz": 60}, "sweep: stop_hz: 60; it exceeds the Nyquist frequency 50 Hz"),
        ({"stop_hz": 1}, "sweep: stop_hz: 1.0; it equals start_hz"),
        ({"duration_s": 0.5}, "sweep: duration_s: 0.5; it holds no whole period of 1 Hz; play at least 1 s"),
        ({"duration_s": 1e9}, "exceed 200000000 values (1.6 GB)"),
        ({"dwell_cycles": 0.5}, "sweep: dwell_cycles: 0.5; give a whole number of at least 0"),
        ({"dwell_cycles": 10}, "sweep: dwell_cycles: 10; its 10 s leave -0.01 s to sweep"),
        ({"fade_in_s": -1}, "sweep: fade_in_s: -1;"),
        ({"fade_in_s": 6, "fade_out_s": 5}, "sweep: fade_out_s: 5.0; with fade_in_s = 6 it exceeds the 9.99 s"),
        ({"periods": 2}, "sweep: periods: 2; the form 'log' does not use it"),
        ({"points": 2}, "sweep: points: 2; the form 'log' does not use it"),
        ({"amplitude": 0}, "sweep: amplitude: 0; every amplitude must be positive"),
        ({"amplitude": math.inf}, "sweep: amplitude: inf;"),
        ({"form": "schroeder", "fade_in_s": 1}, "sweep: fade_in_s: 1; the form 'schroeder' does not use it"),
        (
            {"form": "schroeder", "start_hz": 10, "stop_hz": 1},
            "no multiple of 0.1 Hz lies between start_hz and stop_hz",
        ),
        (STEPPED, "sweep: start_hz: None; the form 'stepped' needs start_hz and stop_hz, or frequencies_hz"),
        (STEPPED | {"frequencies_hz": []}, "sweep: frequencies_hz: []; give a list of frequencies in Hz"),
        (STEPPED | {"frequencies_hz": [1, 70]}, "sweep: frequencies_hz[1]: 70; it exceeds the Nyquist frequency"),
        (STEPPED | {"frequencies_hz": [1], "points": 3}, "give one of the two ways"),
        (STEPPED | {"frequencies_hz": [1], "measure_periods": 0}, "sweep: measure_periods: 0;"),
        (STEPPED | {"frequencies_hz": [1], "settle_periods": -1}, "sweep: settle_periods: -1;"),
        (STEPPED | {"frequencies_hz": [1], "settle_periods": 1e200}, "exceed 200000000 values"),
        (STEPPED | {"frequencies_hz": [1, 2], "profile": [1, 2, 3]}, "one for each of the 2 frequencies"),
        (
            STEPPED | {"frequencies_hz": [1, 2], "profile": [1, 0]},
            "sweep: profile: [1, 0]; every profile must be positive",
        ),
        (
            STEPPED | {"frequencies_hz": [1], "duration_s": 3},
            "sweep: duration_s: 3; the form 'stepped' does not use it",
        ),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        sweep(**{"dt": 0.01, "start_hz": 1, "stop_hz": 10, "duration_s": 10} | parameters)
    assert message in str(caught.value)


def test_the_table_lists_the_generator():
    assert GENERATORS["sweep"] is sweep
