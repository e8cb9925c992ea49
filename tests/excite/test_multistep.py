"""Multistep inputs: how long each level lasts, means and signs, the log-spaced sampling plan, and their errors."""

import json
import math
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators import GENERATORS, log_times, multistep, regenerate

FORMS = ("step", "pulse", "doublet", "3-2-1-1", "staircase")
times = st.integers(1, 40)


def runs(u):
    """Levels with the number of samples each lasts."""
    return [(float(level), len(list(samples))) for level, samples in groupby(u)]


@settings(max_examples=40, deadline=None)
@given(times, st.integers(0, 40), st.integers(1, 40), st.floats(0.1, 100))
def test_3211_durations(unit, lead, rest, amplitude):
    u = multistep(
        form="3-2-1-1", dt=0.02, unit_s=unit * 0.02, lead_s=lead * 0.02, rest_s=rest * 0.02, amplitude=amplitude
    ).u
    a = amplitude
    expected = [(0.0, lead), (a, 3 * unit), (-a, 2 * unit), (a, unit), (-a, unit), (0.0, rest)]
    assert runs(u[:, 0]) == [run for run in expected if run[1]]


@settings(max_examples=40, deadline=None)
@given(times, st.integers(0, 40), st.integers(0, 40), st.floats(0.1, 100), st.integers(1, 4))
def test_a_doublet_has_zero_mean(unit, lead, rest, amplitude, repeats):
    signal = multistep(
        form="doublet",
        dt=0.1,
        unit_s=unit * 0.1,
        lead_s=lead * 0.1,
        rest_s=rest * 0.1,
        amplitude=amplitude,
        repeats=repeats,
    )
    assert len(signal.u) == lead + repeats * (2 * unit + rest)
    assert math.fsum(signal.u[:, 0]) == 0
    assert np.abs(signal.u).max() == amplitude


def test_the_spectrum_of_a_doublet_peaks_where_stated():
    u = multistep(form="doublet", dt=0.001, unit_s=1.0, rest_s=98.0).u[:, 0]
    lines = np.abs(np.fft.rfft(u))
    assert lines.argmax() / (len(u) * 0.001) == pytest.approx(0.37, abs=0.01)


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ("step", [(0, 3), (2, 3)]),
        ("pulse", [(0, 3), (2, 3), (0, 3)]),
        ("doublet", [(0, 3), (2, 3), (-2, 3), (0, 3)]),
        ("staircase", [(0, 3), (0.5, 3), (1, 3), (1.5, 3), (2, 3), (1.5, 3), (1, 3), (0.5, 3), (0, 3)]),
    ],
)
def test_shapes(form, expected):
    signal = multistep(form=form, dt=0.1, unit_s=0.3, amplitude=2)
    assert runs(signal.u[:, 0]) == expected
    assert signal.recipe["edges"] == np.cumsum([n for _, n in expected])[:-1].tolist()
    assert signal.recipe["unit_samples"] == 3 and signal.period is None


def test_alternate_swaps_every_second_sign():
    u = multistep(form="pulse", dt=1.0, unit_s=2, lead_s=0, rest_s=1, repeats=3, alternate=True).u[:, 0]
    assert u.tolist() == [1, 1, 0, -1, -1, 0, 1, 1, 0]


def test_channels_in_turn_about_their_offsets():
    signal = multistep(form="doublet", dt=1.0, unit_s=1, amplitude=[1, -2], offset=[0, 10], channels=["a [deg]", "b"])
    a, b = signal.u.T.tolist()
    assert a == [0, 1, -1, 0, 0, 0, 0, 0]
    assert b == [10, 10, 10, 10, 10, 8, 12, 10]
    assert signal.recipe["starts"] == [0, 4]


@pytest.mark.parametrize("form", FORMS)
def test_recipes_are_json_and_regenerate_bit_for_bit(form):
    signal = multistep(form=form, dt=0.02, unit_s=0.3, amplitude=[0.1, 3], channels=2, offset=0.7, seed=3)
    again = regenerate(json.loads(json.dumps(signal.recipe.to_dict(), allow_nan=False)))
    assert again.u.tobytes() == signal.u.tobytes() and again.recipe == signal.recipe


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"form": "3211"}, "multistep: form: '3211'; did you mean '3-2-1-1'?"),
        ({"unit_s": 0}, "multistep: unit_s: 0; give a positive number of seconds"),
        ({"unit_s": 1e-4}, "multistep: unit_s: 0.0001; it must span at least one sample"),
        ({"unit_s": 1e9}, "exceed 200000000 values (1.6 GB)"),
        ({"lead_s": -1}, "multistep: lead_s: -1; give a number of seconds, 0 for none"),
        ({"rest_s": math.inf}, "multistep: rest_s: inf;"),
        ({"form": "step", "rest_s": 1}, "multistep: rest_s: 1; the form 'step' does not use it"),
        ({"form": "step", "repeats": 2}, "multistep: repeats: 2; the form 'step' does not use it"),
        ({"steps": 3}, "multistep: steps: 3; the form 'doublet' does not use it"),
        ({"form": "staircase", "steps": 0}, "multistep: steps: 0;"),
        ({"form": "staircase", "steps": 10**9}, "multistep: steps: 1000000000;"),
        ({"repeats": 0}, "multistep: repeats: 0;"),
        ({"repeats": 10**9}, "exceed 200000000 values"),
        ({"alternate": "yes"}, "multistep: alternate: 'yes'; give true or false"),
        ({"amplitude": 0}, "multistep: amplitude: 0; every amplitude must be finite and not zero"),
        ({"amplitude": math.nan}, "multistep: amplitude: nan;"),
        ({"amplitude": True}, "multistep: amplitude: True;"),
    ],
)
def test_bad_parameters_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        multistep(**{"dt": 0.01, "unit_s": 0.1} | parameters)
    assert message in str(caught.value)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 1000), st.integers(2, 10**6), st.integers(1, 50))
def test_log_times(first, factor, per_decade):
    dt = 1e-3
    times = log_times(first_s=first * dt, last_s=first * factor * dt, per_decade=per_decade, dt=dt)
    grid = times / dt
    np.testing.assert_allclose(grid, np.rint(grid), rtol=1e-12)
    assert np.rint(grid[[0, -1]]).tolist() == [first, first * factor]
    assert (np.diff(times) > 0.5 * dt).all()
    spacing = np.diff(np.log10(grid))
    rounding = np.log10(1 + 1 / grid[:-1])  # at most half a sample at either end, and never less than one sample
    assert (spacing <= 1 / per_decade + rounding + 1e-9).all()
    assert len(times) <= per_decade * np.log10(factor) + 2


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"first_s": 0}, "log_times: first_s: 0; give a positive number of seconds"),
        ({"last_s": 0.01}, "log_times: last_s: 0.01; it must lie behind first_s = 0.01 s"),
        ({"per_decade": 0}, "log_times: per_decade: 0;"),
        ({"per_decade": 10**12}, "log_times: per_decade: 1000000000000; 2000000000001 samples"),
        ({"first_s": 1e-5}, "log_times: first_s: 1e-05; it must span at least one sample"),
    ],
)
def test_bad_sampling_plans_are_named(parameters, message):
    with pytest.raises(ExciteError) as caught:
        log_times(**{"first_s": 0.01, "last_s": 1.0, "per_decade": 10, "dt": 0.001} | parameters)
    assert message in str(caught.value)


def test_the_table_lists_the_generator():
    assert GENERATORS["multistep"] is multistep
