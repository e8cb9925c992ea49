"""The quadrotor's truth: published poles, MuJoCo's own linearisation, flights, innovations; telemetry; stability."""

import mujoco
import numpy as np
import pytest
import scipy.linalg as la
from quadrotor_flights import PLANT, SMALL, fit, linearisation_floor, noisy_flight, random_binary, simulated_fit
from scipy.stats import chi2

from excite.errors import ExciteError
from excite.types.origin import Origin
from excite.types.signal import Signal
from plants.conformance import check_truth
from plants.quadrotor.axes import axes, closed_axis
from plants.quadrotor.parameters import GRAVITY, hover_command
from plants.quadrotor.plant import Quadrotor

# M1..M4: position signs (x, y) and sign of the reaction torque on the body, Crazyflie X layout
LAYOUT = [(1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)]


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


@pytest.mark.parametrize(
    "inject, view, floor",
    [
        ("attitude_setpoint", "rates", 99.3),
        ("attitude_setpoint", "attitude", 99.7),
        ("attitude_setpoint", "telemetry", 99.7),
        ("rate_setpoint", "rates", 98.0),
        ("rate_setpoint", "rate_response", 99.2),
        ("motor_command", "rates", 96.0),
        ("motor_command", "motor_response", 99.1),
    ],
)
def test_small_noise_free_flight_is_the_truth(inject, view, floor):
    recording = PLANT.run(random_binary(SMALL[inject], 20.0), inject=inject, noise=False)
    fits = simulated_fit(PLANT, recording, view)
    assert fits.min() > floor
    assert list(linearisation_floor(PLANT, recording, view).values()) == pytest.approx(fits, abs=1e-6)


@pytest.mark.parametrize("inject", PLANT.injections)
@pytest.mark.parametrize("preset", ["today", "outdoors"])
def test_every_view_of_every_preset_has_the_truths_frequency_response(preset, inject):
    check_truth(Quadrotor(preset), inject)


@pytest.mark.parametrize("view", ["rates", "attitude"])
def test_one_axis_flight_at_full_amplitude_is_linear(view):
    recording = PLANT.run(random_binary((10, 0, 0), 20.0), noise=False)
    assert simulated_fit(PLANT, recording, view, [0])[0] > 99.85


@pytest.mark.parametrize(
    "amplitude, floor", [((10, 0, 0), 100.0), ((10, 10, 0), 99.6), ((10, 10, 10), 97.4), ((10, 10, 50), 87.5)]
)
def test_linearisation_floor(amplitude, floor):
    recording = PLANT.run(random_binary(amplitude), noise=False)
    excited = np.flatnonzero(amplitude)
    assert simulated_fit(PLANT, recording, "attitude", excited).mean() == pytest.approx(floor, abs=1.0)


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


@pytest.mark.parametrize(
    "preset, inject, view",
    [
        ("2013", "attitude_setpoint", "rates"),
        ("2013", "attitude_setpoint", "attitude"),
        ("2013", "rate_setpoint", "rate_response"),
        ("2013", "motor_command", "motor_response"),
        ("outdoors", "attitude_setpoint", "attitude"),
        ("outdoors", "motor_command", "rates"),
    ],
)
def test_innovations_of_the_truth_are_white_and_as_large_as_stated(preset, inject, view):
    plant, steady = Quadrotor(preset), {"gyro_bias": 0.0, "accelerometer_bias": 0.0}
    recording = plant.run(random_binary(SMALL[inject], 30.0), inject=inject, noise=steady, seed=7)
    data, model = recording.experiment(view), plant.truth(recording, view).model
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


def test_motor_response_is_that_to_a_set_point_seen_from_the_motors():
    """All responses share the loop: their poles agree, and motors that only lift turn nothing."""
    models = {name: PLANT.truth(None, name).model for name in ("attitude", "rate_response", "motor_response")}
    poles = [np.sort_complex(model.poles()) for model in models.values()]
    for other in poles[1:]:
        np.testing.assert_allclose(other, poles[0], atol=1e-8)
    lifting = models["motor_response"].frf([0.5, 5.0]) @ np.ones(4)
    assert abs(lifting).max() < 1e-12 * abs(models["motor_response"].frf([0.5, 5.0])).max()


def test_an_added_rate_moves_the_motors_by_its_gain():
    """A set-point of rate enters through the rate loop's proportional gain, half of it on each motor of an axis."""
    u = np.tile([4.0, 0.0, 0.0], (2, 1))
    recording = PLANT.run(Signal(u, 0.004), inject="rate_setpoint", noise=False)
    m = recording.columns(("m1", "m2", "m3", "m4"))[0] - round(hover_command(PLANT.values))
    assert np.abs(m - 70.0 * 4.0 / 2.0 * np.array([-1, -1, 1, 1])).max() <= 1.0
    assert recording.columns(("p_ref",))[0] == 4.0


