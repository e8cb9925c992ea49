"""Limits of the hardware: checked against plain loops, and shaped signals that keep every one of them as played."""

import json
import tomllib

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import DesignRefused, ExciteError
from excite.generators import GENERATORS, prbs, regenerate
from excite.limits.limits import Limits, OutputLimit, check
from excite.limits.program import Bounds, nearest
from excite.limits.shaping import shape
from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import certify
from excite.types.signal import Signal

DT = 0.01


def resonance(radius=0.9, angle=0.3, channels=1, offset=0.0):
    """Two poles at radius exp(+-i angle), unit static gain, the channels' sum in."""
    a1, a2 = -2 * radius * np.cos(angle), radius**2
    A, B = np.array([[-a1, -a2], [1, 0]]), np.tile([[1.0], [0.0]], (1, channels))
    return StateSpaceModel(A, B, [[0, 1 + a1 + a2]], np.zeros((1, channels)), DT, output_offset=[offset])


def multisine(N=400, lines=40, periods=1, seed=0):
    phases = 2 * np.pi * np.random.default_rng(seed).random(lines)
    t = np.arange(N * periods)[:, None]
    return Signal(
        np.cos(2 * np.pi * np.arange(1, lines + 1) * t / N + phases).sum(1) / np.sqrt(lines / 2), DT, period=N
    )


def value(report, limit, channel="u1"):
    (found,) = [c for c in report.checks if (c.limit, c.channel) == (limit, channel)]
    return found


def test_every_limit_is_measured_by_its_definition():
    u = np.array([[0.0, 1.0], [0.5, 1.0], [0.5, -2.0], [-0.25, 0.0]])
    limits = Limits(low=[-1, -1.5], high=1, move=[2, 1], rate=80, bits=3, range=(-2, 1.5))
    report = check(Signal(u, DT), limits)
    assert not report.ok and value(report, "low").ok and not value(report, "low", "u2").ok
    assert (value(report, "low", "u2").value, value(report, "low", "u2").where_s) == (-2.0, 2 * DT)
    assert value(report, "move", "u2").value == 3.0 and not value(report, "move", "u2").ok
    assert value(report, "rate").value == pytest.approx(75) and value(report, "rate").ok
    assert value(report, "rate").where_s == pytest.approx(3 * DT) and value(
        report, "rate", "u2"
    ).value == pytest.approx(300)
    assert value(report, "quantisation").value == 0.5 and value(report, "quantisation", "u2").ok  # levels every 0.5
    assert {c.limit for c in report.exceeded} == {"low", "move", "rate", "quantisation"}
    assert "low of 'u2' exceeded: -2 against -1.5 at 0.02 s" in map(str, report.exceeded)
    json.dumps(report.to_dict(), allow_nan=False)


def test_a_period_also_moves_from_its_end_to_its_start():
    u = [0.0, 1.0, 2.0, 3.0]
    assert value(check(Signal(u, DT), Limits(move=1.5)), "move").value == 1.0
    assert value(check(Signal(u, DT, period=4), Limits(move=1.5)), "move").value == 3.0


def test_held_values_move_once_a_hold():
    signal = Signal(np.repeat([0.0, 1.0, -1.0], 4), DT)
    report = check(signal, Limits(hold=4, rate=60))
    assert report.ok and value(report, "rate").value == pytest.approx(2 / (4 * DT))
    assert not check(Signal(signal.u[1:], DT), Limits(hold=4)).ok


def test_lost_power_of_a_sine_is_that_of_a_first_order_lag():
    sine = Signal(3 + np.sin(2 * np.pi * 5 * DT * np.arange(400)), DT, period=20)
    assert value(check(sine, Limits(bandwidth_hz=5.0)), "lost power").value == pytest.approx(0.5)
    lag = StateSpaceModel([[0.5]], [[1]], [[0.5]], [[0]], DT)
    gain = np.abs(0.5 / (np.exp(2j * np.pi * 5 * DT) - 0.5)) ** 2
    assert value(check(sine, Limits(actuator=lag)), "lost power").value == pytest.approx(1 - gain)


