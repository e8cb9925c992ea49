"""Fast exact simulation against scipy.signal.dlsim and plain loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import dlsim

from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import LONG, divide, fir, markov, rational, recurrence, simulate
from excite.types.experiment import Experiment


def random_system(rng, n, nu, ny, radius):
    A = rng.standard_normal((n, n))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.standard_normal((n, nu)), rng.standard_normal((ny, n)), rng.standard_normal((ny, nu))


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 13) | st.just(50),
    nu=st.integers(1, 4),
    ny=st.integers(1, 5),
    samples=st.integers(1, 1200),
    radius=st.sampled_from([0.3, 0.9, 1.0, 1.01]),
)
def test_simulation_equals_dlsim(seed, n, nu, ny, samples, radius):
    rng = np.random.default_rng(seed)
    A, B, C, D = random_system(rng, n, nu, ny, radius)
    u, x0 = rng.standard_normal((samples, nu)), rng.standard_normal(n)
    expected = dlsim((A, B, C, D, 1), u, x0=x0)[1]
    y = simulate(A, B, C, D, u, x0)
    assert np.abs(y - expected).max() <= 1e-11 * max(np.abs(expected).max(), 1)


def test_defective_integrators_stay_exact():
    A = np.array([[1, 0.01, 0], [0, 1, 0.01], [0, 0, 1.0]])  # one Jordan block at 1: no modal form exists
    B, C = np.array([[0], [0], [1.0]]), np.array([[1.0, 0, 0]])
    u = np.random.default_rng(1).standard_normal((50_000, 1))
    expected = dlsim((A, B, C, np.zeros((1, 1)), 1), u)[1]
    y = simulate(A, B, C, np.zeros((1, 1)), u)
    assert np.abs(y - expected).max() <= 1e-11 * np.abs(expected).max()


def test_many_samples_cost_no_python_step_each():
    A, B, C, D = random_system(np.random.default_rng(2), 6, 3, 3, 0.95)
    u = np.random.default_rng(3).standard_normal((100_000, 3))
    counted = []

    class Counting(np.ndarray):
        def __getitem__(self, key):
            counted.append(key)
            return super().__getitem__(key)

    simulate(A, B, C, D, u.view(Counting))
    assert len(counted) < 1000


def test_no_states_is_a_static_gain():
    u = np.arange(6.0).reshape(3, 2)
    y = simulate(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.array([[2.0, 1.0]]), u)
    np.testing.assert_array_equal(y, u @ [[2.0], [1.0]])


def test_markov_parameters_are_the_response_to_impulses():
    A, B, C, D = random_system(np.random.default_rng(4), 5, 2, 3, 0.9)
    h = markov(A, B, C, D, 40)
    for j in range(2):
        impulse = np.zeros((40, 2))
        impulse[0, j] = 1
        np.testing.assert_allclose(h[:, :, j], simulate(A, B, C, D, impulse), atol=1e-12)


def test_fir_equals_direct_sum():
    rng = np.random.default_rng(5)
    h, u = rng.standard_normal((7, 2, 3)), rng.standard_normal((50, 3))
    expected = [sum(h[i] @ u[t - i] for i in range(min(7, t + 1))) for t in range(50)]
    np.testing.assert_allclose(fir(h, u), expected, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 9) | st.sampled_from([LONG, LONG + 1, 300]),
    samples=st.integers(1, 400),
    nu=st.integers(0, 3),
)
def test_short_and_long_fir_equal_the_direct_sum(seed, count, samples, nu):
    rng = np.random.default_rng(seed)
    h, u = rng.standard_normal((count, 2, nu)), rng.standard_normal((samples, nu))
    expected = [np.convolve(h[:, i, j], u[:, j])[:samples] for i in range(2) for j in range(nu)]
    expected = np.reshape(expected, (2, nu, samples)).sum(1).T
    np.testing.assert_allclose(fir(h, u), expected, atol=1e-11)


def test_a_long_fir_keeps_small_outputs_beside_large_ones():
    rng = np.random.default_rng(0)
    h, u = rng.standard_normal((200, 2, 2)), rng.standard_normal((3000, 2))
    scaled = fir(h * [[[1e9], [1.0]]] / [1.0, 1e6], u * [1.0, 1e6])
    np.testing.assert_allclose(scaled / [1e9, 1.0], fir(h, u), atol=1e-11)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    lags=st.integers(0, 5) | st.sampled_from([20, 90]),
    samples=st.integers(1, 500),
    ny=st.integers(1, 3),
)
def test_division_by_a_polynomial_matrix_undoes_its_product(seed, lags, samples, ny):
    rng = np.random.default_rng(seed)
    a = rng.uniform(-0.5, 0.5, (lags, ny, ny)) / max(lags * ny, 1)  # stable: row sums of moduli below 1
    a = np.concatenate([np.eye(ny)[None], a])
    y = rng.standard_normal((samples, ny))
    np.testing.assert_allclose(divide(a, fir(a, y)), y, atol=1e-10)
    np.testing.assert_allclose(fir(a, divide(a, y)), y, atol=1e-10)


def test_a_rational_filter_goes_on_from_its_state():
    rng = np.random.default_rng(1)
    b, a, u = np.array([1.0, 0.3, 0.2]), np.array([1.0, -0.8]), rng.standard_normal(50)
    whole = rational(b, a, u)[0]
    first, state = rational(b, a, u[:20])
    np.testing.assert_allclose(np.r_[first, rational(b, a, u[20:], state)[0]], whole, atol=1e-14)
    pulse = rational(b, a, 0 * u, np.array([2.0, 3.0]))[0]  # the state adds to the right side of the first samples
    np.testing.assert_allclose(pulse, rational(np.array([2.0, 3.0]), a, np.eye(50)[0])[0], atol=1e-14)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), steps=st.integers(0, 300))
def test_a_recurrence_with_any_decays_equals_the_loop(seed, steps):
    rng = np.random.default_rng(seed)
    decay, drive, x = rng.uniform(-1, 1, (steps, 2, 1)), rng.standard_normal((steps, 2, 3)), rng.standard_normal((2, 3))
    decay[rng.random(steps) < 0.1] = 0
    for k, found in enumerate(recurrence(decay, drive, x)):
        np.testing.assert_allclose(found, x, atol=1e-12)
        x = decay[k] * x + drive[k] if k < steps else x
    assert k == steps


@pytest.mark.parametrize("horizon", [1, 2, 7, 250])
def test_prediction_equals_its_definition(horizon):
    rng = np.random.default_rng(6)
    A, B, C, D = random_system(rng, 3, 2, 2, 0.95)
    K = 0.1 * rng.standard_normal((3, 2))
    model = StateSpaceModel(A, B, C, D, 0.1, K=K)
    data, x0 = Experiment(rng.standard_normal((200, 2)), rng.standard_normal((200, 2)), dt=0.1), rng.standard_normal(3)
    x = [x0]
    for u, y in zip(data.u, data.y, strict=True):
        x.append(A @ x[-1] + B @ u + K @ (y - C @ x[-1] - D @ u))
    for t, predicted in enumerate(model.predict(data, horizon, x0)):
        start = max(t - horizon + 1, 0)
        z = x[start]
        for u in data.u[start:t]:
            z = A @ z + B @ u
        np.testing.assert_allclose(predicted, C @ z + D @ data.u[t], atol=1e-9)


def test_lifting_is_exact_for_held_inputs_and_its_predictor_is_optimal():
    A, C, K = np.diag([0.95, 0.8]), np.ones((1, 2)), np.array([[0.3], [0.2]])
    model = StateSpaceModel(A, np.ones((2, 1)), C, [[0]], 0.1, K=K, innovation_cov=[[2.0]])
    lifted, rng = model.lift(5), np.random.default_rng(7)
    u = np.repeat(rng.standard_normal((20_000, 1)), 5, axis=0)
    np.testing.assert_allclose(lifted.simulate(u[::5]), model.simulate(u)[::5], atol=1e-10)
    noise = simulate(A, K, C, np.eye(1), np.sqrt(2) * rng.standard_normal((len(u), 1)))
    data = Experiment(u, model.simulate(u) + noise, dt=0.1).decimate(5)
    e = (data.y - lifted.predict(data))[100:, 0]
    assert abs(e.var() / lifted.innovation_cov[0, 0] - 1) < 4 * np.sqrt(2 / len(e))
    assert all(abs(np.corrcoef(e[k:], e[:-k])[0, 1]) < 4 / np.sqrt(len(e)) for k in range(1, 6))


def test_polynomial_model_equals_its_difference_equation():
    rng = np.random.default_rng(8)
    a = np.concatenate([np.eye(2)[None], 0.2 * rng.standard_normal((2, 2, 2))])
    b = rng.standard_normal((4, 2, 3))
    model, u = PolynomialModel(a, b, 1.0), rng.standard_normal((60, 3))
    y = np.zeros((60, 2))
    for t in range(60):
        y[t] = sum(b[k] @ u[t - k] for k in range(min(4, t + 1))) - sum(
            a[k] @ y[t - k] for k in range(1, min(3, t + 1))
        )
    np.testing.assert_allclose(model.simulate(u), y, atol=1e-12)
    f = np.array([0.01, 0.2, 0.4])
    np.testing.assert_allclose(model.frf(f), model.to_state_space().frf(f), atol=1e-12)
    e = rng.standard_normal((60, 2))
    data = Experiment(u, y + simulate(*arx_noise(model), e), dt=1.0)
    np.testing.assert_allclose(data.y - model.predict(data), e, atol=1e-10)


def arx_noise(model):
    space = model.to_state_space()
    return space.A, space.K, space.C, np.eye(2)


def test_to_control_agrees_on_the_frequency_response():
    A, B, C, D = random_system(np.random.default_rng(9), 4, 2, 3, 0.9)
    model = StateSpaceModel(A, B, C, D, 0.05)
    f = np.array([0.3, 2.0, 7.0])
    expected = model.to_control()(np.exp(2j * np.pi * f * 0.05))
    np.testing.assert_allclose(model.frf(f), np.moveaxis(expected, -1, 0), rtol=1e-9)
