"""The example systems of the sources against their definition as plain arrays, and the classics against mechanics."""

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from excite.errors import ExciteError
from excite.types.signal import Signal
from plants import conformance as checks
from plants.linear.lti import lti
from plants.linear.textbook import (
    arx_bias,
    delay_process,
    etfe_transient,
    inverted_pendulum,
    mercere_closed,
    mercere_open,
    miller_31,
    miller_41,
    miller_51,
    two_mass_spring,
)
from plants.registry import load_plant

BURNT = 150  # samples after which what a case did before its record has died out: 0.81^150 = 1e-14


def played(plant, u, inject=None, **options):
    """Return u and y of the "plant" view for given samples."""
    return plant.run(Signal(u, plant.dt), inject=inject, **options).experiment("plant")


def noise_of(plant, samples, seed=0, inject=None):
    channels = len(plant.injections[inject or next(iter(plant.injections))].channels)
    return played(plant, np.zeros((samples, channels)), inject, seed=seed)


def covariance(v, lags):
    return np.array([v[lag:] @ v[: len(v) - lag] / len(v) for lag in range(lags)])


def test_miller_31_is_the_case(cases):
    _, clean = cases.miller_31(0)
    np.testing.assert_allclose(played(miller_31(), np.ones((150, 1)), noise=False).y, clean, atol=1e-12)
    v = noise_of(miller_31(), 100_000).y
    np.testing.assert_allclose(v.T @ v / len(v), 0.003 * np.eye(2), atol=0.003 * 0.02)
    assert abs(covariance(v[:, 0], 2)[1]) < 0.003 * 0.02


def test_miller_41_is_the_case(cases):
    u, y = cases.miller_41(3, 2000)
    rng = np.random.default_rng(3)
    w = [rng.standard_normal((2200, width)) for width in (1, 2, 1)][2][200:]  # what the case adds to the output
    np.testing.assert_allclose(played(miller_41(), u, noise=False).y[BURNT:], (y - w)[BURNT:], atol=1e-10)


def test_miller_41_has_the_printed_noise():
    """White: e of covariance 0.1 I on the states and w of variance 1; coloured: C_v (q - A_v)^-1 B_v e_v."""
    A, C = np.array(miller_41().values["A"]), np.array(miller_41().values["C"])
    P = la.solve_discrete_lyapunov(A, 0.1 * np.eye(2))
    expected = [(C @ P @ C.T).item() + 1, *((C @ np.linalg.matrix_power(A, lag) @ P @ C.T).item() for lag in (1, 2, 3))]
    v = noise_of(miller_41(), 400_000).y[:, 0]
    np.testing.assert_allclose(covariance(v, 4), expected, atol=0.02 * expected[0])
    h = lfilter(
        [0, 0, 0.05], [1, -1.8, 0.85], np.eye(1, 400)[0]
    )  # C_v (z I - A_v)^-1 B_v = 0.2 * 0.25 / ((z - 0.9)^2 + 0.04)
    v = noise_of(miller_41("coloured"), 400_000).y[:, 0]
    np.testing.assert_allclose(covariance(v, 4), covariance(h, 4) * len(h), rtol=0.05)


def test_miller_51_is_the_case(cases):
    u, y, clean = cases.miller_51(1, N=100_000)
    plant = miller_51()
    np.testing.assert_allclose(
        played(plant, u[:2000, None] / 10, noise=False).y[BURNT:, 0] * 10, clean[BURNT:2000], atol=1e-9
    )
    v = noise_of(plant, 200_000).y[:, 0]
    np.testing.assert_allclose(covariance(v, 4), covariance(y - clean, 4), atol=0.03 * (y - clean).var())
    w = np.random.default_rng(0).standard_normal((200_000, 1))
    data = played(plant, w, "filtered_input", noise=False)
    np.testing.assert_allclose(covariance(data.u[:, 0], 4), covariance(u, 4), atol=0.03 * u.var())
    np.testing.assert_allclose(played(plant, data.u, noise=False).y, data.y, atol=1e-9)