def test_outputs_are_predicted_from_trim():
    model = resonance(offset=10.0)
    signal = multisine()
    y = 10 + resonance().simulate(signal.u)[:, 0]
    report = check(signal, Limits(outputs=(OutputLimit(model, 9.0, 10.5),)))
    assert value(report, "output low", "y1").value == pytest.approx(y.min())
    assert value(report, "output high", "y1").where_s == pytest.approx(y.argmax() * DT)


bounds_st = st.fixed_dictionaries(
    {"amplitude": st.floats(0.3, 2.5)},
    optional={
        "rate": st.floats(5, 150),
        "move": st.floats(0.05, 1.5),
        "bits": st.integers(5, 12),
        "hold": st.sampled_from([2, 4]),
        "output": st.floats(0.3, 1.2),
        "bandwidth_hz": st.floats(4, 20),
    },
)


@settings(max_examples=60, deadline=None)
@given(
    drawn=bounds_st,
    seed=st.integers(0, 1000),
    periods=st.integers(1, 2),
    periodic=st.booleans(),
    channels=st.integers(1, 2),
)
def test_shaped_signals_keep_every_limit_after_quantisation(drawn, seed, periods, periodic, channels):
    signal = multisine(200, 25, periods, seed)
    signal = Signal(
        np.hstack([signal.u, np.roll(signal.u, 57, axis=0)])[:, :channels], DT, period=200 if periodic else None
    )
    output = drawn.pop("output", None)
    model = resonance(channels=channels)
    if output is not None:
        drawn["outputs"] = (OutputLimit(model, -output, 1.1 * output),)
    limits = Limits(**drawn)
    try:
        shaped = shape(signal, limits)
    except DesignRefused:
        assert "bits" in drawn  # a coarse converter under a tight output limit may leave nothing but rest
        return
    except ExciteError as error:
        step = 2 * limits.amplitude / (2 ** drawn["bits"] - 1)
        assert "less than one step" in str(error)
        assert min(limits.move or np.inf, (limits.rate or np.inf) * limits.hold * DT) < step
        return
    u = shaped.signal.u
    near = 1 + 1e-9
    hold = limits.hold
    held = np.repeat(u[::hold], hold, axis=0)
    np.testing.assert_array_equal(u, held)
    moves = np.abs(np.diff(u[::hold], axis=0, append=u[:1] if shaped.signal.period else u[-hold:][:1]))
    assert np.abs(u).max() <= limits.amplitude * near
    assert moves.max() <= (limits.move or np.inf) * near and moves.max() / (hold * DT) <= (limits.rate or np.inf) * near
    if limits.bits:
        steps = (u + limits.amplitude) / (2 * limits.amplitude) * (2**limits.bits - 1)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    if output is not None:
        y = model.simulate(u)
        assert y.min() >= -output * near and y.max() <= 1.1 * output * near
    assert shaped.after.ok and check(shaped.signal, limits).ok
    assert shaped.signal.period == signal.period
    assert shaped.certificate == certify(shaped.signal, block_rows=20)
    again = shape(shaped.signal, limits)
    np.testing.assert_array_equal(again.signal.u, u)
    assert again.method == "unchanged"


def test_a_broadband_signal_under_amplitude_limits_is_clipped():
    noise = Signal(np.random.default_rng(0).standard_normal((300, 2)), DT)
    shaped = shape(noise, Limits(amplitude=[1.0, 2.0]))
    np.testing.assert_array_equal(shaped.signal.u, np.clip(noise.u, [-1, -2], [1, 2]))
    assert shaped.method == "projection" and shaped.bound == ("low", "high") and shaped.loss.log_det < 0
    assert dict(shaped.signal.recipe.shaped["limits"]) == {"amplitude": [1.0, 2.0], "hold": 1, "lost_power": 0.5}


