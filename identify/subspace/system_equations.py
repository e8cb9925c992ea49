"""The projected system equations of N4SID: A, C, then B, D, and the noise covariances from what they leave."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.numerics.kalman import kalman_gain
from identify.steps.compression import PastFuture, lq, regress
from identify.steps.kalman import noise_free


@dataclass(frozen=True, eq=False)
class SystemEquations:
    """A, B, C, D, state rows X (n, …), and rows W (n, …), V (ny, …) of the residuals: process and measurement noise."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    V: np.ndarray
    X: np.ndarray


def system_equations(data: PastFuture, gamma: np.ndarray, feedthrough: bool) -> SystemEquations:
    """Solve the extended system equations for a given Gamma_f (f ny, n).

    Van Overschee and De Moor (1996), chapter 4, robust combined algorithm: with Z_i = Y_f / [Z_p; U_f] and Z_(i+1) the
    same one sample later, both projections,

        [Gamma_(f-1)^+ Z_(i+1); Y_i] = [A; C] Gamma_f^+ Z_i + M U_f + [W; V]

    gives A and C by least squares, and then B and D, in which M is linear, by a second one. The state is that of Gamma,
    without the bias of a state sequence shifted by one sample. The second fit depends on the basis of the state:
    orthonormal columns of Gamma weight all states alike.
    """
    p, f, nu, ny = data.past, data.future, data.nu, data.ny
    n = gamma.shape[1]
    U, Y, Z = data.u(p, p + f), data.y(p, p + f), data.z()
    Z_next = np.vstack([data.u(0, p + 1), data.y(0, p + 1)])
    inverse, inverse_next = la.pinv(gamma), la.pinv(gamma[:-ny])
    X = inverse @ projected(Y, Z, U)
    left = np.vstack([inverse_next @ projected(Y[ny:], Z_next, U[nu:]), Y[:ny]])
    AC = regress(left, X, U)[0]
    A, C = AC[:n], AC[n:]
    rest = left - AC @ X
    (inputs, _), (explained, _) = lq(U, rest)  # only what lies in the row space of U_f bears on B and D
    D_B = fit_input_matrices(explained, inputs, AC @ inverse, inverse_next, gamma, ny, feedthrough)
    D, B = D_B[:ny], D_B[ny:]
    rest = rest - regress(rest, U)[0] @ U
    return SystemEquations(A, B, C, D, rest[:n], rest[n:], X)


def projected(Y: np.ndarray, *on: np.ndarray) -> np.ndarray:
    """Y / on: the orthogonal projection onto the rows given."""
    return sum(c @ rows for c, rows in zip(regress(Y, *on), on, strict=True))


def fit_input_matrices(
    target: np.ndarray,
    U: np.ndarray,
    reach: np.ndarray,
    inverse_next: np.ndarray,
    gamma: np.ndarray,
    ny: int,
    feedthrough: bool,
) -> np.ndarray:
    """Return [D; B] (ny + n, nu) that make sum_k N_k [D; B] U_k, over the block rows U_k of U, fit `target` best.

    Block column k of M is N_k [D; B] = [Gamma_(f-1)^+ h_(k-1); 0] - reach h_k, where h_k is block column k of the
    Toeplitz matrix H_f, linear in D and B, and for k = 0 its first block is [B; D].
    """
    n, f = gamma.shape[1], len(gamma) // ny
    nu = len(U) // f
    columns = np.zeros((f, n + ny, ny + n))
    for k in range(f):
        columns[k] = -_toeplitz_column(reach, gamma, k, ny)
        if k > 0:
            columns[k, :n] += _toeplitz_column(inverse_next, gamma, k - 1, ny)
    columns[0, :n, ny:] += np.eye(n)
    columns[0, n:, :ny] += np.eye(ny)
    kept = np.arange(0 if feedthrough else ny, ny + n)
    blocks = U.reshape(f, nu, -1)
    regressors = np.einsum("kap,kuc->acpu", columns[:, :, kept], blocks).reshape(-1, len(kept) * nu)
    D_B = np.zeros((ny + n, nu))
    D_B[kept] = la.lstsq(regressors, target.ravel(), cond=1e-12, check_finite=False)[0].reshape(len(kept), nu)
    return D_B


def _toeplitz_column(left: np.ndarray, gamma: np.ndarray, k: int, ny: int) -> np.ndarray:
    """left h_k as coefficients of [D; B]: h_k holds zeros, then D at block k, then Gamma B below."""
    below = left[:, (k + 1) * ny :]
    return np.hstack([left[:, k * ny : (k + 1) * ny], below @ gamma[: below.shape[1]]])


def gain_of(A: np.ndarray, solved: SystemEquations, data: PastFuture) -> tuple[np.ndarray, np.ndarray]:
    """Return K by the Riccati equation from the residuals' covariances, and innovation rows; zero without noise."""
    W, V, N = solved.W, solved.V, data.factor.columns
    if noise_free(V, data.y(data.past, data.past + 1)):
        return np.zeros((len(W), len(V))), V
    K, cov = kalman_gain(A, solved.C, W @ W.T / N, V @ V.T / N, W @ V.T / N)
    return K, la.cholesky(cov, lower=True) * np.sqrt(N)
