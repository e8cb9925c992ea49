"""B, D and x0 from the regressors themselves: responses of dual systems, decomposed by QR chunk after chunk."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.numerics.hankel import append_rows
from excite.numerics.simulate import observability, states
from excite.types.experiment import Experiment

MODAL_CONDITION = 1e3  # of the eigenvectors: up to it regressors shared by all outputs lose three digits
CHUNK_VALUES = 262_144  # doubles of regressors decomposed at once, 2 MB


def by_dual_regression(
    experiments: tuple[Experiment, ...], Ak: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return B - K D, D, x0 (experiments, n), of least norm where they are not unique, NaN where the regressors overflow.

    With the dual systems z_lj(t+1) = Ak^T z_lj(t) + C_l^T u_j(t) the response of output l to column j of B is z_lj^T B_j, and
    rho_l(t) = (Ak^T)^t C_l^T gives that to x0.
    """
    n, ny, nu = len(Ak), len(C), experiments[0].u.shape[1]
    dual, p = _dual_systems(Ak, C), (nu + 1) * n + nu
    on_B, on_D = np.arange(nu * n), nu * n + np.arange(nu * ny if feedthrough else 0).reshape(-1, ny)
    unknowns = nu * n + on_D.size + n * len(experiments)
    R = np.zeros((unknowns + 1, unknowns + 1), order="F")
    for e, experiment in enumerate(experiments):
        on_x0 = unknowns - n * (len(experiments) - e) + np.arange(n)
        own = [np.zeros((p + len(system.outputs), p + len(system.outputs)), order="F") for system in dual]
        for regressors, target in _regressors(experiment, Ak, C, K, [system.generator for system in dual]):
            own = [
                append_rows(r, np.hstack([z, target[:, s.outputs]]))
                for r, z, s in zip(own, regressors, dual, strict=True)
            ]
        for triangle, system in zip(own, dual, strict=True):
            triangle = np.triu(triangle)
            for i, l in enumerate(system.outputs):
                rows = np.zeros((len(triangle), unknowns + 1))
                states = triangle[:, : p - nu].reshape(len(rows), nu + 1, n) @ system.to_output[i].T
                rows[:, on_B], rows[:, on_x0] = states[:, :nu].reshape(len(rows), nu * n), states[:, nu]
                rows[:, on_D[:, l]] = triangle[:, p - nu : p - nu + len(on_D)]
                rows[:, -1] = triangle[:, p + i]
                R = append_rows(R, rows)
    if not np.isfinite(R).all():
        theta = np.full(unknowns, np.nan)
    else:
        scale = np.linalg.norm(R[:, :-1], axis=0)
        scale[scale == 0] = 1.0
        theta = la.lstsq(R[:, :-1] / scale, R[:, -1], cond=1e-12, check_finite=False)[0] / scale
    D = theta[on_D].T if feedthrough else np.zeros((ny, nu))
    return theta[on_B].reshape(nu, n).T, D, theta[nu * n + on_D.size :].reshape(len(experiments), n)


@dataclass(frozen=True, eq=False)
class _DualSystem:
    """z(t+1) = Ak^T z(t) + b u(t) for some outputs: generator b (n,), outputs, and to_output (outputs, n, n) with z_l = T_l z."""

    generator: np.ndarray
    outputs: list[int]
    to_output: np.ndarray


def _dual_systems(Ak: np.ndarray, C: np.ndarray) -> list[_DualSystem]:
    """One system for all outputs, driven through the sum of all eigenvectors, or one each where those are ill-conditioned."""
    V = la.eig(Ak.T)[1]
    if len(C) == 1 or np.linalg.cond(V) > MODAL_CONDITION:
        return [_DualSystem(C[l], [l], np.eye(len(Ak))[None]) for l in range(len(C))]
    inverse = la.inv(V)
    maps = (V * (inverse @ C.T).T[:, None, :]) @ inverse
    return [_DualSystem(V.sum(1).real, list(range(len(C))), maps.real)]


def _regressors(
    experiment: Experiment, Ak: np.ndarray, C: np.ndarray, K: np.ndarray, generators: list[np.ndarray]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield rows [z_1 … z_nu, rho, u] of each dual system (g, samples, p) and y less what K y drives, chunk after chunk."""
    n, nu, b = len(Ak), experiment.u.shape[1], np.array(generators)
    z, rho, x = np.zeros((len(b), nu, n)), b, np.zeros(n)
    size = max(1, CHUNK_VALUES // (len(b) * (n * (nu + 1) + nu)))
    for start in range(0, len(experiment), size):
        u, y = experiment.u[start : start + size], experiment.y[start : start + size]
        responses = np.empty((len(b), len(u), nu, n))
        for g, j in np.ndindex(len(b), nu):
            responses[g, :, j] = states(Ak.T, b[g][:, None], u[:, [j]], z[g, j])
        decay, driven = observability(Ak, rho, len(u)), states(Ak, K, y, x)
        flat = responses.reshape(len(b), len(u), nu * n)
        yield (
            np.concatenate([flat, decay.transpose(1, 0, 2), np.broadcast_to(u, (len(b), *u.shape))], axis=2),
            y - driven @ C.T,
        )
        z = responses[:, -1] @ Ak + u[-1][:, None] * b[:, None]
        rho, x = decay[-1] @ Ak, Ak @ driven[-1] + K @ y[-1]
