"""Derivatives by parameters: against finite differences, in any basis of the state, in bounded memory; and their use."""

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from random_models import PARAMETRIC, polynomial, random_record, state_space

from excite.errors import ExciteError
from excite.models.model import Model
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.numerics import derivatives
from excite.numerics.sensitivity import (
    blocks,
    directions,
    frf_derivatives,
    information_inverse,
    predictor_derivatives,
    predictor_gram,
    similarity,
)
from excite.numerics.simulate import BLOCK


@pytest.fixture(params=PARAMETRIC)
def model(request):
    return PARAMETRIC[request.param](np.random.default_rng(sorted(PARAMETRIC).index(request.param)))


def predicted(model, record, x0):
    if getattr(model, "predicts", False):
        return model.predict(record, 1, x0)
    return model.response(record, x0)


def differences(function, at, step=1e-5):
    """Central differences, the varied parameter last."""
    return np.stack([(function(at + e) - function(at - e)) / (2 * step) for e in step * np.eye(len(at))], axis=-1)


def test_predictor_derivatives_equal_finite_differences(model):
    rng = np.random.default_rng(1)
    record, x0 = random_record(rng, model, 120), rng.standard_normal(model.order)
    expected = differences(lambda theta: predicted(model.at(theta), record, x0), model.theta())
    by_state = differences(lambda x: predicted(model, record, x), x0)
    found = predictor_derivatives(model, record, x0=x0, initial=True)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found[..., : expected.shape[2]], expected, atol=1e-8 * scale)
    np.testing.assert_allclose(found[..., expected.shape[2] :], by_state, atol=1e-8 * scale)
    np.testing.assert_array_equal(predictor_derivatives(model, record, x0=x0), found[..., : expected.shape[2]])


def test_frequency_response_derivatives_equal_finite_differences(model):
    f = np.linspace(0.02, 0.9, 7)
    expected = differences(lambda theta: model.at(theta).frf(f), model.theta())
    np.testing.assert_allclose(frf_derivatives(model, f), expected, atol=1e-7 * np.abs(expected).max())


