"""What the preset "outdoors" adds to the quadrotor: battery, drag and wind, sensors and estimate; and the take-off."""

import math

import numpy as np
import pytest
from quadrotor_flights import PLANT, linearisation_floor, random_binary

from excite.errors import SimulationStopped
from excite.types.signal import Signal
from plants.quadrotor.air import wind
from plants.quadrotor.arithmetic import FLOATS
from plants.quadrotor.battery import Battery
from plants.quadrotor.estimator import Mahony
from plants.quadrotor.parameters import GRAVITY
from plants.quadrotor.plant import Quadrotor

HOVER = Signal(np.zeros((2500, 3)), 0.004)  # 10 s
LEVEL = ("roll", "pitch")


def column(recording, name):
    return recording.columns((name,))[:, 0]


# --- presets ---------------------------------------------------------------------------------------------------------


def test_presets_differ_where_they_say():
    old, today, outdoors = (Quadrotor(preset).values for preset in ("2013", "today", "outdoors"))
    assert (old["rate_kp"], old["attitude_kp"], old["yaw_rate_kp"]) == (70.0, 3.5, 50.0)
    gains = [today[f"{loop}_{gain}"] for loop in ("attitude", "rate", "yaw_rate") for gain in ("kp", "ki", "kd")]
    assert gains == [6.0, 3.0, 0.0, 250.0, 500.0, 2.5, 120.0, 16.7, 0.0]
    assert {name for name in today if outdoors[name] != today[name]} == {
        "estimator_kp",
        "drag",
        "drag_height",
        "battery_slope",
        "battery_resistance",
    }


# --- battery ---------------------------------------------------------------------------------------------------------


def test_a_battery_in_hover_empties_in_the_time_of_flight():
    """250 mAh at 2.14 A last 7 minutes, over which a slope of 2.8 V/(A h) takes 0.7 V."""
    values = Quadrotor("outdoors", {"battery_resistance": 0.0}).values
    battery = Battery(values, 1.0, FLOATS)
    for _ in range(7 * 60):
        factor = battery.update(values["mass"] * GRAVITY)
    assert battery.voltage == pytest.approx(3.9 - 0.7, abs=0.01)
    assert factor == pytest.approx((battery.voltage / 3.9) ** 2)


def test_resistance_takes_voltage_with_the_power_three_halves_of_thrust():
    values = Quadrotor("outdoors", {"battery_slope": 0.0}).values
    battery = Battery(values, 0.002, FLOATS)
    battery.update(4.0 * values["mass"] * GRAVITY)
    assert battery.voltage == pytest.approx(3.9 - 0.1 * 2.14 * (4.0**1.5 - 1.0))
    assert battery.update(values["mass"] * GRAVITY) == pytest.approx(1.0)


def test_a_sagging_battery_costs_command_and_altitude():
    """The specific force is what the altitude hold asks for, g + kp (z_ref - z) - kd dz/dt, times (V / V0)^2."""
    recording = Quadrotor("outdoors", {"battery_slope": 60.0}).run(HOVER, noise=False)
    voltage, altitude = column(recording, "voltage")[1:], column(recording, "altitude")
    assert (np.diff(voltage) < 0).all() and voltage[-1] < 3.5
    asked = GRAVITY + 4.0 * (10.0 - altitude[1:]) - 4.0 * np.diff(altitude) / 0.002
    np.testing.assert_allclose(column(recording, "acc_z")[1:], asked * (voltage / 3.9) ** 2, rtol=2e-3)
    assert column(recording, "thrust_ref")[-1] > column(recording, "thrust_ref")[0] + 1000


# --- air -------------------------------------------------------------------------------------------------------------


def test_wind_is_gauss_markov_from_the_start():
    values = {"gust_tau": 0.05}
    white = np.random.default_rng(0).standard_normal((200_000, 2))
    path, pole = wind(values, white), math.exp(-0.002 / 0.05)
    np.testing.assert_array_equal(path[0], white[0])
    assert path.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.02)
    for lag in (10, 25):
        assert (path[lag:] * path[:-lag]).mean(axis=0) == pytest.approx([pole**lag] * 2, abs=0.05)


