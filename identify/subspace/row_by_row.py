"""Regressions of one future output row after another on the past and on the rows before it, all in one LQ factor."""

import numpy as np
import scipy.linalg as la

from identify.steps.compression import PastFuture

TINY = 1e-12  # what is left of a row below this fraction of it is rounding: the row depends on those before it


def causal_lq(factor: PastFuture, feedthrough: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return L of [Z_p; y_1; u_1; y_2; u_2; …] = L Q (with feedthrough u_i before y_i) and the outputs' rows (f, ny)."""
    nu, ny, p = factor.nu, factor.ny, factor.past
    blocks = [factor.z()]
    for k in range(p, p + factor.future):
        pair = [factor.y(k, k + 1), factor.u(k, k + 1)]
        blocks += reversed(pair) if feedthrough else pair
    (R,) = la.qr(np.vstack(blocks).T, mode="r", check_finite=False)
    first = len(blocks[0]) + (nu if feedthrough else 0)
    return R.T, first + (nu + ny) * np.arange(factor.future)[:, None] + np.arange(ny)


def coefficients_on(M: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return X with X M = target, M lower triangular; rows of M that depend on those before them get coefficient zero."""
    M = M.copy()
    dependent = np.flatnonzero(np.abs(np.diag(M)) <= TINY * np.linalg.norm(M, axis=1))
    M[dependent, dependent] = np.inf
    return la.solve_triangular(M, target.T, lower=True, trans="T", check_finite=False).T
