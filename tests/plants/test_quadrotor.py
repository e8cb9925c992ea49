"""The quadrotor: layout, flights, what is recorded, noise, limits, refusals and the safety stop."""

import json

import numpy as np
import pytest
from quadrotor_flights import PLANT, noisy_flight, random_binary

from excite.errors import DesignRefused, ExciteError, SimulationStopped
from excite.types.signal import Signal
from plants.quadrotor.airframe import build_model
from plants.quadrotor.parameters import hover_command
from plants.quadrotor.plant import Quadrotor
from plants.registry import load_plant

# M1..M4: position signs (x, y) and sign of the reaction torque on the body, Crazyflie X layout
LAYOUT = [(1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)]


def test_model_follows_the_crazyflie_layout():
    model = build_model(PLANT.values)
    lever = 0.046 / np.sqrt(2)
    np.testing.assert_allclose(model.site_pos, [(x * lever, y * lever, 0) for x, y, _ in LAYOUT])
    np.testing.assert_allclose(model.actuator_gear[:, 5], [0.005964552 * turn for *_, turn in LAYOUT])
    assert hover_command(PLANT.values) == pytest.approx(36817, abs=1)


def test_hover_stays_at_hover():
    recording = PLANT.run(Signal(np.zeros((250, 3)), 0.02), noise=False)
    still = recording.columns(("p", "q", "r", "roll", "pitch", "thrust_roll", "thrust_pitch", "thrust_yaw"))
    assert not still.any()
    assert abs(recording.columns(("altitude",)) - 10.0).max() < 1e-4


def test_altitude_is_held_over_a_minute():
    recording = PLANT.run(random_binary((10, 10, 50)), seed=2)
    assert abs(recording.columns(("altitude",)) - 10.0).max() < 0.05


def test_thrust_differences_are_signed_sums_of_the_commanded_thrusts():
    recording = noisy_flight()
    motors = recording.columns(("m1", "m2", "m3", "m4"))
    np.testing.assert_array_equal(motors, np.round(motors))
    f = 2.130295e-11 * motors**2 + 1.032633e-6 * motors + 5.48456e-4
    expected = np.stack([f @ signs for signs in ((-1, -1, 1, 1), (-1, 1, 1, -1), (-1, 1, -1, 1))], axis=1)
    found = recording.columns(("thrust_roll", "thrust_pitch", "thrust_yaw"))
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_mixer_carries_half_of_roll_and_pitch_and_all_of_yaw():
    recording = noisy_flight()
    names = ("thrust_ref", "control_roll", "control_pitch", "control_yaw")
    for motor, (x, y, turn) in enumerate(LAYOUT, start=1):
        expected = recording.columns(names) @ np.array([1.0, y / 2, -x / 2, turn])
        assert abs(recording.columns((f"m{motor}",))[:, 0] - expected).max() <= 0.5 + 1e-9


def test_roll_is_right_handed_and_positive_pitch_is_nose_down():
    signal = Signal(np.repeat([[5.0, 5.0, 0.0]], 30, axis=0), 0.02)
    recording = PLANT.run(signal, noise=False)
    m1, m2, m3, m4 = recording.columns(("m1", "m2", "m3", "m4"))[0]
    assert m3 > max(m2, m4) and min(m2, m4) > m1  # rear left pushes most, front right least
    assert (recording.columns(("roll", "pitch"))[-1] > 3.0).all()


def test_recording_describes_itself():
    signal = Signal(np.zeros((30, 3)), 0.02, period=15)
    recording = PLANT.run(signal, seed=3, noise={"gyro": 0.0})
    assert recording.dt == 0.002 and len(recording.time_s) == 300 and recording.period == 150
    assert recording.loop.closed and recording.loop.entry == "set-point"
    source = json.loads(json.dumps(recording.origin.to_dict()))
    assert {name: level for name, level in source["noise"].items() if level} == {"thrust": 0.002, "attitude": 0.05}
    assert (source["plant"], source["preset"], source["seed"]) == ("quadrotor", "2013", 3)
    assert (source["inject"], source["parameters"]["mass"]) == ("attitude_setpoint", 0.0275)
    rates, attitude = recording.experiment("rates"), recording.experiment("attitude")
    assert rates.loop.closed and rates.reference.shape == (300, 3) and rates.dt == 0.002
    assert not attitude.loop.closed and attitude.dt == 0.004 and attitude.period == 75
    for data, view in ((rates, "rates"), (attitude, "attitude")):
        model = PLANT.truth(recording, view).model
        assert (data.inputs, data.outputs, data.dt) == (model.inputs, model.outputs, model.dt)


