"""Stability guard: a stable A where the estimated one is not."""

import numpy as np
import scipy.linalg as la

from excite.numerics.simulate import observability
from identify.steps.kalman import spectral_radius


def stable_dynamics(A: np.ndarray, C: np.ndarray, rows: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return A and no warning where it is stable, else the stable A of Maciejowski (1995) and a warning.

    A = Gamma^+ [Gamma without its first block row; 0], Gamma being `rows` block rows of the observability matrix of
    (A, C). With Gamma = Q R this is R^-1 Q^T S Q R, S the shift that pads with zeros, a contraction: no eigenvalue lies
    outside the unit circle. The zeros stand for C A^rows, so modes that have died out by then stay as they are.
    """
    radius = spectral_radius(A)
    if radius < 1:
        return A, ()
    gamma = observability(A, C, rows).reshape(-1, len(A))
    stable = la.lstsq(gamma, np.vstack([gamma[len(C) :], np.zeros_like(C)]), check_finite=False)[0]
    return stable, (
        f"the estimate of order {len(A)} was unstable (spectral radius {radius:.4f}); A was replaced by the stable one of a "
        "shift padded with zeros (stability_guard), which damps its slow modes: the order is probably too high",
    )