def test_blocks_join_without_a_seam(model, monkeypatch):
    rng = np.random.default_rng(2)
    record, x0 = random_record(rng, model, 333), rng.standard_normal(model.order)
    whole, gram = (use(model, record, x0=x0, initial=True) for use in (predictor_derivatives, predictor_gram))
    monkeypatch.setattr(derivatives, "VALUES", 1)
    assert len(list(blocks(model, record, x0))) == -(-333 // BLOCK)
    in_blocks = predictor_derivatives(model, record, 17, 301, x0=x0, initial=True)
    np.testing.assert_allclose(in_blocks, whole[17:301], atol=1e-11)
    summed = predictor_gram(model, record, x0=x0, initial=True)
    np.testing.assert_allclose(summed.gram, gram.gram, rtol=1e-9, atol=1e-9 * np.abs(gram.gram).max())


def test_grams_are_the_sums_that_define_them(model):
    rng = np.random.default_rng(3)
    record, x0, ny = random_record(rng, model, 150), rng.standard_normal(model.order), len(model.outputs)
    root = rng.standard_normal((ny, ny))
    W = root @ root.T
    J, e = predictor_derivatives(model, record, x0=x0), record.y - predicted(model, record, x0)
    found = predictor_gram(model, record, W, x0)
    expected = np.einsum("tip,ij,tjq->pq", J, W, J)
    np.testing.assert_allclose(found.gram, expected, atol=1e-12 * np.abs(expected).max())
    gradient = np.einsum("tip,ij,tj->p", J, W, e)
    np.testing.assert_allclose(found.gradient, gradient, atol=1e-11 * np.abs(gradient).max())
    np.testing.assert_allclose(found.residual_cov, e.T @ e / 150, atol=1e-12)
    twice = found + found
    np.testing.assert_allclose(twice.gram, 2 * found.gram)
    np.testing.assert_allclose(twice.residual_cov, found.residual_cov)
    assert twice.count == 300


def test_the_gradient_is_that_of_the_squares(model):
    rng = np.random.default_rng(4)
    record = random_record(rng, model, 80)

    def half_squares(theta):
        return 0.5 * np.sum((record.y - predicted(model.at(theta), record, None)) ** 2, keepdims=True)[0]

    slope = differences(half_squares, model.theta())[0]
    np.testing.assert_allclose(-predictor_gram(model, record).gradient, slope, atol=1e-6 * np.abs(slope).max())


# ------------------------------------------------------------------------------------------------------- the basis
def in_another_basis(model, rng, decades):
    n = model.order
    T = rng.standard_normal((n, n)) @ np.diag(10.0 ** np.linspace(-decades / 2, decades / 2, n))
    A, B = np.linalg.solve(T, model.A @ T), np.linalg.solve(T, model.B)
    return replace(model, A=A, B=B, C=model.C @ T, K=np.linalg.solve(T, model.K)), T


def test_a_change_of_the_basis_moves_theta_along_similarity():
    rng = np.random.default_rng(5)
    model, x0, Z = state_space(rng, 3, 2, 2), rng.standard_normal(3), rng.standard_normal((3, 3))

    def moved(step):  # x' = (I + step Z) x
        T = np.linalg.inv(np.eye(3) + step * Z)
        A, B, K = (np.linalg.solve(T, m) for m in (model.A @ T, model.B, model.K))
        return np.r_[replace(model, A=A, B=B, C=model.C @ T, K=K).theta(), np.linalg.solve(T, x0)]

    expected = (moved(1e-6) - moved(-1e-6)) / 2e-6
    np.testing.assert_allclose(similarity(model, x0) @ Z.ravel(), expected, atol=1e-8)


def test_nothing_that_is_seen_moves_along_similarity():
    rng = np.random.default_rng(6)
    model = state_space(rng, 4, 2, 3)
    record, x0 = random_record(rng, model, 100), rng.standard_normal(4)
    J, S, U = predictor_derivatives(model, record, x0=x0, initial=True), similarity(model, x0), directions(model, x0)
    np.testing.assert_allclose(J @ S, 0, atol=1e-10)
    np.testing.assert_allclose(frf_derivatives(model, [0.1, 0.5]) @ similarity(model), 0, atol=1e-10)
    n, nu, ny = 4, 2, 3
    assert U.shape == (S.shape[0], n * (nu + 2 * ny) + nu * ny + n)  # the parameters that are there in any basis
    np.testing.assert_allclose(U.T @ U, np.eye(U.shape[1]), atol=1e-12)
    np.testing.assert_allclose(U.T @ S, 0, atol=1e-12)
    assert np.linalg.matrix_rank(J.reshape(-1, J.shape[2])) == U.shape[1]


@pytest.mark.parametrize("decades", [0, 6])
def test_what_the_data_say_is_the_same_in_every_basis(decades):
    rng = np.random.default_rng(7)
    model = state_space(rng, 4, 2, 2)
    other, _ = in_another_basis(model, rng, decades)
    record, f = random_record(rng, model, 400), np.array([0.03, 0.2, 0.8])
    spans, variances = [], []
    for each in (model, other):
        P = information_inverse(predictor_gram(each, record).gram, similarity(each))
        by_frf, J = frf_derivatives(each, f), predictor_derivatives(each, record)
        variances.append(np.einsum("fijp,pq,fijq->fij", by_frf, P, by_frf.conj()).real)
        J = J.reshape(-1, J.shape[2])
        spans.append(J @ P @ J.T)  # the projector J J^+
    np.testing.assert_allclose(variances[1], variances[0], rtol=1e-6)
    np.testing.assert_allclose(spans[1], spans[0], atol=1e-6)
    np.testing.assert_allclose(spans[0] @ spans[0], spans[0], atol=1e-6)
    assert np.trace(spans[0]) == pytest.approx(4 * 6 + 4, abs=1e-6)


def test_a_gain_without_states_has_no_basis():
    gain = StateSpaceModel(np.empty((0, 0)), np.empty((0, 2)), np.empty((1, 0)), [[1.0, 2.0]], 1.0)
    record = random_record(np.random.default_rng(0), gain, 40)
    gram = predictor_gram(gain, record, initial=True)
    np.testing.assert_allclose(gram.gram, record.u.T @ record.u)
    np.testing.assert_array_equal(directions(gain), np.eye(2))
    np.testing.assert_allclose(information_inverse(gram.gram, similarity(gain)), np.linalg.inv(gram.gram))
    np.testing.assert_array_equal(frf_derivatives(gain, [0.1]), [[[[1, 0], [0, 1]]]])


# ------------------------------------------------------------------------------------------------------- use
def test_the_bound_of_an_arx_model_is_that_of_least_squares():
    """For ARX, J are the regressors themselves: P = s^2 (sum phi phi^T)^-1 (Ljung 1999, eq. 9.30)."""
    rng = np.random.default_rng(8)
    model = PolynomialModel([[[1.0]], [[-0.7]]], [[[0.0]], [[2.0]]], 1.0)
    u, e = rng.standard_normal((2, 500, 1))
    record = SimpleNamespace(u=u, y=model.to_state_space().simulate(u) + noise_of(model, e))
    phi = np.column_stack([-np.r_[0, record.y[:-1, 0]], np.r_[0, u[:-1, 0]]])
    gram = predictor_gram(model, record, weight=[[1 / 0.25]])
    np.testing.assert_allclose(information_inverse(gram.gram), 0.25 * np.linalg.inv(phi.T @ phi), rtol=1e-9)
    step = np.linalg.solve(gram.gram, gram.gradient)  # one Gauss-Newton step reaches the least squares
    np.testing.assert_allclose(model.theta() + step, np.linalg.lstsq(phi, record.y[:, 0])[0], rtol=1e-9)


def noise_of(model, e):
    space = model.to_state_space()
    return StateSpaceModel(space.A, space.K, space.C, np.eye(len(space.C)), 1.0).simulate(e)


def test_estimates_scatter_as_the_bound_says():
    """ARMAX by one Gauss-Newton step from the truth, which is asymptotically efficient: 300 runs, chi-square within 10 %."""
    rng = np.random.default_rng(9)
    model = PolynomialModel([[[1.0]], [[-0.8]]], [[[0.0]], [[1.0]]], 1.0, c=[[1.0], [0.5]])
    u = rng.standard_normal((400, 1))
    found, inverse = [], 0
    for _ in range(300):
        record = SimpleNamespace(u=u, y=model.simulate(u) + noise_of(model, rng.standard_normal((400, 1))))
        gram = predictor_gram(model, record)
        found.append(np.linalg.solve(gram.gram, gram.gradient))
        inverse = inverse + information_inverse(gram.gram) / 300
    chi2 = np.einsum("ri,ij,rj->r", found, np.linalg.inv(inverse), found)
    assert chi2.mean() == pytest.approx(3, rel=0.1)


def test_an_unknown_initial_state_costs_what_its_schur_complement_says():
    rng = np.random.default_rng(10)
    model = polynomial(rng, 1, 1, na=2, nb=1)
    record = random_record(rng, model, 60)
    gram = predictor_gram(model, record, initial=True)
    p = len(model.theta())
    expected = np.linalg.inv(np.linalg.inv(gram.gram)[:p, :p])
    np.testing.assert_allclose(gram.profiled(p).gram, expected, rtol=1e-9)
    step = np.linalg.solve(gram.gram, gram.gradient)
    np.testing.assert_allclose(np.linalg.solve(gram.profiled(p).gram, gram.profiled(p).gradient), step[:p], rtol=1e-8)


@pytest.mark.parametrize("kind", ["state space", "box-jenkins", "fir", "foster"])
def test_memory_does_not_grow_with_the_derivatives(kind, monkeypatch):
    monkeypatch.setattr(derivatives, "VALUES", 50_000)
    rng = np.random.default_rng(11)
    model, peaks = PARAMETRIC[kind](rng), []
    for samples in (20_000, 80_000):
        record = random_record(rng, model, samples)
        tracemalloc.start()
        predictor_gram(model, record)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    grown = 60_000 * len(model.outputs) * len(model.theta()) * 8  # bytes that the further derivatives would fill
    assert peaks[1] - peaks[0] < grown / 2 and peaks[1] < grown


class Oracle(Model):
    def frf(self, f_hz):
        return None


def test_bad_use_is_refused_in_words():
    model = state_space(np.random.default_rng(12), 2, 1, 1)
    record = SimpleNamespace(u=np.zeros((50, 1)), y=np.zeros((50, 1)))
    with pytest.raises(ExciteError, match=r"weight of shape \(2, 2\); give a finite symmetric matrix \(1, 1\)"):
        predictor_gram(model, record, weight=np.eye(2))
    with pytest.raises(ExciteError, match=r"information about .* parameters is singular .* excite more"):
        information_inverse(predictor_gram(model, record).gram, similarity(model))
    with pytest.raises(ExciteError, match="Oracle: no derivatives by parameters are known"):
        frf_derivatives(Oracle(), [1.0])
    with pytest.raises(ExciteError, match="Oracle: no derivatives by parameters are known"):
        list(blocks(Oracle(), record))