def test_the_program_finds_the_nearest_sequence():
    """The projection onto a convex set meets (v* - v)^T (v* - u0) <= 0 for all feasible v."""
    rng = np.random.default_rng(1)
    u0 = rng.standard_normal((60, 1)).cumsum(0)
    none, model = np.zeros(0), (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((0, 0)), np.zeros((0, 1)))
    low, high, move, rest = np.array([[-2.0], [2.0], [0.3], [0.0]])
    bounds = Bounds(np.arange(60), False, low, high, move, rest, model, none, none)
    v, solved = nearest(u0, bounds, None, none)
    assert solved and np.abs(v).max() <= 2 + 1e-3 and np.abs(np.diff(v, axis=0)).max() <= 0.3 + 1e-3
    for _ in range(200):  # random feasible sequences: clipped, slowly moving
        other = np.clip(np.cumsum(rng.uniform(-0.3, 0.3, (60, 1)), axis=0), -2, 2)
        assert ((v - other) * (v - u0)).sum() <= 1e-2 * np.linalg.norm(v - u0) * np.linalg.norm(v - other)


def test_the_excited_band_is_spared():
    """With room beyond the band, clipping distortion goes there: the lines lose far less than by clipping."""
    signal = multisine(2000, 60)
    limits = Limits(amplitude=0.7 * np.abs(signal.u).max())
    banded, flat = shape(signal, limits), shape(signal, limits, band_hz=(0, 50))
    assert flat.method == "projection" and banded.method == "quadratic program"
    assert banded.loss.worst_line_db > flat.loss.worst_line_db
    assert banded.loss.mean_line_db > 0.6 * flat.loss.mean_line_db
    assert banded.certificate.order == 20


def test_output_limits_cost_less_than_scaling_the_signal_down():
    signal, model = multisine(1000, 60), resonance()
    peak = np.abs(model.simulate(signal.u)).max()
    shaped = shape(signal, Limits(outputs=(OutputLimit(model, -0.7 * peak, 0.7 * peak),)))
    assert shaped.method == "quadratic program" and shaped.loss.mean_line_db > 20 * np.log10(0.7) / 4


def test_outputs_may_be_bounded_on_one_side_or_not_at_all():
    model = StateSpaceModel(np.diag([0.5, 0.8]), [[1.0], [1.0]], np.eye(2), np.zeros((2, 1)), DT)
    signal, free = multisine(), np.inf
    shaped = shape(signal, Limits(outputs=(OutputLimit(model, [-free, -0.5], [1.0, free]),)))
    y = model.simulate(shaped.signal.u)
    assert y[:, 0].max() <= 1 + 1e-9 and y[:, 1].min() >= -0.5 - 1e-9 and y[:, 0].min() < -1
    assert shape(signal, Limits(outputs=(OutputLimit(model),))).method == "unchanged"
    assert {c.limit for c in check(signal, Limits(outputs=(OutputLimit(model, high=1.0),))).checks} == {"output high"}


def test_an_integrating_output_can_be_bounded():
    model = StateSpaceModel([[1.0]], [[DT]], [[1.0]], [[0.0]], DT)
    signal = Signal(0.2 + multisine(500, 50).u, DT)  # drifts: the output leaves any bound
    assert np.abs(model.simulate(signal.u)).max() > 0.9
    shaped = shape(signal, Limits(outputs=(OutputLimit(model, -0.3, 0.3),)))
    assert np.abs(model.simulate(shaped.signal.u)).max() <= 0.3 * (1 + 1e-9) and shaped.loss.mean_line_db > -1


def test_lines_beyond_the_actuator_are_dropped_first():
    signal = prbs(order=8, dt=DT)
    shaped = shape(signal, Limits(bandwidth_hz=8.0))
    before, after = (np.abs(np.fft.rfft(s.u[:, 0])) for s in (signal, shaped.signal))
    kept = after > 1e-6
    assert shaped.bound == ("lost power",) and kept[1:20].all() and not kept[-20:].any()
    np.testing.assert_allclose(after[kept], before[kept], rtol=1e-9)
    assert 0.45 < value(shaped.after, "lost power").value <= 0.5


