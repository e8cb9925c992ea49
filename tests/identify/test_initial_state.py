"""Initial states: by doubling as by least squares on the whole response, and of every class of models."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_models import PARAMETRIC, foster, polynomial, random_record, state_space

from excite.models.polynomial import PolynomialModel
from excite.models.state_space import ContinuousModel
from excite.numerics.simulate import observability
from excite.types.experiment import Experiment
from identify.steps.initial_state import HIDDEN, LONGEST, free_response_fit, initial_state


def least_squares(A, C, y):
    """The whole response C A^t at once."""
    response = observability(A, C, len(y)).reshape(y.size, len(A))
    return la.lstsq(response, y.ravel(), cond=HIDDEN)[0], response


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(0, 9) | st.just(40),
    ny=st.integers(1, 3),
    samples=st.integers(1, 700),
    radius=st.sampled_from([0.5, 0.99, 1.0, 1.02]),
)
def test_doubling_solves_the_least_squares_problem(seed, n, ny, samples, radius):
    rng = np.random.default_rng(seed)
    A, C, y = rng.standard_normal((n, n)), rng.standard_normal((ny, n)), rng.standard_normal((samples, ny))
    if n:
        A *= radius / np.abs(np.linalg.eigvals(A)).max()
    x = free_response_fit(A, C, y)
    expected, response = least_squares(A, C, y)
    assert x.shape == (n,)
    if n == 0:
        return
    values = la.svdvals(response) / la.norm(response, 2)
    assume(not ((values > HIDDEN / 10) & (values < HIDDEN * 10)).any())  # else rounding decides what y shows
    rounding = 1e-13 * la.norm(response, 2) * la.norm(expected)
    np.testing.assert_allclose(response @ x, response @ expected, atol=1e-9 * np.abs(y).max() + rounding)


def test_doubling_finds_the_state_behind_a_long_response():
    rng = np.random.default_rng(0)
    A = 0.9999 * la.block_diag([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]], [[0.5]])
    C, x = rng.standard_normal((1, 3)), np.array([1.0, -2.0, 3.0])
    y = (observability(A, C, 12_345) @ x).reshape(-1, 1)
    np.testing.assert_allclose(free_response_fit(A, C, y), x, atol=1e-11)


def test_a_state_that_is_not_seen_is_left_at_zero():
    A, C = np.diag([0.9, 0.5]), np.array([[1.0, 0.0]])
    y = 0.9 ** np.arange(500)[:, None]
    np.testing.assert_allclose(free_response_fit(A, C, y), [1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("samples", [15, 400])
@pytest.mark.parametrize("predictor", [False, True])
@pytest.mark.parametrize("kind", PARAMETRIC)
def test_every_class_of_models_finds_the_state_of_its_own_response(kind, predictor, samples):
    """As least squares on its state-space form does; where the record is shorter than the state, the one of least norm."""
    model = PARAMETRIC[kind](np.random.default_rng(1))
    if predictor and not getattr(model, "predicts", False):
        pytest.skip("does not predict")
    record = random_record(np.random.default_rng(2), replace_dt(model), samples)
    data = Experiment(record.u, record.y, dt=0.5)
    space = model.to_state_space() if model.dt else model.to_state_space(0.5)
    A = space.predictor()[0] if predictor else space.A
    residual = space.innovations(data) if predictor else data.y - space.simulate(data.u)
    expected, response = least_squares(A, space.C, residual)
    found = initial_state(model, data, predictor)
    np.testing.assert_allclose(response @ found, response @ expected, atol=1e-6)  # e^-20 is left out
    if np.linalg.cond(response) < 1e5:
        np.testing.assert_allclose(found, expected, atol=1e-6 * max(np.abs(expected).max(), 1))


def replace_dt(model):
    return model if model.dt else model.to_state_space(0.5)


def test_an_arx_model_of_many_lags_finds_its_state_as_its_state_space_form_does():
    rng = np.random.default_rng(3)
    model = polynomial(rng, 3, 3, na=20, nb=20)
    a = model.a.copy()
    a[1] -= a.sum(0) * 0.999  # slow, so that the response is long
    model = PolynomialModel(a, model.b, 1.0)
    u, x0 = rng.standard_normal((5000, 3)), rng.standard_normal(60)
    data = Experiment(u, model.simulate(u, x0) + 0.1 * rng.standard_normal((5000, 3)), dt=1.0)
    for predictor in (False, True):
        ours, theirs = (initial_state(m, data, predictor) for m in (model, model.to_state_space()))
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
    exact = replace(data, y=model.simulate(u, x0))
    np.testing.assert_allclose(initial_state(model, exact, False), x0, atol=1e-7)
    np.testing.assert_allclose(initial_state(model, exact, True), x0, atol=1e-10)


@pytest.mark.parametrize("make", [lambda rng: foster(rng, 3, 2, 2), lambda rng: state_space(rng, 3, 2, 2)])
def test_states_in_continuous_time_are_found_at_any_instants(make):
    rng = np.random.default_rng(4)
    model = make(rng)
    if model.dt is not None:
        model = ContinuousModel([[-0.1, 1, 0], [-1, -0.1, 0], [0, 0, -3]], model.B, model.C, model.D)
    u, x0, time = rng.standard_normal((80, 2)), rng.standard_normal(model.order), np.cumsum(rng.exponential(0.5, 80))
    for instants in (time, 0.5 * np.arange(80)):
        y = model.simulate(u, x0, time_s=instants)
        uniform = {"dt": 0.5} if instants is not time else {"time_s": time}
        np.testing.assert_allclose(initial_state(model, Experiment(u, y, **uniform), False), x0, atol=1e-8)


def test_a_slow_model_reads_no_more_than_it_must():
    """20,000 samples of a model that hardly forgets; what comes later does not count."""
    model = replace(state_space(np.random.default_rng(5), 1, 1, 1), A=[[1 - 1e-9]], K=None)
    rng = np.random.default_rng(6)
    u, x0 = rng.standard_normal((LONGEST + 100, 1)), np.array([2.0])
    y = model.simulate(u, x0)
    y[LONGEST:] += 1.0
    np.testing.assert_allclose(initial_state(model, Experiment(u, y, dt=0.5), False), x0, atol=1e-9)