def test_mercere_open_is_the_case(cases):
    u, y, clean = cases.mercere_open(2, N=20_000)
    plant = mercere_open()
    assert plant.dt == 1.0
    np.testing.assert_allclose(played(plant, u[:, None], noise=False).y[:, 0], clean, atol=1e-10)
    v = noise_of(plant, 200_000).y[:, 0]
    np.testing.assert_allclose(covariance(v, 3), covariance(y - clean, 3), atol=0.04 * 6.705)
    model = plant.truth(None, "plant").model
    assert model.K.item() == pytest.approx(-0.0580) and model.innovation_cov.item() == pytest.approx(6.705)


def test_mercere_closed_is_the_case(cases):
    """The printed r(k) acts at k-1: the case's r, moved one sample earlier, is the reference of the diagram.

    Two runs of the case that differ in the size of r alone differ by the noise-free answer to r.
    """
    plant = mercere_closed()
    u, y, z, r = cases.mercere_closed(4)
    np.testing.assert_allclose(plant.truth(None, "plant").model.simulate(u[:, None])[:, 0], z, atol=1e-10)
    u0, y0, _, _ = cases.mercere_closed(4, r_std=1e-300)
    shifted = np.append(r[1:], 0.0)
    shifted[0] = 0.0  # the printed loop starts at its third sample
    data = plant.run(Signal(shifted[:, None], 1.0), inject="plant_input", noise=False).experiment("plant")
    np.testing.assert_allclose(data.y[:, 0], y - y0, atol=1e-10)
    np.testing.assert_allclose(data.u[1:-1, 0], (u - u0)[1:-1], atol=1e-10)
    assert data.loop.controller.D.item() == 0.5 and data.loop.sign == -1 and data.loop.entry == "plant input"


def test_mercere_closed_has_the_noise_of_the_case(cases):
    _, y, _, _ = cases.mercere_closed(0, N=60_000, r_std=1e-300)
    v = noise_of(mercere_closed(), 400_000, inject="plant_input").y[:, 0]
    np.testing.assert_allclose(covariance(v, 4), covariance(y, 4), atol=0.05 * y.var())


def test_arx_bias_follows_its_difference_equation():
    """H = 1/A: y(k) = 0.8 y(k-1) + u(k-1) + e(k), e white; H = 1: the same but for the noise, which is white at y."""
    u = np.random.default_rng(0).standard_normal((20_000, 1))
    data = played(arx_bias("equation_error"), u, seed=1)
    e = data.y[1:, 0] - 0.8 * data.y[:-1, 0] - data.u[:-1, 0]
    assert e.std() == pytest.approx(0.5, rel=0.02) and abs(covariance(e, 2)[1]) < 0.01
    data, clean = (played(arx_bias(), u, seed=1, noise=noise).y[:, 0] for noise in (True, False))
    np.testing.assert_allclose(clean[1:], 0.8 * clean[:-1] + u[:-1, 0], atol=1e-12)
    assert (data - clean).std() == pytest.approx(0.5, rel=0.02) and abs(covariance(data - clean, 2)[1]) < 0.01


def test_least_squares_is_biased_where_the_notes_say():
    """Zaffalon and Hofmann (2024), 5.2.2: regression on measured y is biased for H = 1 and not for H = 1/A."""
    u = np.random.default_rng(0).choice([-1.0, 1.0], (50_000, 1))
    found = {}
    for preset in ("output_error", "equation_error"):
        data = played(arx_bias(preset), u)
        found[preset] = np.linalg.lstsq(np.hstack([data.y[:-1], data.u[:-1]]), data.y[1:, 0])[0]
    np.testing.assert_allclose(found["equation_error"], [0.8, 1.0], atol=0.01)
    assert found["output_error"][0] < 0.77  # towards zero: the noise adds to the regressor's power


