"""Turbulence as white noise through shaping filters, and continuous white noise seen at sampling instants."""

import numpy as np
import scipy.linalg as la


def dryden_vertical(speed: float, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A (2, 2), B (2, 1), C (1, 2) from white noise of unit intensity to the vertical gust speed of unit variance.

    H(s) = sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2,  T = length / speed, whose spectrum over the spatial frequency W is
    Phi(W) = (L / pi) (1 + 3 (L W)^2) / (1 + (L W)^2)^2, one-sided.

    speed : m/s; length : scale of turbulence L, m. Source: MIL-F-8785C (1980), 3.7.1.2.
    """
    T = length / speed
    A = np.array([[0.0, 1.0], [-1.0 / T**2, -2.0 / T]])
    return A, np.array([[0.0], [1.0]]), np.array([[1.0, np.sqrt(3.0) * T]]) / T**1.5


def sampled_noise(A: np.ndarray, G: np.ndarray, dt: float) -> np.ndarray:
    """Return Gd (n, n) such that Gd n(k), n white of unit variance, is what x' = A x + G w gathers in one interval.

    Gd Gd^T = int_0^dt e^(A t) G G^T e^(A^T t) dt for w of unit intensity. Source: Van Loan, IEEE Trans. AC 23, 1978.
    """
    n = len(A)
    block = la.expm(np.block([[-A, G @ G.T], [np.zeros((n, n)), A.T]]) * dt)
    Q = block[n:, n:].T @ block[:n, n:]
    values, vectors = la.eigh((Q + Q.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))