def test_a_tilted_vehicle_reaches_the_speed_at_which_drag_holds_it():
    """m g tan(tilt) = d v in level flight, up to the drag's share of the lift."""
    quick = {"drag": 0.5, "drag_height": 0.0}
    recording = Quadrotor("2013", quick).run(Signal(np.tile([0.0, 5.0, 0.0], (2000, 1)), 0.004), noise=False)
    x = column(recording, "x")
    speed = (x[-1] - x[-500]) / (499 * 0.002)
    assert speed == pytest.approx(0.0275 * GRAVITY * math.tan(math.radians(5.0)) / 0.5, rel=0.02)


def test_without_drag_speed_grows_as_gravity_says():
    """MuJoCo moves x by the tilt alone: dv/dt = g tan(tilt) at constant altitude."""
    recording = PLANT.run(Signal(np.tile([0.0, 5.0, 0.0], (1000, 1)), 0.004), noise=False)
    x, pitch = column(recording, "x"), np.radians(column(recording, "pitch"))
    velocity = np.cumsum(np.tan(pitch)) * GRAVITY * 0.002
    assert x[-1] - x[0] == pytest.approx(np.sum(velocity) * 0.002, rel=0.02)


def test_a_gust_pushes_and_turns():
    """Wind in the rotors' plane carries the vehicle along and, above the centre of mass, tilts it."""
    quiet = dict.fromkeys(PLANT.noise_sources, 0.0)
    parameters = {"estimator_kp": 0.0, "gust_tau": 1e6}  # wind that stays what it was at the start
    blown, calm = (
        Quadrotor("outdoors", parameters).run(HOVER, noise=quiet | {"gust": level}, seed=1) for level in (1.0, 0.0)
    )
    ends = np.array([column(blown, name)[-1] for name in "xy"])
    seeds = np.random.SeedSequence(1).spawn(7)  # the last of the sources
    air = np.random.default_rng(seeds[6]).standard_normal((5000, 2))[0]
    assert (np.sign(ends) == np.sign(air)).all()
    assert abs(blown.columns(LEVEL)).max() > 1e-3 and not calm.columns((*LEVEL, "x", "y")).any()


# --- sensors and estimate --------------------------------------------------------------------------------------------


def test_the_filter_follows_the_accelerometer_with_its_time_constant():
    """A vehicle at rest at 10 deg of roll: the error falls as exp(-kp t), to first order."""
    kp, tilt = 0.5, math.radians(10.0)
    estimator = Mahony(kp, 0.004, FLOATS)
    for k in range(1, 2001):
        roll, pitch = estimator.update((0.0, 0.0, 0.0), (0.0, GRAVITY * math.sin(tilt), GRAVITY * math.cos(tilt)))
        if k % 250 == 0:
            assert tilt - roll == pytest.approx(tilt * math.exp(-kp * k * 0.004), rel=0.02)
            assert pitch == pytest.approx(0.0, abs=1e-12)


def test_the_filter_integrates_the_gyro_about_any_axis():
    estimator = Mahony(1e-9, 0.004, FLOATS)
    for _ in range(250):
        roll, pitch = estimator.update((0.0, 0.3, 0.0), (0.0, 0.0, GRAVITY))
    assert (roll, pitch) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.3, rel=1e-4))


def test_the_accelerometer_reads_gravity_in_hover_and_drag_in_flight():
    recording = Quadrotor("outdoors").run(Signal(np.tile([0.0, 5.0, 0.0], (500, 1)), 0.004), noise=False)
    acc = recording.columns(("acc_x", "acc_y", "acc_z"))
    assert acc[0] == pytest.approx([0.0, 0.0, GRAVITY])
    q = recording.columns(("qw", "qx", "qy", "qz"))[-1]
    velocity = np.diff(recording.columns(("x", "y", "altitude"))[-2:], axis=0)[0] / 0.002
    forward = [1 - 2 * (q[2] ** 2 + q[3] ** 2), 2 * (q[1] * q[2] + q[0] * q[3]), 2 * (q[1] * q[3] - q[0] * q[2])]
    assert acc[-1, 0] == pytest.approx(-0.0056 / 0.034 * np.dot(forward, velocity), rel=0.01)


