"""Noise of simulated plants: independent seeded streams, and the Kalman filter that an ideal predictor would run."""

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.kalman import kalman_gain
from excite.numerics.matrices import spectral_radius


def draw(widths: Mapping[str, int], levels: Mapping[str, float], seed: int, count: int) -> dict[str, np.ndarray]:
    """Return white noise of unit variance (count, width) from each source; zeros where its level is zero.

    Every source has a random stream of its own, spawned from the seed in the order of `widths`: switching one source off
    leaves the others as they were, and a new source comes last.

    widths : source -> channels that it disturbs; levels : source -> standard deviation, by which callers scale.
    """
    return {
        name: np.random.default_rng(stream).standard_normal((count, width))
        if levels[name]
        else np.zeros((count, width))
        for stream, (name, width) in zip(_streams(seed, len(widths)), widths.items(), strict=True)
    }


def draw_start(widths: Mapping[str, int], seed: int, size: int) -> np.ndarray:
    """Return white noise of unit variance (size,) for the initial state, from a stream behind those of the sources."""
    return np.random.default_rng(_streams(seed, len(widths) + 1)[-1]).standard_normal(size)


def _streams(seed: int, count: int) -> list[np.random.SeedSequence]:
    return np.random.SeedSequence(seed).spawn(count)


def steady_kalman(
    A: np.ndarray, G: np.ndarray, C: np.ndarray, H: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    """Return the gain K and innovation covariance of the steady filter, or (None, None).

    x+ = A x + G n, y = C x + H n, n white with unit variance, shared by process and measurement. The filter is that
    reached from an exactly known state: its limit exists also when some states are never disturbed. Where an output has
    no noise of its own, or that filter is unstable (an unstable plant that nothing disturbs), it is the stabilising one,
    None if there is none.
    """
    if not (G.any() or H.any()):
        return None, None
    R, S = H @ H.T, G @ H.T
    if la.eigvalsh(R).min() > 0:
        K, innovation_cov = _from_known_state(A, G, C, R, S)
        if spectral_radius(A - K @ C) <= 1 + 1e-6:
            return K, innovation_cov
    try:
        K, innovation_cov = kalman_gain(A, C, G @ G.T, R, S)
    except (ExciteError, la.LinAlgError, ValueError):  # scipy raises ValueError for a pencil that it cannot order
        return None, None
    variances = la.eigvalsh(innovation_cov)
    return (K, innovation_cov) if variances.min() > 1e-12 * variances.max() else (None, None)


def _from_known_state(
    A: np.ndarray, G: np.ndarray, C: np.ndarray, R: np.ndarray, S: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return K and the innovation covariance by the Riccati recursion from P(0) = 0, doubled: P(2^j) for j = 0, 1, …

    Slow filters converge as well so. Doubling: Anderson and Moore (1979), Optimal Filtering, section 6.7.
    """
    gain = la.solve(R, S.T, assume_a="pos").T
    F = (A - gain @ C).T
    J = C.T @ la.solve(R, C, assume_a="pos")
    P = G @ G.T - gain @ S.T
    eye = np.eye(len(A))
    for _ in range(40):
        W = la.inv(eye + J @ P)
        update = F.T @ P @ W @ F
        J, P, F = J + F @ W @ J @ F.T, P + update, F @ W @ F
        P = (P + P.T) / 2.0
        if np.abs(update).max() <= 1e-14 * np.abs(P).max():
            break
    innovation_cov = C @ P @ C.T + R
    K = la.solve(innovation_cov, (A @ P @ C.T + S).T, assume_a="pos").T
    return K, innovation_cov
