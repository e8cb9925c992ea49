"""Polynomial models against their difference equations, their state-space form and scipy."""

import copy
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_models import polynomial
from scipy.signal import lfilter

from excite.errors import ExciteError
from excite.models.polynomial import PolynomialModel


def record_of(rng, model, samples):
    return SimpleNamespace(
        u=rng.standard_normal((samples, len(model.inputs))), y=rng.standard_normal((samples, len(model.outputs)))
    )


def by_definition(model, u, e):
    """y of A y = (B / F) u + (C / D) e, sample after sample from rest."""
    (N, nu), ny = u.shape, e.shape[1]
    w, v, y = np.zeros((N, ny, nu)), np.zeros((N, ny)), np.zeros((N, ny))
    u = u - model.input_offset

    def past(m, signal, t, first=0):
        return sum((m[k] * signal[t - k] for k in range(first, min(len(m), t + 1))), 0 * signal[0])

    for t in range(N):
        w[t] = past(model.b, u[:, None, :], t) - past(model.f, w, t, 1)
        v[t] = past(model.c, e, t) - past(model.d, v, t, 1)
        y[t] = (
            w[t].sum(1) + v[t] - sum((model.a[k] @ y[t - k] for k in range(1, min(len(model.a), t + 1))), np.zeros(ny))
        )
    return y + model.output_offset


STRUCTURES = st.fixed_dictionaries({key: st.integers(0, 3) for key in ("na", "nb", "nc", "nd", "nf")})


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 3), STRUCTURES)
def test_outputs_and_innovations_are_those_of_the_definition(seed, ny, nu, lags):
    rng = np.random.default_rng(seed)
    model = polynomial(rng, ny, nu, **lags)
    u, e = rng.standard_normal((50, nu)), rng.standard_normal((50, ny))
    np.testing.assert_allclose(model.simulate(u), by_definition(model, u, 0 * e), atol=1e-10)
    noisy = SimpleNamespace(u=u, y=by_definition(model, u, e))
    np.testing.assert_allclose(model.innovations(noisy), e, atol=1e-10)
    H = model.noise_impulse(7)
    for horizon in (1, 2, 7):
        cannot_know = np.stack([sum(H[i] @ e[t - i] for i in range(min(horizon, t + 1))) for t in range(50)])
        np.testing.assert_allclose(noisy.y - model.predict(noisy, horizon), cannot_know, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(0, 3), STRUCTURES, st.integers(1, 400))
def test_all_answers_equal_those_of_the_state_space_form(seed, ny, nu, lags, samples):
    rng = np.random.default_rng(seed)
    model = polynomial(rng, ny, nu, **lags)
    space, record = model.to_state_space(), record_of(rng, model, samples)
    assert model.order == space.order
    x0 = rng.standard_normal(model.order)
    for x in (None, x0):
        np.testing.assert_allclose(model.simulate(record.u, x), space.simulate(record.u, x), atol=1e-9)
        np.testing.assert_allclose(model.innovations(record, x), space.innovations(record, x), atol=1e-9)
        for ours, theirs in zip(*(m.predictions(record, (1, 3, 90), x) for m in (model, space)), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-9)
    np.testing.assert_allclose(model.impulse(40), space.impulse(40), atol=1e-10)
    np.testing.assert_allclose(model.noise_impulse(40), space.noise_impulse(40), atol=1e-10)
    f = np.linspace(0, 1, 9)  # up to the Nyquist frequency at 0.5 s
    np.testing.assert_allclose(model.frf(f), space.frf(f), atol=1e-9)
    np.testing.assert_allclose(model.noise_frf(f), space.noise_frf(f), atol=1e-9)


