"""SSinnov1: innovation estimation and structured least squares, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from excite.lti import observability
from identify.estimate import Estimate
from identify.ground.compression import PastFuture, lq, regress
from identify.ground.kalman import spectral_radius
from identify.ground.realization import hankel_of, kung
from identify.method import order_or_gap
from identify.subspace.realize import complete
from identify.subspace.subspace_method import TwoHorizonMethod


@dataclass(frozen=True)
class Ssinnov1(TwoHorizonMethod):
    """Innovation-based identification (Mercère, Markovsky and Ramos 2016; seed 003, section IV).

    The residual of a high-order ARX model estimates the innovations E_f. With the past projected out, the future obeys
    Y_f = H_u U_f + H_e E_f in open loop (27), E_f = Y_f - H_u U_f - H_y Y_f in closed loop (29), H being lower block
    Toeplitz in the Markov parameters of the innovation or predictor form. The structure makes the least-squares problem
    (31)-(39) linear in the first block column alone: one regression on the shifted rows stacked side by side, instead
    of the printed Kronecker products. Kung's method realizes A, B, C from the response to u alone (together with the
    noise response it would spend states on the noise), and K follows from the noise response by least squares.

    past, future : horizons; feedthrough : allow D (in closed loop the controller then needs a delay);
    stability_guard : replace an unstable A by a stable one (Maciejowski 1995) and say so; switch it off for plants that
    are unstable or integrate.
    """

    name: ClassVar[str] = "ssinnov1"
    summary: ClassVar[str] = "innovation estimation and structured least squares; open and closed loop"
    closed_loop: ClassVar[bool] = True

    feedthrough: bool = False
    stability_guard: bool = True

    def largest_order(self, data: object) -> int:
        """Block rows of the Hankel matrix of future - 1 Markov parameters, less one for the shift."""
        ny = data[0].y.shape[1] if isinstance(data, tuple) else data.y.shape[1]
        return max(1, (self.future // 2 - 1) * ny)

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        p, f, nu, ny = self.past, self.future, factor.nu, factor.ny
        closed = any(e.loop.closed for e in factor.experiments)
        Z, U, Y = factor.z(), factor.u(p, p + f), factor.y(p, p + f)
        first = [Z, U[:nu]] if self.feedthrough else [Z]
        theta = regress(Y[:ny], *first)
        E = np.vstack([
            Y[i * ny : (i + 1) * ny] - theta[0] @ factor.z(i)
            - (theta[1] @ U[i * nu : (i + 1) * nu] if self.feedthrough else 0)
            for i in range(f)
        ])  # fmt: skip
        L = lq(Z, U, Y, E)
        U, Y, E0 = (np.hstack(L[k][1:]) for k in (1, 2, 3))
        second = Y if closed else E0
        markov, D = _toeplitz_regression(Y - E0, U, second, f, nu, ny, self.feedthrough)
        if closed:
            markov = _innovation_form(markov, D)
        response, noise = markov[:, :, :nu], markov[:, :, nu:]
        values = la.svdvals(hankel_of(response, f // 2))
        n, warnings = order_or_gap(order, values, self.largest_order(factor.experiments))
        A, B, C = kung(response, n, f // 2)
        gamma = observability(A, C, f - 1).reshape(-1, n)
        K = la.lstsq(gamma, noise.reshape(-1, ny))[0]
        if self.stability_guard and spectral_radius(A) >= 1:
            shifted = np.vstack([gamma[ny:], np.zeros((ny, n))])
            A = la.lstsq(gamma, shifted)[0]
            gamma = observability(A, C, f - 1).reshape(-1, n)
            B, K = (la.lstsq(gamma, part.reshape(len(gamma), -1))[0] for part in (response, noise))
            warnings += (
                f"the estimate of order {n} was unstable; A was replaced by the stable one of a shift padded with zeros "
                "(stability_guard), which damps its slow modes: the order is probably too high",
            )
        return complete(
            self.name, factor, A, C, K, E[:ny], feedthrough=self.feedthrough, predictor=closed, singular_values=values,
            warnings=warnings, fitted=(B, D),
        )  # fmt: skip


def _innovation_form(markov: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Turn C Ak^(k-1) [B - K D, K] into C A^(k-1) [B, K]: the predictor's loop through y is closed lag by lag."""
    nu = D.shape[1]
    gains, found = markov[:, :, nu:], markov.copy()
    for k in range(len(markov)):
        found[k, :, :nu] += gains[k] @ D
        found[k] += sum(gains[j] @ found[k - 1 - j] for j in range(k))
    return found


def _toeplitz_regression(
    target: np.ndarray, U: np.ndarray, W: np.ndarray, f: int, nu: int, ny: int, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Fit target_i = D U_i + sum_(k=1..i) h_k [U_(i-k); W_(i-k)] over all block rows i; return h (f - 1, ny, nu + ny), D.

    Every block row holds the same unknowns, so the rows are laid side by side, zeros where i < k.
    """
    d = U.shape[1]
    pairs = np.concatenate([U.reshape(f, nu, d), W.reshape(f, ny, d)], axis=1)
    m = nu + ny
    regressors = np.zeros((f, m, f, d))
    for k in range(1, f):
        regressors[k, :, k:] = pairs[:-k].transpose(1, 0, 2)
    if feedthrough:
        regressors[0, :nu] = U.reshape(f, nu, d).transpose(1, 0, 2)
    rows = regressors.reshape(f * m, f * d)
    kept = np.concatenate([np.arange(nu if feedthrough else 0), np.arange(m, f * m)])
    stacked = target.reshape(f, ny, d).transpose(1, 0, 2).reshape(ny, f * d)
    (coefficients,) = regress(stacked, rows[kept])
    D = coefficients[:, :nu] if feedthrough else np.zeros((ny, nu))
    h = coefficients[:, nu if feedthrough else 0 :].reshape(ny, f - 1, m).transpose(1, 0, 2)
    return h, D
