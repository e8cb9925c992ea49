"""Multisines that several files of tests design."""

import numpy as np
from scipy.linalg import block_diag, expm

from excite.models.state_space import StateSpaceModel

N = 256


BASE = {"dt": 0.01, "period_s": N * 0.01}


FLAT = {**BASE, "lines": list(range(1, 32))}


def two_modes(dt=0.01):
    """Modes at 2 Hz and 6 Hz, 5 % and 3 % damped, exactly discretised with zero-order hold."""
    blocks = []
    for f_hz, damping in ((2.0, 0.05), (6.0, 0.03)):
        w = 2 * np.pi * f_hz
        continuous = np.array([[0, 1, 0], [-w * w, -2 * damping * w, w * w], [0, 0, 0]])
        blocks.append(expm(continuous * dt))
    A, B = block_diag(*(b[:2, :2] for b in blocks)), np.vstack([b[:2, 2:] for b in blocks])
    return StateSpaceModel(A, B, [[1.0, 0, 0.5, 0]], [[0.0]], dt)
