"""B, D and x0 by linear least squares over all samples, given A, C and a predictor gain."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.types.experiment import Experiment

CHUNK = 50_000  # samples of one output reduced at once


@dataclass(frozen=True, eq=False)
class InputMatrices:
    """B (n, nu), D (ny, nu), x0 one (n,) an experiment, residual rows' covariance (ny, ny)."""

    B: np.ndarray
    D: np.ndarray
    x0: tuple[np.ndarray, ...]
    residual_cov: np.ndarray


def input_matrices(
    experiments: tuple[Experiment, ...], A: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool
) -> InputMatrices:
    """Fit B, D, x0 of y = C (qI - Ak)^-1 [(B - K D) u + K y] + D u + C Ak^t x0 + e, with Ak = A - K C.

    K = 0 makes it the simulation (output-error) fit of open-loop data; with K it is the one-step predictor, the only
    consistent choice in closed loop. The regressors come from the dual system: z_lj(t+1) = Ak^T z_lj(t) + C_l^T u_j(t)
    gives the response of output l to column j of B as z_lj^T B_j, so nu * ny simulations serve all n * nu columns.
    """
    n, ny, nu = len(A), len(C), experiments[0].u.shape[1]
    Ak = A - K @ C
    parameters = n * nu + (ny * nu if feedthrough else 0) + n * len(experiments)
    R = np.zeros((0, parameters + 1))
    for e, experiment in enumerate(experiments):
        N = len(experiment)
        target = experiment.y - lti.simulate(Ak, K, C, np.zeros((ny, ny)), experiment.y)
        rest = np.zeros((N, 1))
        for l in range(ny):
            z = np.stack([lti.states(Ak.T, C[l : l + 1].T, experiment.u[:, j : j + 1]) for j in range(nu)], axis=1)
            rows = np.zeros((N, parameters + 1))
            rows[:, : n * nu] = z.reshape(N, nu * n)
            if feedthrough:
                direct = -z @ K
                direct[:, :, l] += experiment.u
                rows[:, n * nu : n * nu + ny * nu] = direct.reshape(N, nu * ny)
            start = parameters - n * (len(experiments) - e)
            rows[:, start : start + n] = lti.states(Ak.T, np.zeros((n, 1)), rest, C[l])
            rows[:, -1] = target[:, l]
            for first in range(0, N, CHUNK):
                (R,) = la.qr(np.vstack([R, rows[first : first + CHUNK]]), mode="r", check_finite=False)
                R = R[: parameters + 1]
    scale = np.linalg.norm(R[:, :-1], axis=0)
    scale[scale == 0] = 1.0
    theta = la.lstsq(R[:, :-1] / scale, R[:, -1], cond=1e-12, check_finite=False)[0] / scale
    B = theta[: n * nu].reshape(nu, n).T
    D = theta[n * nu : n * nu + ny * nu].reshape(nu, ny).T if feedthrough else np.zeros((ny, nu))
    x0 = tuple(theta[parameters - n * len(experiments) :].reshape(len(experiments), n))
    return InputMatrices(B, D, x0, _residual_cov(experiments, A, B, C, D, K, x0))


def _residual_cov(experiments: tuple[Experiment, ...], A, B, C, D, K, x0) -> np.ndarray:  # noqa: ANN001
    total, count = 0.0, 0
    for experiment, start in zip(experiments, x0, strict=True):
        drive = np.hstack([experiment.u, experiment.y])
        feed = np.hstack([D, np.zeros((len(C), len(C)))])
        e = experiment.y - lti.simulate(A - K @ C, np.hstack([B - K @ D, K]), C, feed, drive, start)
        total, count = total + e.T @ e, count + len(e)
    return total / count
