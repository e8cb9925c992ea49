"""B, D and x0 by linear least squares over all samples, given A, C and a predictor gain."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.numerics.correlation import Joint, correlate
from excite.types.experiment import Experiment
from identify.steps.dual_regression import by_dual_regression
from identify.steps.modal_sums import modal_sums

NORMAL_CONDITION = 1e4  # up to it the normal equations hold eight digits of the solution
DAMPING = 1e-6  # least distance of a mode from the unit circle at which sums over it hold ten digits


@dataclass(frozen=True, eq=False)
class InputMatrices:
    """B (n, nu), D (ny, nu), x0 one (n,) an experiment."""

    B: np.ndarray
    D: np.ndarray
    x0: tuple[np.ndarray, ...]


def input_matrices(
    experiments: tuple[Experiment, ...],
    A: np.ndarray,
    C: np.ndarray,
    K: np.ndarray,
    feedthrough: bool,
    circular: np.ndarray | None = None,
) -> InputMatrices:
    """Fit B, D, x0 of y = C (qI - Ak)^-1 [(B - K D) u + K y] + D u + C Ak^t x0 + e, with Ak = A - K C.

    K = 0 makes it the simulation (output-error) fit of open-loop data; with K it is the one-step predictor, the only
    consistent choice in closed loop. circular : circular correlation of [u, y], where it is known.

    The normal equations are those of the modes of Ak, whose regressors are first-order filters of u: all their sums come
    from the correlation of the data and one pass. Where the condition is too large for that, or a mode too close to the
    unit circle, the regressors themselves are decomposed by QR, chunk after chunk.
    """
    Ak = A - K @ C
    with np.errstate(all="ignore"):  # an unstable Ak may overflow: the result then is not finite
        found = _by_normal_equations(experiments, Ak, C, K, feedthrough, circular)
        B, D, x0 = found or by_dual_regression(experiments, Ak, C, K, feedthrough)
    return InputMatrices(B + K @ D, D, tuple(x0))


def _by_normal_equations(
    experiments: tuple[Experiment, ...],
    Ak: np.ndarray,
    C: np.ndarray,
    K: np.ndarray,
    feedthrough: bool,
    circular: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return B - K D, D, x0 (experiments, n), or None where normal equations do not hold them.

    With Ak = T diag(lambda) T^-1, c = C T, kappa = T^-1 K and zeta_ai the response of mode i to channel a of [u, y],

        y_l - sum_bi c_li kappa_ib zeta_bi = sum_ai c_li beta_ia zeta_ai + sum_a D_la u_a + sum_i c_li xi_i lambda_i^t

    in beta = T^-1 (B - K D), D and xi = T^-1 x0 of each record.
    """
    n, ny, nu = len(Ak), len(C), experiments[0].u.shape[1]
    try:
        modes, T = np.linalg.eig(Ak)
        kappa = np.linalg.solve(T, K)
    except np.linalg.LinAlgError:
        return None
    if np.abs(modes).max() > 1 - DAMPING:
        return None
    records = [Joint((e.u, e.y)) for e in experiments]
    if circular is None:
        circular = correlate(records, 0).circular
    u, y, predictor = slice(0, nu), slice(nu, nu + ny), K.any()
    sums = modal_sums(records, circular, modes, nu + ny if predictor else nu)
    c, lag0 = C @ T, circular[0]
    adjoint, gram = c.conj().T, c.conj().T @ c

    def products(on_data: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of regressors c_li z_i with those of beta and D, and with the left side, summed over outputs and samples."""
        on_beta = gram[:, None] * own[..., u, :]
        on_D = adjoint[:, None] * on_data[..., u, None]
        on_left = on_data[..., y]
        if predictor:
            on_left = on_left - np.einsum("...bj,jb->...j", own[..., y, :], kappa) @ c.T
        flat = [on_beta.reshape(*own.shape[:-2], nu * n), on_D.reshape(*own.shape[:-2], nu * ny)]
        return np.concatenate(flat[: 1 + feedthrough], axis=-1), (adjoint * on_left).sum(-1)

    N, b = products(sums.on_data[u], sums.own[u])
    N, b = N.reshape(nu * n, N.shape[-1]), b.ravel()
    if feedthrough:
        u_on_left = lag0[u, y]
        if predictor:
            u_on_left = u_on_left - np.einsum("bia,ib,li->al", sums.on_data[y, :, u].conj(), kappa, c)
        N = np.vstack([N, np.hstack([N[:, nu * n :].conj().T, np.kron(lag0[u, u], np.eye(ny))])])
        b = np.concatenate([b, u_on_left.ravel()])
    solution = _solve_arrow(N, b, gram * sums.decay_on_own[:, :, -1], *products(sums.decay_on_data, sums.decay_on_own))
    if solution is None:
        return None
    theta, xi = solution
    beta, D = theta[: nu * n].reshape(nu, n).T, theta[nu * n :].reshape(nu, ny).T if feedthrough else np.zeros((ny, nu))
    return (T @ beta).real, D.real, (xi @ T.T).real


def _solve_arrow(
    N: np.ndarray, b: np.ndarray, N_x: np.ndarray, N_xb: np.ndarray, b_x: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Solve the Hermitian system of shared unknowns (p,) and each record's own (records, n), which are eliminated.

    N (p, p), b (p,); N_x (records, n, n), N_xb (records, n, p), b_x (records, n). None where the condition is too large.
    """
    scale = np.sqrt(np.diag(N).real)
    scale_x = np.sqrt(np.diagonal(N_x, axis1=1, axis2=2).real)
    if not all(np.isfinite(s).all() and s.all() for s in (scale, scale_x)):
        return None
    try:
        L_x = np.linalg.cholesky(N_x / (scale_x[:, :, None] * scale_x[:, None]))
        W = np.linalg.solve(L_x, np.dstack([N_xb / (scale_x[:, :, None] * scale), b_x / scale_x]))
        W, v = W[..., :-1], W[..., -1]
        flat = W.reshape(v.size, len(N))
        L = np.linalg.cholesky(N / np.outer(scale, scale) - flat.conj().T @ flat)
    except np.linalg.LinAlgError:
        return None
    if max(_inverse_norm(factor) for factor in (L, *L_x) if len(factor)) > NORMAL_CONDITION:
        return None
    theta = la.cho_solve((L, True), b / scale - flat.conj().T @ v.ravel(), check_finite=False)
    x = np.linalg.solve(L_x.conj().transpose(0, 2, 1), (v - W @ theta)[..., None])[..., 0]
    return theta / scale, x / scale_x


def _inverse_norm(L: np.ndarray) -> float:
    """1-norm of the inverse of a lower triangular matrix, estimated."""
    reciprocal, _ = la.lapack.ztrcon(L, uplo="L")
    return 1 / (reciprocal * np.abs(L).sum(0).max()) if reciprocal > 0 else np.inf
