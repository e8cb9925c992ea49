"""The quadrotor: truth against published poles, MuJoCo's own linearisation and flights; noise; limits; safety stop."""

import json
from functools import cache

import mujoco
import numpy as np
import pytest
import scipy.linalg as la
from scipy.stats import chi2

from excite.errors import DesignRefused, ExciteError, SimulationStopped
from excite.types.signal import Signal
from plants.plant import load_plant
from plants.quadrotor.parameters import GRAVITY, hover_command
from plants.quadrotor.plant import Quadrotor, build_model

PLANT = load_plant("quadrotor")
# M1..M4: position signs (x, y) and sign of the reaction torque on the body, Crazyflie X layout
LAYOUT = [(1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)]


def random_binary(amplitude, duration_s=60.0, dt=0.02, seed=1):
    """Random binary set-points with chips of 0.5 s."""
    chips = np.random.default_rng(seed).choice([-1.0, 1.0], (round(duration_s / 0.5), 3))
    return Signal(np.repeat(chips * np.array(amplitude, float), round(0.5 / dt), axis=0), dt)


def fit(y, simulated):
    """Fit per output, 100 (1 - |y - yhat| / |y - mean|)."""
    return 100.0 * (1.0 - np.linalg.norm(y - simulated, axis=0) / np.linalg.norm(y - y.mean(0), axis=0))


@cache
def noisy_flight():
    return PLANT.run(random_binary((1, 1, 1)), seed=7)


def simulated_fit(recording, setting, outputs=slice(None)):
    data = recording.experiment(setting)
    return fit(data.y[:, outputs], PLANT.truth(recording, setting).model.simulate(data.u)[:, outputs])


# --- truth -----------------------------------------------------------------------------------------------------------


def continuous(A, dt):
    """Sorted (rad/s, damping) of discrete poles."""
    s = np.log(la.eigvals(A).astype(complex)) / dt
    return sorted(zip(abs(s), -s.real / abs(s), strict=True))


def test_closed_loop_poles_match_the_published_roll_and_yaw_rate_loops():
    model = PLANT.truth(None, "attitude").model
    roll, pitch, yaw = (continuous(model.A[b, b], model.dt) for b in (slice(0, 4), slice(4, 8), slice(8, 11)))
    for axis in (roll, pitch):
        np.testing.assert_allclose(axis, [(0.71, 1), (3.03, 1), (27.5, 0.27), (27.5, 0.27)], rtol=0.02)
    np.testing.assert_allclose(yaw, [(0.55, 1), (10.5, 0.91), (10.5, 0.91)], rtol=0.01)
    assert model.order == 11
    np.testing.assert_allclose(np.diag(model.frf([1e-6])[0]), 1.0, atol=1e-3)  # integral action


def test_rates_truth_is_mujocos_own_transition_matrix_at_hover():
    model, values = PLANT.model, PLANT.values
    data = mujoco.MjData(model)
    hover = values["mass"] * GRAVITY / 4.0
    data.act[:] = data.ctrl[:] = hover
    nx = 2 * model.nv + model.na
    A, B = np.zeros((nx, nx)), np.zeros((nx, model.nu))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
    # four motors reach the three axes through signed sums; the pseudo-inverse of the sums spreads a difference evenly
    sums = np.array([[y, -x, turn] for x, y, turn in LAYOUT], float).T
    spread = np.linalg.pinv(sums)
    omega, act = slice(9, 12), slice(12, 16)
    found_A = np.block([[A[omega, omega], A[omega, act] @ spread], [sums @ A[act, omega], sums @ A[act, act] @ spread]])
    found_B = np.vstack([B[omega] @ spread, sums @ B[act] @ spread])
    truth = PLANT.truth(None, "rates").model
    order = [0, 2, 4, 1, 3, 5]  # ours is (rate, thrust) per axis
    np.testing.assert_allclose(found_A, truth.A[np.ix_(order, order)], atol=1e-7)
    np.testing.assert_allclose(found_B, truth.B[order], atol=1e-7)
    assert np.exp(-0.002 / 0.05) == pytest.approx(truth.A[1, 1], rel=1e-15)


def test_model_follows_the_crazyflie_layout():
    model = build_model(PLANT.values)
    lever = 0.046 / np.sqrt(2)
    np.testing.assert_allclose(model.site_pos, [(x * lever, y * lever, 0) for x, y, _ in LAYOUT])
    np.testing.assert_allclose(model.actuator_gear[:, 5], [0.005964552 * turn for *_, turn in LAYOUT])
    assert hover_command(PLANT.values) == pytest.approx(36817, abs=1)