def test_the_transient_bias_of_the_etfe_falls_with_the_periods():
    """Zaffalon and Hofmann (2024), 3.2.1: without noise, the error of the mean over m periods from rest falls as 1/m."""
    M, plant = 128, etfe_transient()
    u = np.tile(np.random.default_rng(1).choice([-1.0, 1.0], M), 16)[:, None]
    y = played(plant, u, noise=False).y[:, 0].reshape(16, M)
    k = np.arange(1, M // 2)
    G = plant.truth(None, "plant").model.frf(k / M)[:, 0, 0]
    error = [np.linalg.norm((np.fft.fft(y[:m].mean(0)) / np.fft.fft(u[:M, 0]))[k] - G) for m in (1, 4, 16)]
    np.testing.assert_allclose(np.array(error[:2]) / error[1:], 4, rtol=0.05)


def test_two_masses_move_as_mechanics_says():
    plant = two_mass_spring()
    p, u = plant.values, np.random.default_rng(0).choice([-1.0, 1.0], (30, 1))

    def rates(t, x):
        spring = p["stiffness"] * (x[0] - x[2]) + p["damping"] * (x[1] - x[3])
        push = u[min(int(t / plant.dt), 29), 0] - p["friction"] * x[1] - spring
        return [x[1], push / p["mass_1"], x[3], spring / p["mass_2"]]

    x, expected = np.zeros(4), []
    for k in range(30):
        expected.append(x[[0, 2]])
        span = (k * plant.dt, (k + 1) * plant.dt)
        x = solve_ivp(lambda t, x, k=k: rates((k + 0.5) * plant.dt, x), span, x, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(played(plant, u, noise=False).y, expected, atol=1e-8)


def test_the_pendulum_has_the_tutorials_poles_and_only_a_closed_loop():
    """Poles -5.6041, -0.1428, 5.5651 and 0 rad/s: Control Tutorials for MATLAB and Simulink, Inverted pendulum."""
    plant = inverted_pendulum()
    s = np.log(plant.truth(None, "plant").poles.astype(complex)) / plant.dt
    np.testing.assert_allclose(np.sort(s.real), [-5.6041, -0.1428, 0, 5.5651], atol=1e-4)
    assert set(plant.injections) == {"setpoint", "plant_input"}
    recording = plant.run(Signal(np.tile([0.1, 0.0], (1000, 1)), plant.dt), noise=False)
    np.testing.assert_allclose(
        recording.columns(("position", "angle"))[-1], [0.1, 0], atol=1e-3
    )  # it follows its set-point


def test_dead_time_delays_exactly():
    """A unit step gives gain (1 - exp(-(t - delay)/tau)) after the delay, for whole and broken numbers of samples."""
    t = np.arange(60.0)
    for delay in (0.0, 0.3, 4.0, 4.5):
        plant = delay_process(parameters={"delay": delay, "gain": -3.0})
        expected = -3.0 * np.where(t > delay, 1 - np.exp(-(t - delay) / 10.0), 0.0)
        np.testing.assert_allclose(played(plant, np.ones((60, 1)), noise=False).y[:, 0], expected, atol=1e-12)
        np.testing.assert_allclose(plant.truth(None, "plant").poles, np.exp(-0.1), atol=1e-12)  # delays are not judged
    with pytest.raises(ExciteError, match=r"delay_process parameter 'delay': .* over 1000 samples"):
        delay_process(parameters={"delay": 1e9})


@pytest.mark.parametrize("plant, preset", [(p, preset) for p in (lti, miller_41, arx_bias) for preset in p.presets])
def test_every_preset_conforms(plant, preset):
    built = load_plant(plant.name, preset=preset)
    for place in built.injections:
        for check in checks.checks_of(built):
            check(built, place)


@pytest.mark.parametrize("name", ["miller_51", "mercere_closed", "inverted_pendulum", "two_mass_spring", "miller_41"])
def test_the_truth_predicts_with_the_covariance_it_states(name):
    """One-step errors of the truth on a noisy run are white, of the stated covariance."""
    plant = load_plant(name)
    size = 1e-3 * np.array([high for _, high in next(iter(plant.injections.values())).limits])
    u = size * np.random.default_rng(0).choice([-1.0, 1.0], (20_000, len(size)))
    recording = plant.run(Signal(u, plant.dt), seed=5)
    for view in plant.views:
        if view not in recording.views:
            continue
        data, model = recording.experiment(view), plant.truth(recording, view).model
        e = (data.y - model.predict(data))[500:]
        np.testing.assert_allclose(e.T @ e / len(e), model.innovation_cov, atol=0.06 * model.innovation_cov.max())
        correlation = np.abs(e[1:].T @ e[:-1] / len(e)) / np.outer(e.std(0), e.std(0))
        assert correlation.max() < 0.04, (view, correlation)