# --- noise -----------------------------------------------------------------------------------------------------------


def test_switching_one_source_off_leaves_the_others_as_they_were():
    signal = Signal(np.zeros((50, 3)), 0.02)
    silent = {"thrust": 0.0, "gyro": 0.0, "attitude": 0.0}
    first = ("p", "q", "r", "roll", "pitch")  # at row 0 the measurement is noise alone
    full = PLANT.run(signal, seed=6).columns(first)[0]
    gyro = PLANT.run(signal, seed=6, noise=silent | {"gyro": 0.0028}).columns(first)[0]
    attitude = PLANT.run(signal, seed=6, noise=silent | {"attitude": 0.05}).columns(first)[0]
    np.testing.assert_array_equal(gyro, [*full[:3], 0, 0])
    np.testing.assert_array_equal(attitude, [0, 0, 0, *full[3:]])
    np.testing.assert_array_equal(PLANT.run(signal, seed=6, noise=silent).values, PLANT.run(signal, noise=False).values)
    # row 2 is the first that thrust noise reaches, through the motor lag: the same draws with and without a gyro
    noisy, alone = (PLANT.run(signal, seed=6, noise=silent | {"thrust": 2e-3} | gyro) for gyro in ({"gyro": 1e-9}, {}))
    np.testing.assert_allclose(noisy.columns(first)[2], alone.columns(first)[2], atol=1e-8)
    assert alone.columns(first)[2].any()


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.002, 0.003, 0.006, 0.0101])
def test_signal_must_fit_the_attitude_frames(dt):
    with pytest.raises(ExciteError, match=rf"signal dt {dt:g} s .* multiple of 0.004 s"):
        PLANT.run(Signal(np.zeros((10, 3)), dt))


def test_signal_needs_three_channels():
    with pytest.raises(ExciteError, match="2 channels; give 3: roll_ref, pitch_ref, yaw_rate_ref"):
        PLANT.run(Signal(np.zeros((10, 2)), 0.02))


@pytest.mark.parametrize("channel, value, limit", [(0, 31.0, "30"), (1, -30.5, "-30"), (2, 201.0, "200")])
def test_amplitude_beyond_a_limit_is_refused(channel, value, limit):
    u = np.zeros((10, 3))
    u[5, channel] = value
    name = PLANT.injections["attitude_setpoint"].channels[channel].name
    with pytest.raises(DesignRefused, match=rf"{name}: {value:g} .* limit {limit} "):
        PLANT.run(Signal(u, 0.02))


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"mas": 0.03}, "did you mean 'mass'"),
        ({"mass": 0.0}, "must be positive"),
        ({"rate_ki": -1.0}, "at least zero"),
        ({"mass": float("nan")}, "not finite"),
        ({"mass": "heavy"}, "not a number"),
        ({"mass": 0.08}, "needs 0.1962 N per motor"),
        ({"izz": 1.0}, r"'izz': 1 kg m2; no rigid body .* ixx \+ iyy"),
        ({"hover_altitude": 0.05}, "'hover_altitude': 0.05 m"),
    ],
)
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant("quadrotor", parameters=parameters)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"inject": "atitude_setpoint"}, "did you mean 'attitude_setpoint'"),
        ({"noise": {"giro": 1.0}}, "did you mean 'gyro'"),
        ({"noise": {"gyro": -1.0}}, "at least zero"),
        ({"noise": 0.5}, "true, false"),
        ({"seed": -1}, "at least 0"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ExciteError, match=message):
        PLANT.run(Signal(np.zeros((10, 3)), 0.02), **options)


def test_unknown_preset_is_refused():
    with pytest.raises(ExciteError, match="did you mean '2013'"):
        load_plant("quadrotor", preset="2014")


@pytest.mark.parametrize(
    "parameters, noise, quantity",
    [
        ({}, {"gyro": 20.0}, "tilt"),
        ({"rate_kp": 0.0}, {}, "tilt"),
        ({"hover_altitude": 0.101}, {}, "altitude"),
        ({}, {"thrust": 300.0}, "body rate"),
    ],
)
def test_unsafe_flight_stops(parameters, noise, quantity):
    with pytest.raises(SimulationStopped, match=rf"seed 5: stopped at [\d.]+ s: {quantity} .* reduce"):
        Quadrotor(parameters=parameters).run(random_binary((10, 10, 10)), noise=noise, seed=5)


def test_wind_without_drag_is_refused():
    with pytest.raises(ExciteError, match="'gust': 1 m/s; wind acts through the drag"):
        PLANT.run(random_binary((1, 1, 1), 1.0), noise={"gust": 1.0})
