"""The steady Kalman gain of a linear system."""

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError


def kalman_gain(
    A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the steady one-step Kalman gain K (n, ny) and the innovation covariance (ny, ny).

    For x+ = A x + w, y = C x + v with cov [w; v] = [[Q, S], [S^T, R]], by the stabilising Riccati solution. Raises
    ExciteError when there is none.
    """
    try:
        P = la.solve_discrete_are(A.T, C.T, (Q + Q.T) / 2, (R + R.T) / 2, s=S)
        innovation = C @ P @ C.T + R
        return la.solve(innovation, (A @ P @ C.T + S).T, assume_a="pos").T, (innovation + innovation.T) / 2
    except (la.LinAlgError, ValueError) as error:  # the latter when the eigenvalues cannot be sorted
        raise ExciteError(
            f"no steady Kalman gain exists for this noise ({error}); give every output some noise"
        ) from error