def test_twenty_lags_in_several_channels_equal_the_state_space_form():
    """The size of the main job: blocks, carries between them and an integrator."""
    rng = np.random.default_rng(3)
    model = polynomial(rng, 3, 3, na=20, nb=20)
    a = model.a.copy()
    a[1] -= a.sum(0)  # A(1) = 0: the outputs integrate
    model = PolynomialModel(a, model.b, 1.0)
    record, x0 = record_of(rng, model, 3001), rng.standard_normal(60)
    space = model.to_state_space()
    expected = space.simulate(record.u, x0)
    np.testing.assert_allclose(model.simulate(record.u, x0), expected, atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(model.predict(record, 50, x0), space.predict(record, 50, x0), atol=1e-9)


def test_a_box_jenkins_model_in_one_channel_equals_scipy():
    b, c, d, f = [0, 0.5, 0.25], [1, 0.4], [1, -0.9], [1, -1.2, 0.6]
    column = lambda m: np.reshape(m, (-1, 1))  # noqa: E731
    model = PolynomialModel(
        [[[1.0]]], np.reshape(b, (-1, 1, 1)), 1.0, c=column(c), d=column(d), f=np.reshape(f, (-1, 1, 1))
    )
    rng = np.random.default_rng(0)
    u, e = rng.standard_normal((2, 300))
    y = lfilter(b, f, u) + lfilter(c, d, e)
    np.testing.assert_allclose(model.simulate(u[:, None])[:, 0], lfilter(b, f, u), atol=1e-12)
    np.testing.assert_allclose(model.innovations(SimpleNamespace(u=u[:, None], y=y[:, None]))[:, 0], e, atol=1e-12)
    assert sorted(np.round(model.poles(), 9), key=np.imag) == sorted(np.round(np.roots(f), 9), key=np.imag)


def test_poles_are_those_of_a_and_f_not_of_the_noise():
    rng = np.random.default_rng(1)
    model = polynomial(rng, 1, 1, na=2, nb=1, nc=1, nd=1, nf=2)
    expected = np.concatenate([np.roots(model.a[:, 0, 0]), np.roots(model.f[:, 0, 0])])
    np.testing.assert_allclose(np.sort_complex(model.poles()), np.sort_complex(expected), atol=1e-12)
    assert len(model.to_state_space().poles()) == 5


def test_offsets_are_the_operating_point():
    model = PolynomialModel([[[1.0]], [[-0.5]]], [[[0.0]], [[1.0]]], 1.0, input_offset=[3.0], output_offset=[7.0])
    rest = SimpleNamespace(u=np.full((9, 1), 3.0), y=np.full((9, 1), 7.0))
    np.testing.assert_array_equal(model.simulate(rest.u), rest.y)
    np.testing.assert_array_equal(model.innovations(rest), 0 * rest.y)
    np.testing.assert_array_equal(model.predict(rest, 4), rest.y)


def test_theta_holds_the_free_coefficients():
    model = PolynomialModel([[[1.0]], [[-0.5]]], [[[0.0]], [[2.0]], [[0.0]]], 1.0, c=[[1.0], [0.3]])
    np.testing.assert_array_equal(model.theta(), [-0.5, 2.0, 0.3])  # zeros of b: a dead time and padding
    moved = model.at([0.1, 0.2, 0.0])
    assert (moved.a[1, 0, 0], moved.b[1, 0, 0], moved.c[1, 0]) == (0.1, 0.2, 0.0)
    np.testing.assert_array_equal(moved.theta(), [0.1, 0.2, 0.0])  # what is free stays free at zero
    freed = PolynomialModel(model.a, model.b, 1.0, c=[[1.0], [0.0]], free=[True, False, True, True, True])
    np.testing.assert_array_equal(freed.theta(), [-0.5, 2.0, 0.0, 0.0])
    assert freed.at([1, 2, 3, 4]).c[1, 0] == 4


def test_it_is_read_only_and_travels():
    model = polynomial(np.random.default_rng(0), 2, 2, na=1, nb=1, nc=1)
    model.poles()
    for one in (model, pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert one.c.tobytes() == model.c.tobytes() and one.outputs == model.outputs
        with pytest.raises(ValueError, match="read-only"):
            one.a[0] = 3


ONE, B = [[[1.0]]], [[[0.0]], [[1.0]]]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PolynomialModel([[[2.0]]], B, 1.0), r"PolynomialModel\.a: the first coefficient must be the identity"),
        (
            lambda: PolynomialModel(np.eye(2)[None], B, 1.0),
            r"PolynomialModel\.a: shape \(1, 2, 2\), expected \(N, 1, 1\)",
        ),
        (lambda: PolynomialModel(ONE, [[1.0]], 1.0), r"PolynomialModel\.b: shape \(1, 1\)"),
        (lambda: PolynomialModel(ONE, B, 1.0, c=[[0.5]]), r"PolynomialModel\.c: the first coefficient .* divide by it"),
        (lambda: PolynomialModel(ONE, B, 1.0, f=[[1.0]]), r"PolynomialModel\.f: shape \(1, 1\), expected \(N, 1, 1\)"),
        (lambda: PolynomialModel(ONE, B, 1.0, d=[[1.0], [np.nan]]), r"PolynomialModel\.d: .* finite values"),
        (lambda: PolynomialModel(ONE, [[[1j]]], 1.0), r"PolynomialModel\.b: not an array of real numbers"),
        (lambda: PolynomialModel(ONE, B, 0.0), r"PolynomialModel\.dt: 0\.0 is not a positive finite number"),
        (lambda: PolynomialModel(ONE, B, 1.0, np.eye(2)), r"PolynomialModel\.innovation_cov: shape \(2, 2\)"),
        (lambda: PolynomialModel(ONE, B, 1.0, free=[True]), r"PolynomialModel\.free: shape \(1,\); expected \(2,\)"),
        (lambda: PolynomialModel(ONE, B, 1.0).at([1.0, 2.0]), r"at: theta: shape \(2,\), expected \(1,\)"),
        (
            lambda: PolynomialModel(ONE, B, 1.0).simulate(np.ones((3, 1)), [1.0, 2.0]),
            r"x0: shape \(2,\), expected \(1,\)",
        ),
        (
            lambda: PolynomialModel(ONE, B, 1.0).predict(SimpleNamespace(u=np.ones((3, 1)), y=np.ones((3, 1))), 0),
            "predict: horizon 0; it must be at least 1 sample",
        ),
    ],
)
def test_bad_models_are_refused_in_words(make, message):
    with pytest.raises(ExciteError, match=message):
        make()