def test_limits_travel_through_toml_and_json():
    limits = Limits(
        amplitude=[1.0, 2.0],
        rate=3.0,
        bits=12,
        range=(-2.5, 2.5),
        hold=2,
        lost_power=0.4,
        bandwidth_hz=5.0,
        outputs=(OutputLimit(resonance(channels=2), high=0.5),),
    )
    for text in (json.loads(json.dumps(limits.to_dict())), tomllib.loads(tomli_w.dumps(limits.to_dict()))):
        copy = Limits.from_dict(text)
        assert copy.to_dict() == limits.to_dict()
    signal = prbs(order=6, dt=DT, channels=2)
    assert check(signal, copy) == check(signal, limits)
    actuator = Limits(actuator=resonance())
    assert Limits.from_dict(actuator.to_dict()).to_dict() == actuator.to_dict()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"amplitude": 0.0}, "amplitude: 0.0"),
        ({"amplitude": float("nan")}, "amplitude: nan"),
        ({"amplitude": [1.0, 2.0]}, r"amplitude: \[1.0, 2.0\]; give one number, or one for each of u1"),
        ({"rat": 1.0}, "did you mean 'rate'"),
        ({"low": 2.0, "high": 1.0}, "channel 'u1': low 2 is above high 1"),
        ({"bits": 8}, "bits: 8 without a range"),
        ({"bits": 0, "amplitude": 1.0}, "bits: 0"),
        ({"hold": 1.5}, "hold: 1.5"),
        ({"range": (1, -1), "bits": 3}, "range"),
        ({"lost_power": 1.0}, "lost_power: 1.0"),
        ({"bits": 4, "range": (-1.0, 1.0), "low": 0.01, "high": 0.05}, "no level of the converter"),
        ({"bits": 4, "amplitude": 1.0, "move": 0.1}, "rate and move allow changes of 0.1, less than one step 0.133333"),
        ({"outputs": [{"model": {"A": [[0.5]]}}]}, "B, C, D, dt missing"),
        ({"outputs": [{"modle": 1}]}, "did you mean 'model'"),
        ({"bandwidth_hz": 0.01}, "lost power: the actuator takes more than 50% of every line of channel 'u1'"),
    ],
)
def test_impossible_limits_say_which_one_binds(table, message):
    with pytest.raises(ExciteError, match=message):
        shape(multisine(), Limits.from_dict(table))


def test_output_limits_that_trim_or_the_bounds_violate_are_refused():
    with pytest.raises(ExciteError, match=r"output 'y1': trim is 10, not inside -1 to 1"):
        OutputLimit(resonance(offset=10.0), -1.0, 1.0)
    with pytest.raises(ExciteError, match="not inside 0 to 1; no command keeps this limit and moves"):
        OutputLimit(resonance(), 0.0, 1.0)
    off_trim = Limits(low=1.0, high=3.0, outputs=(OutputLimit(resonance(), -0.5, 0.5),))
    with pytest.raises(
        ExciteError, match=r"amplitude keeps the command off trim, .* takes output 'y1' 0\.\d+ past its limit"
    ):
        shape(multisine(), off_trim)
    with pytest.raises(ExciteError, match="2 inputs, the signal 1 channels"):
        check(multisine(), Limits(outputs=(OutputLimit(resonance(channels=2), -1, 1),)))
    slow = StateSpaceModel([[0.5]], [[1]], [[1]], [[0]], 0.1)
    with pytest.raises(ExciteError, match=r"model's dt is 0\.1 s, the signal's 0\.01 s"):
        check(multisine(), Limits(actuator=slow))


def test_limits_that_leave_nothing_refuse_the_design():
    with pytest.raises(DesignRefused, match="move leave channel 'u1' nothing"):
        shape(multisine(), Limits(move=1e-7))
    with pytest.raises(ExciteError, match=r"band_hz \(80, 90\) lies above the Nyquist"):
        shape(multisine(), Limits(amplitude=1.0), band_hz=(80, 90))


def test_a_shaped_signal_is_regenerated_from_its_recipe():
    signal = GENERATORS["multisine"](
        dt=0.01, period_s=2.0, band_hz=[0.5, 10.0], amplitude=6.0, phases="schroeder", periods=2
    )
    shaped = shape(signal, Limits(amplitude=4.0, rate=100.0, bits=12, range=(-5.0, 5.0))).signal
    assert not np.array_equal(shaped.u, signal.u)
    again = regenerate(json.loads(json.dumps(shaped.recipe.to_dict())))
    assert again.u.tobytes() == shaped.u.tobytes() and again.recipe.to_dict() == shaped.recipe.to_dict()