def test_the_estimate_drifts_from_the_attitude_as_the_bias_says():
    """Held by its own estimate, the vehicle tilts until the accelerometer's error balances the gyro's bias: b / kp."""
    quiet = dict.fromkeys(PLANT.noise_sources, 0.0)
    plant = Quadrotor("outdoors", {"drag": 0.2, "drag_height": 0.0, "estimator_kp": 4.0})
    recording = plant.run(HOVER, noise=quiet | {"gyro_bias": 0.02}, seed=3)
    bias = recording.columns(("p", "q", "r"))[-1000:].mean(axis=0)
    qw, qx, qy, qz = recording.columns(("qw", "qx", "qy", "qz")).T
    roll = np.arctan2(2 * (qw * qx + qy * qz), 1 - 2 * (qx**2 + qy**2))
    assert abs(column(recording, "roll")[-1000:]).max() < 0.05  # what the controller believes
    assert roll[-1000:].mean() == pytest.approx(-bias[0] / 4.0, rel=0.15)


def test_biases_belong_to_a_flight():
    levels = dict.fromkeys(PLANT.noise_sources, 0.0) | {"gyro_bias": 0.01, "accelerometer_bias": 0.5}
    first, again, other = (Quadrotor("today").run(HOVER, noise=levels, seed=seed) for seed in (1, 1, 2))
    rates = ("p", "q", "r")
    np.testing.assert_array_equal(first.values, again.values)
    assert (abs(first.columns(rates)[0] - other.columns(rates)[0]) > 1e-5).all()
    draws = [
        PLANT.run(Signal(np.zeros((1, 3)), 0.004), noise=levels, seed=seed).columns(rates)[0] for seed in range(200)
    ]
    assert np.std(draws) == pytest.approx(0.01, rel=0.1)


# --- take-off --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["2013", "outdoors"])
def test_the_flight_takes_off_hovers_and_plays(preset):
    plant = Quadrotor(preset, {"takeoff": 8.0})
    signal = random_binary((10, 10, 10), 4.0)
    recording = plant.run(signal, noise=False)
    start = round(recording.origin.start_s / plant.dt)
    altitude = column(recording, "altitude")
    assert start == 4000 and len(altitude) == start + 2000
    assert altitude[0] < 0.01 and altitude[:200].max() < 1.0
    assert abs(altitude[start:] - 10.0).max() < 0.4
    references = recording.columns(("roll_ref", "pitch_ref", "yaw_rate_ref"))
    assert not references[:start].any()
    np.testing.assert_array_equal(references[start:], np.repeat(signal.u, 10, axis=0))
    assert min(linearisation_floor(plant, recording, "attitude").values()) > 90.0


def test_the_ground_bears_the_vehicle_until_it_lifts():
    plant = Quadrotor(parameters={"takeoff": 40.0})
    recording = plant.run(Signal(np.zeros((1, 3)), 0.004), noise=False)
    assert column(recording, "altitude").min() > 0.005  # of 0.008


def test_a_take_off_is_whole_samples_of_the_signal():
    recording = Quadrotor(parameters={"takeoff": 3.01}).run(Signal(np.zeros((2, 3)), 0.5), noise=False)
    assert recording.origin.start_s == pytest.approx(3.5)


def test_a_take_off_that_does_not_get_up_is_stopped():
    with pytest.raises(SimulationStopped, match=r"stopped at 0\.100 s: altitude"):
        Quadrotor(parameters={"takeoff": 0.1}).run(HOVER)