@pytest.mark.parametrize("setting", ["rates", "attitude"])
def test_small_noise_free_flight_is_the_truth(setting):
    recording = PLANT.run(random_binary((0.5, 0.5, 0.5), 20.0), noise=False)
    assert simulated_fit(recording, setting).min() > 99.3  # reached: rates 99.43, attitude 99.82


@pytest.mark.parametrize("setting", ["rates", "attitude"])
def test_one_axis_flight_at_full_amplitude_is_linear(setting):
    recording = PLANT.run(random_binary((10, 0, 0), 20.0), noise=False)
    assert simulated_fit(recording, setting, [0])[0] > 99.85


@pytest.mark.parametrize(
    "amplitude, floor", [((10, 0, 0), 100.0), ((10, 10, 0), 99.6), ((10, 10, 10), 97.4), ((10, 10, 50), 87.5)]
)
def test_linearisation_floor(amplitude, floor):
    recording = PLANT.run(random_binary(amplitude), noise=False)
    excited = np.flatnonzero(amplitude)
    assert simulated_fit(recording, "attitude", excited).mean() == pytest.approx(floor, abs=1.0)


@pytest.mark.parametrize(
    "gains", [{"rate_ki": 500.0, "rate_kd": 1.0}, {"attitude_kd": 0.1, "yaw_rate_kd": 0.5}, {"yaw_rate_ki": 0.0}]
)
def test_truth_follows_every_gain(gains):
    plant = Quadrotor(parameters=gains)
    recording = plant.run(random_binary((0.5, 0.5, 2.0), 10.0), noise=False)
    data = recording.experiment("attitude")
    assert fit(data.y, plant.truth(recording, "attitude").model.simulate(data.u)).min() > 99.0
    # the truth belongs to the recording, whoever is asked
    np.testing.assert_array_equal(
        PLANT.truth(recording, "attitude").model.A, plant.truth(recording, "attitude").model.A
    )


@pytest.mark.parametrize("setting", ["rates", "attitude"])
def test_innovations_of_the_truth_are_white_and_as_large_as_stated(setting):
    recording = noisy_flight()
    data, model = recording.experiment(setting), PLANT.truth(recording, setting).model
    innovations = data.y - model.predict(data)
    count, lags = len(innovations), 30
    variance = innovations.var(0)
    correlation = np.array([(innovations[k:] * innovations[:-k]).mean(0) for k in range(1, lags + 1)]) / variance
    assert (count * (correlation**2).sum(0) < chi2.ppf(0.999, lags)).all()
    stated = np.diag(model.innovation_cov)
    assert (abs(variance / stated - 1.0) < 4.0 * np.sqrt(2.0 / count)).all()
    cross = np.corrcoef(innovations.T)[np.triu_indices(3, 1)]
    assert (abs(cross) < 4.0 / np.sqrt(count)).all()


def test_rates_predictor_is_strictly_stable_and_solves_the_riccati_equation():
    truth = PLANT.truth(None, "rates")
    model = truth.model
    radius = abs(la.eigvals(model.A - model.K @ model.C)).max()
    assert radius < 0.97
    assert truth.parameters["predictor_spectral_radius"][0] == pytest.approx(radius)
    noise = {name: parameter.value for name, parameter in PLANT.noise_sources.items()}
    Q, R = 4.0 * noise["thrust"] ** 2 * model.B @ model.B.T, noise["gyro"] ** 2 * np.eye(3)
    P = la.solve_discrete_are(model.A.T, model.C.T, Q, R)
    np.testing.assert_allclose(model.innovation_cov, model.C @ P @ model.C.T + R, rtol=1e-9, atol=1e-18)
    K = model.A @ P @ model.C.T @ la.inv(model.innovation_cov)
    np.testing.assert_allclose(model.K, K, rtol=1e-8, atol=1e-12)


def test_attitude_predictor_keeps_the_integrators_and_forgets_the_rest():
    model = PLANT.truth(None, "attitude").model
    radii = np.sort(abs(la.eigvals(model.A - model.K @ model.C)))
    np.testing.assert_allclose(radii[-2:], 1.0, atol=1e-9)
    assert radii[-3] < 1.0 and radii[-4] < 0.92


def test_truth_without_output_noise_has_no_predictor():
    quiet = PLANT.run(random_binary((1, 1, 1), 0.5), noise=False)
    assert PLANT.truth(quiet, "rates").model.K is None
    assert PLANT.truth(quiet, "attitude").model.K is None


def test_truth_refuses_unknown_setting_and_foreign_recording():
    with pytest.raises(ExciteError, match="did you mean 'rates'"):
        PLANT.truth(None, "rate")
    foreign = noisy_flight().__class__(time_s=[0.0, 1.0], values=[[0.0], [1.0]], channels=("x",), source={"plant": "x"})
    with pytest.raises(ExciteError, match="recording is of 'x'"):
        PLANT.truth(foreign, "rates")


