"""Spectral radius and zero-order hold, against their definitions."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from excite.numerics.matrices import spectral_radius, zero_order_hold


def test_the_spectral_radius_is_the_largest_modulus():
    turn = 0.9 * np.array([[np.cos(1), np.sin(1)], [-np.sin(1), np.cos(1)]])
    assert spectral_radius(turn) == pytest.approx(0.9, abs=1e-15)
    assert spectral_radius(np.zeros((0, 0))) == 0.0 and spectral_radius(np.array([[0.0, 5.0], [0.0, 0.0]])) == 0.0


def test_zero_order_hold_is_exact_also_for_an_integrator():
    """x1' = x2, x2' = u: x1 grows by dt x2 + dt^2 u / 2."""
    A, B = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.3)
    np.testing.assert_allclose(A, [[1, 0.3], [0, 1]], atol=1e-16)
    np.testing.assert_allclose(B, [[0.045], [0.3]], atol=1e-16)


def test_zero_order_hold_is_scipys():
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((5, 5)), rng.standard_normal((5, 2))
    found = zero_order_hold(A, B, 0.1)
    expected = cont2discrete((A, B, np.eye(5), np.zeros((5, 2))), 0.1)[:2]
    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-13)