# --- telemetry -------------------------------------------------------------------------------------------------------


def test_no_time_invariant_model_is_true_at_10_ms():
    """A set-point that steps on a frame of the log acts at once, one that steps between two frames 2 ms later."""
    answers = []
    for start in (10, 11):  # in samples of the log, 10 ms
        u = np.zeros((50, 3))
        u[round(start * 10 / 4 + 0.25) :, 0] = 5.0  # the first frame of 4 ms at or after that sample
        data = PLANT.run(Signal(u, 0.004), noise=False).experiment("telemetry")
        answers.append(data.y[start : start + 8, 0])
    assert abs(answers[0] - answers[1]).max() > 0.02 * abs(answers[0]).max()
    truth = PLANT.truth(None, "telemetry")
    assert truth.kind == "periodically time-varying" and truth.model.dt == 0.01 and truth.model.K is None


def test_telemetry_is_exact_over_the_common_period():
    slow, fast = PLANT.truth(None, "attitude").lift(5), PLANT.truth(None, "telemetry").lift(2)
    assert slow.model.dt == pytest.approx(0.02) and fast.model.dt == pytest.approx(0.02)
    np.testing.assert_allclose(fast.model.impulse(200), slow.model.impulse(200), atol=1e-11)
    np.testing.assert_allclose(np.sort_complex(fast.poles), np.sort_complex(slow.poles), atol=1e-9)


def test_telemetry_refuses_a_loop_without_square_root():
    wild = Quadrotor(parameters={"ixx": 1e-13, "iyy": 1e-13, "izz": 1e-13})
    poles = la.eigvals(closed_axis(axes(wild.values)[0], wild.values, dict.fromkeys(wild.noise_sources, 0.0)).A)
    assert ((poles.real < -1.0) & (poles.imag == 0)).any()
    with pytest.raises(ExciteError, match=r"'telemetry': .* use view 'attitude'"):
        wild.truth(None, "telemetry")


# --- stability -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parameters, loop",
    [
        ({"attitude_kp": 60.0}, "roll"),
        ({"motor_tau": 5.0}, "roll"),
        ({"altitude_kp": 100.0, "altitude_kd": 0.0}, "altitude"),
        ({"ixx": 1e-13, "iyy": 1e-13, "izz": 1e-13}, "roll"),
        ({"izz": 1e-10, "ixx": 1e-5, "iyy": 1e-5}, "yaw"),
    ],
)
def test_an_unstable_loop_is_refused_before_the_flight(parameters, loop):
    plant, signal = Quadrotor(parameters=parameters), random_binary((1, 1, 1), 1.0)
    for fly in (lambda: plant.run(signal), lambda: plant.run_many(signal, seeds=[0])):
        with pytest.raises(ExciteError, match=rf"the {loop} loop is not internally stable: pole .* lower the gains"):
            fly()


def test_the_limit_of_stability_is_that_of_the_equations():
    """Around rate feedback K through the lag tau, an attitude gain is stable below 1 / tau: s^3 tau + s^2 + K s + K kp.

    Sampling adds a delay of a step to the lag, and half a frame to the attitude loop.
    """
    limit = 1.0 / 0.05
    for share, stable in ((0.9, True), (1.0, False)):
        plant = Quadrotor(parameters={"attitude_ki": 0.0, "rate_kp": 5.0, "attitude_kp": share * limit})
        if stable:
            plant.run(random_binary((1, 1, 1), 0.5))
        else:
            with pytest.raises(ExciteError, match="roll loop"):
                plant.run(random_binary((1, 1, 1), 0.5))


def test_integrators_may_fly():
    Quadrotor(parameters={"altitude_kp": 0.0, "altitude_kd": 0.0, "yaw_rate_ki": 0.0}).run(
        random_binary((1, 1, 1), 0.5)
    )


def test_truth_refuses_unknown_view_and_foreign_recording():
    with pytest.raises(ExciteError, match="did you mean 'rates'"):
        PLANT.truth(None, "rate")
    foreign = noisy_flight().__class__(time_s=[0.0, 1.0], values=[[0.0], [1.0]], channels=("x",), origin=Origin("x"))
    with pytest.raises(ExciteError, match="recording is of 'x'"):
        PLANT.truth(foreign, "rates")
