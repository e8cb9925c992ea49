"""B, D and x0 by linear least squares over all samples, given A, C and a predictor gain."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.correlation import Joint, correlate
from excite.hankel import append_rows
from excite.types.experiment import Experiment
from identify.ground.modal_sums import modal_sums

NORMAL_CONDITION = 1e4  # up to it the normal equations hold eight digits of the solution
DAMPING = 1e-6  # least distance of a mode from the unit circle at which sums over it hold ten digits
CHUNK_VALUES = 262_144  # doubles of regressors decomposed at once, 2 MB


@dataclass(frozen=True, eq=False)
class InputMatrices:
    """B (n, nu), D (ny, nu), x0 one (n,) an experiment."""

    B: np.ndarray
    D: np.ndarray
    x0: tuple[np.ndarray, ...]


def input_matrices(
    experiments: tuple[Experiment, ...], A: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool,
    circular: np.ndarray | None = None,
) -> InputMatrices:  # fmt: skip
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
        B, D, x0 = found or _by_qr(experiments, Ak, C, K, feedthrough)
    return InputMatrices(B + K @ D, D, tuple(x0))


def _by_normal_equations(
    experiments: tuple[Experiment, ...], Ak: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool,
    circular: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:  # fmt: skip
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


def _by_qr(
    experiments: tuple[Experiment, ...], Ak: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return B - K D, D, x0 (experiments, n), of least norm where they are not unique, NaN where the regressors overflow."""
    n, ny, nu = len(Ak), len(C), experiments[0].u.shape[1]
    on_B, on_D = np.arange(nu * n), nu * n + np.arange(nu * ny if feedthrough else 0).reshape(-1, ny)
    unknowns = nu * n + on_D.size + n * len(experiments)
    R = np.zeros((unknowns + 1, unknowns + 1), order="F")
    for e, experiment in enumerate(experiments):
        on_x0 = unknowns - n * (len(experiments) - e) + np.arange(n)
        places = [np.concatenate([on_B, on_x0, on_D[:, l], [unknowns]]) for l in range(ny)]
        own = [np.zeros((len(places[0]), len(places[0])), order="F") for _ in range(ny)]
        for chunk in _regressors(experiment, Ak, C, K, feedthrough):
            own = [append_rows(R_l, rows) for R_l, rows in zip(own, chunk, strict=True)]
        for R_l, place in zip(own, places, strict=True):
            rows = np.zeros((len(R_l), unknowns + 1))
            rows[:, place] = np.triu(R_l)
            R = append_rows(R, rows)
    if not np.isfinite(R).all():
        theta = np.full(unknowns, np.nan)
    else:
        scale = np.linalg.norm(R[:, :-1], axis=0)
        scale[scale == 0] = 1.0
        theta = la.lstsq(R[:, :-1] / scale, R[:, -1], cond=1e-12, check_finite=False)[0] / scale
    D = theta[on_D].T if feedthrough else np.zeros((ny, nu))
    return theta[on_B].reshape(nu, n).T, D, theta[nu * n + on_D.size :].reshape(len(experiments), n)


def _regressors(
    experiment: Experiment, Ak: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool
) -> Iterator[np.ndarray]:
    """Yield rows [z_1 … z_nu, rho, u, y - what K y drives] of all outputs, (ny, samples, p), chunk after chunk.

    By the dual systems z_lj(t+1) = Ak^T z_lj(t) + C_l^T u_j(t) the response of output l to column j of B is z_lj^T B_j, and
    rho_l(t) = (Ak^T)^t C_l^T gives that to x0.
    """
    n, ny, nu = len(Ak), len(C), experiment.u.shape[1]
    z, rho, x = np.zeros((ny, nu, n)), C, np.zeros(n)
    size = max(1, CHUNK_VALUES // (ny * (n * (nu + 1) + nu + 1)))
    for start in range(0, len(experiment), size):
        u, y = experiment.u[start : start + size], experiment.y[start : start + size]
        responses = np.empty((ny, len(u), nu, n))
        for l, j in np.ndindex(ny, nu):
            responses[l, :, j] = lti.states(Ak.T, C[l][:, None], u[:, [j]], z[l, j])
        decay = lti.observability(Ak, rho, len(u))
        driven = lti.states(Ak, K, y, x)
        target = y - driven @ C.T
        yield np.concatenate([
            responses.reshape(ny, len(u), nu * n), decay.transpose(1, 0, 2),
            np.broadcast_to(u, (ny, *u.shape))[..., : nu * feedthrough], target.T[..., None],
        ], axis=2)  # fmt: skip
        z = responses[:, -1] @ Ak + u[-1][:, None] * C[:, None]
        rho, x = decay[-1] @ Ak, Ak @ driven[-1] + K @ y[-1]
