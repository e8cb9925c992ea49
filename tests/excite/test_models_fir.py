"""Finite impulse responses against the sum that defines them and their shift register."""

import pickle

import numpy as np
import pytest
from random_models import fir

from excite.errors import ExciteError
from excite.models.fir import FirModel


@pytest.mark.parametrize("count", [1, 2, 7, 90])
@pytest.mark.parametrize("nu", [1, 3])
def test_every_answer_is_that_of_the_sum_and_of_the_shift_register(count, nu):
    rng = np.random.default_rng(count)
    model = fir(rng, count, 2, nu)
    past, u = rng.standard_normal((count - 1, nu)), rng.standard_normal((150, nu))
    every = np.concatenate([past, u - model.input_offset])
    y = [sum(model.h[k] @ every[t + count - 1 - k] for k in range(count)) for t in range(150)] + model.output_offset
    x0 = past[::-1].ravel()  # the newest first
    np.testing.assert_allclose(model.simulate(u, x0), y, atol=1e-11)
    space = model.to_state_space()
    np.testing.assert_allclose(space.simulate(u, x0), y, atol=1e-11)
    np.testing.assert_allclose(space.simulate(u), model.simulate(u), atol=1e-11)
    assert space.order == model.order == len(model.poles()) and not model.poles().any() and not space.poles().any()
    f = np.linspace(0, 1, 7)
    np.testing.assert_allclose(model.frf(f), space.frf(f), atol=1e-11)
    for samples in (1, count, count + 5):
        np.testing.assert_allclose(model.impulse(samples), space.impulse(samples), atol=1e-11)


def test_theta_are_the_taps():
    model = FirModel(np.arange(12.0).reshape(3, 2, 2), 0.1, covariance=np.eye(12))
    np.testing.assert_array_equal(model.theta(), np.arange(12.0))
    moved = model.at(model.theta() + 1)
    assert moved.h[2, 1, 0] == 11 and moved.inputs == model.inputs
    assert pickle.loads(pickle.dumps(model)).h.flags.writeable is False


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FirModel([1.0, 2.0], 0.1), r"FirModel\.h: shape \(2,\), expected \(N, N, N\)"),
        (lambda: FirModel(np.empty((0, 1, 1)), 0.1), r"FirModel\.h: .* one tap or more"),
        (lambda: FirModel([[[np.inf]]], 0.1), r"FirModel\.h: .* finite values"),
        (lambda: FirModel([[[1.0]]], -1), r"FirModel\.dt"),
        (
            lambda: FirModel([[[1.0]]], 0.1, covariance=np.eye(2)),
            r"FirModel\.covariance: shape \(2, 2\), expected \(1, 1\)",
        ),
        (lambda: FirModel([[[1.0]], [[2.0]]], 0.1).simulate(np.ones((4, 1)), [1, 2]), r"FirModel: x0: shape \(2,\)"),
    ],
)
def test_bad_models_are_refused_in_words(make, message):
    with pytest.raises(ExciteError, match=message):
        make()
