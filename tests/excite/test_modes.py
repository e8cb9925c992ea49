"""Continuous time, modes and the modal form, against scipy's and python-control's discretisation and structural dynamics."""

import control
import numpy as np
import pytest
import scipy.linalg as la
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel


def held(A, B, C, D, dt):
    return StateSpaceModel(*cont2discrete(tuple(np.array(m, float) for m in (A, B, C, D)), dt)[:4], dt)


def random_system(seed, n, nu=2, ny=3, dt=0.1):
    """Stable, with every pole below half the Nyquist frequency."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.25 * np.pi / dt / np.abs(la.eigvals(A)).max()
    A -= (np.max(la.eigvals(A).real) + 0.1) * np.eye(n)
    return A, rng.standard_normal((n, nu)), rng.standard_normal((ny, n)), rng.standard_normal((ny, nu))


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_continuous_time_undoes_the_hold(n):
    A, B, C, D = random_system(n, n)
    found = held(A, B, C, D, 0.1).to_continuous()
    for true, ours in ((A, found.A), (B, found.B), (C, found.C), (D, found.D)):
        np.testing.assert_allclose(ours, true, rtol=1e-8, atol=1e-8 * np.abs(true).max())


def test_integrators_need_no_modal_form():
    """A double integrator: A is defective in both times."""
    found = held([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], [[0]], 0.02).to_continuous()
    np.testing.assert_allclose(found.A, [[0, 1], [0, 0]], atol=1e-12)
    np.testing.assert_allclose(found.B, [[0], [1]], atol=1e-12)


def test_the_control_system_samples_back():
    model = held(*random_system(3, 4), 0.1)
    system = model.to_continuous().to_control()
    assert system.isctime() and system.ninputs == 2 and system.output_labels == ["y1", "y2", "y3"]
    back = control.sample_system(system, 0.1, method="zoh")
    np.testing.assert_allclose(back.A, model.A, atol=1e-10)
    np.testing.assert_allclose(back.B, model.B, atol=1e-10)
    slow = model.to_continuous().poles()
    np.testing.assert_allclose(np.sort_complex(np.exp(0.1 * slow)), np.sort_complex(model.poles()), atol=1e-10)


@pytest.mark.parametrize(
    ("A", "message"),
    [
        ([[0.5, 0], [0, 0.0]], r"pole at z = 0 is a delay of one sample.*lower the order"),
        (
            [[0.9, 0], [0, -0.4]],
            r"pole at z = -0\.4 on the negative real axis .* Nyquist frequency, 5 Hz.*sample faster",
        ),
        ([[-0.4, 1], [0, -0.4]], r"pole at z = -0\.4 on the negative real axis"),
        (
            np.eye(3, k=1) + 1e-12 * np.eye(3, k=-2),
            r"matrix logarithm is inaccurate .* poles lie near z = 0, at \|z\| = 0\.0001",
        ),
        (np.eye(7, k=1) + 1e-24 * np.eye(7, k=-6), "matrix logarithm is inaccurate"),
    ],
)
def test_poles_without_a_continuous_counterpart_are_named(A, message):
    n = len(A)
    with pytest.raises(ExciteError, match=message):
        StateSpaceModel(A, np.ones((n, 1)), np.ones((1, n)), [[0]], 0.1).to_continuous()


def chain(dt=0.01):
    """Three masses between walls, k = 400 N/m, m = 1 kg: w_j = 2 sqrt(k/m) sin(j pi / 8), shapes sin(i j pi / 4), 2 %."""
    K = 400 * (2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    w2, shapes = la.eigh(K)
    damping = shapes @ np.diag(2 * 0.02 * np.sqrt(w2)) @ shapes.T
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K, -damping]])
    B = np.vstack([np.zeros((3, 1)), [[1], [0], [0]]])
    return held(A, B, np.eye(3, 6), np.zeros((3, 1)), dt)


def test_modes_of_a_chain_of_masses():
    modes = chain().modes()
    assert len(modes) == 3
    for j, mode in enumerate(modes, 1):
        w = 40 * np.sin(j * np.pi / 8)
        assert mode.f_hz == pytest.approx(w / (2 * np.pi), rel=1e-9) and mode.damping == pytest.approx(0.02, rel=1e-7)
        assert mode.time_constant_s == pytest.approx(1 / (0.02 * w), rel=1e-7) and mode.pole.imag > 0
        shape = np.sin(np.arange(1, 4) * j * np.pi / 4)
        assert np.abs(mode.shape).max() == pytest.approx(1)
        assert abs(np.vdot(mode.shape, shape)) ** 2 == pytest.approx(
            np.vdot(mode.shape, mode.shape).real * shape @ shape
        )


def test_real_modes_have_time_constants():
    model = StateSpaceModel(np.diag(np.exp(-0.5 / np.array([2.0, 8.0]))), [[1], [1]], [[1, -3]], [[0]], 0.5)
    slow, fast = model.modes()
    assert (slow.time_constant_s, fast.time_constant_s) == pytest.approx((8, 2))
    assert slow.damping == 1 and slow.shape == pytest.approx([1])
    integrator = StateSpaceModel([[1.0]], [[1]], [[1]], [[0]], 0.5).modes()[0]
    assert integrator.f_hz == 0 and integrator.time_constant_s == np.inf and np.isnan(integrator.damping)
    assert StateSpaceModel(np.empty((0, 0)), np.empty((0, 1)), np.empty((1, 0)), [[2.0]], 1.0).modes() == ()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.integers(1, 8))
def test_the_modal_form_is_the_same_system_in_blocks(seed, n):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.95 / max(np.abs(la.eigvals(A)).max(), 0.1)
    model = StateSpaceModel(
        A,
        rng.standard_normal((n, 2)),
        rng.standard_normal((3, n)),
        np.zeros((3, 2)),
        0.1,
        K=rng.standard_normal((n, 3)),
    )
    modal = model.to_modal()
    np.testing.assert_allclose(modal.impulse(30), model.impulse(30), atol=1e-6 * np.abs(model.impulse(30)).max())
    np.testing.assert_allclose(modal.C @ modal.K, model.C @ model.K, atol=1e-6 * np.abs(model.C @ model.K).max())
    column = 0
    for mode in model.modes():
        size = 2 if 0 < mode.pole.imag < np.pi / 0.1 * (1 - 1e-9) else 1
        outside = modal.A[column : column + size].copy()
        outside[:, column : column + size] = 0
        assert not outside.any()
        np.testing.assert_allclose(modal.C[:, column], mode.shape.real, atol=1e-9)
        column += size
    assert column == n


def test_a_defective_model_has_no_modal_form():
    double = held([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], [[0]], 0.02)
    with pytest.raises(ExciteError, match=r"poles 1.* and 1.* coincide .* no modal form; keep the state-space form"):
        double.to_modal()