# --- flights ---------------------------------------------------------------------------------------------------------


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
    source = json.loads(json.dumps(dict(recording.source)))
    assert source["noise"] == {"thrust": 0.002, "gyro": 0.0, "attitude": 0.05}
    assert (source["plant"], source["preset"], source["seed"]) == ("quadrotor", "2013", 3)
    assert (source["inject"], source["parameters"]["mass"]) == ("attitude_setpoint", 0.0275)
    rates, attitude = recording.experiment("rates"), recording.experiment("attitude")
    assert rates.loop.closed and rates.reference.shape == (300, 3) and rates.dt == 0.002
    assert not attitude.loop.closed and attitude.dt == 0.004 and attitude.period == 75
    for data, setting in ((rates, "rates"), (attitude, "attitude")):
        model = PLANT.truth(recording, setting).model
        assert (data.inputs, data.outputs, data.dt) == (model.inputs, model.outputs, model.dt)


# --- noise and seeds -------------------------------------------------------------------------------------------------


def test_a_seed_gives_the_same_bits_and_another_does_not():
    signal = random_binary((5, 5, 5), 2.0)
    a, b, c = PLANT.run_many(signal, seeds=[4, 4, 5])
    np.testing.assert_array_equal(a.values, b.values)
    assert not np.array_equal(a.values, c.values)
    quiet = [PLANT.run(signal, seed=seed, noise=False).values for seed in (4, 5)]
    np.testing.assert_array_equal(*quiet)


def test_switching_one_source_off_leaves_the_others_as_they_were():
    signal = Signal(np.zeros((50, 3)), 0.02)
    silent = {"thrust": 0.0, "gyro": 0.0, "attitude": 0.0}
    first = ("p", "q", "r", "roll", "pitch")  # at row 0 the measurement is noise alone
    full = PLANT.run(signal, seed=6).columns(first)[0]
    gyro = PLANT.run(signal, seed=6, noise=silent | {"gyro": 0.0028}).columns(first)[0]
    attitude = PLANT.run(signal, seed=6, noise=silent | {"attitude": 0.05}).columns(first)[0]
    np.testing.assert_array_equal(gyro, [*full[:3], 0, 0])
    np.testing.assert_array_equal(attitude, [0, 0, 0, *full[3:]])
    np.testing.assert_array_equal(
        PLANT.run(signal, seed=6, noise=silent).values, PLANT.run(signal, noise=False).values
    )
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


@pytest.mark.parametrize("parameters, message", [
    ({"mas": 0.03}, "did you mean 'mass'"),
    ({"mass": 0.0}, "must be positive"),
    ({"rate_ki": -1.0}, "at least zero"),
    ({"mass": float("nan")}, "not finite"),
    ({"mass": "heavy"}, "not a number"),
    ({"mass": 0.08}, "needs 0.1962 N per motor"),
    ({"izz": 1.0}, "MuJoCo refuses"),
])  # fmt: skip
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant("quadrotor", parameters=parameters)


@pytest.mark.parametrize("options, message", [
    ({"inject": "atitude_setpoint"}, "did you mean 'attitude_setpoint'"),
    ({"noise": {"giro": 1.0}}, "did you mean 'gyro'"),
    ({"noise": {"gyro": -1.0}}, "at least zero"),
    ({"noise": 0.5}, "true, false"),
    ({"seed": -1}, "at least 0"),
])  # fmt: skip
def test_bad_options_are_refused(options, message):
    with pytest.raises(ExciteError, match=message):
        PLANT.run(Signal(np.zeros((10, 3)), 0.02), **options)


def test_unknown_preset_is_refused():
    with pytest.raises(ExciteError, match="did you mean '2013'"):
        load_plant("quadrotor", preset="2014")


@pytest.mark.parametrize("parameters, quantity", [
    ({"attitude_kp": 60.0}, "tilt"),
    ({"motor_tau": 5.0}, "tilt"),
    ({"altitude_kp": 100.0, "altitude_kd": 0.0}, "altitude"),
    ({"ixx": 1e-13, "iyy": 1e-13, "izz": 1e-13}, "tilt"),
    ({"izz": 1e-10, "ixx": 1e-5, "iyy": 1e-5}, "body rate"),
])  # fmt: skip
def test_unsafe_flight_stops(parameters, quantity):
    with pytest.raises(SimulationStopped, match=rf"stopped at [\d.]+ s: {quantity} .* reduce"):
        Quadrotor(parameters=parameters).run(random_binary((10, 10, 10)))
