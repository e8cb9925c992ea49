"""OKID: observer/Kalman filter identification, for any input-output data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg as la

from identify.data.records import Records
from identify.estimate import Estimate
from identify.steps.completion import Inputs
from identify.steps.compression import PastFuture, require_excitation
from identify.steps.hankel_svd import HankelSvd, hankel_of, hankel_svd, onto
from identify.steps.kalman import NOISE_FREE
from identify.steps.shift import Shift
from identify.subspace.subspace_method import SubspaceMethod
from identify.subspace.varx import varx


@dataclass(frozen=True, eq=False)
class ObserverMarkov:
    """What all orders share: Hankel matrix of the weighted responses, and one sample later; their weights; D and E.

    markov (2 p, ny, …) : the weighted responses themselves; u_weight (nu,) : rms of u; e_weight (ny, ny) or (ny, 0) :
    Cholesky factor of the innovation covariance, no column without noise.
    """

    svd: HankelSvd
    shifted: np.ndarray
    markov: np.ndarray
    u_weight: np.ndarray
    e_weight: np.ndarray
    D: np.ndarray
    E: np.ndarray


@dataclass(frozen=True)
class Okid(SubspaceMethod):
    """Observer/Kalman filter identification (Juang, Phan, Horta and Longman 1993).

    The Markov parameters of an observer, y(t) = sum_k C Ak^(k-1) [B - K D, K] [u; y](t-k) + D u(t) + e(t), follow from
    least squares over p lags; recursion turns them into those of the system, C A^(k-1) [B K], which ERA realizes jointly.
    One-step prediction errors do not mind feedback: consistent in closed loop as the lags grow (then with a delay in
    the loop unless D is zero). B, D and K are those of the realization: through a fit on the samples, B would be biased
    in closed loop wherever the order leaves no states for the noise.

    ERA sees [B K] in units of the inputs' rms and of the innovations' standard deviations; without noise, B alone.

    lags : p; they must outlast the observer, whose memory is at least that of the noise.
    """

    name: ClassVar[str] = "okid"
    summary: ClassVar[str] = "observer/Kalman filter identification, realized by ERA; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True
    extent: ClassVar[str] = "lags + 1"

    lags: int = 40

    def horizons(self) -> tuple[int, int]:
        """(p, 1)."""
        return self.lags, 1

    def required_excitation(self, order: int | None) -> int:
        """Lags of u and u itself must have full row rank."""
        return self.lags + 1

    def largest_order(self, data: Records) -> int:
        """Rows of the Hankel matrix."""
        return self.lags * len(data.outputs)

    def singular_values(self, factor: PastFuture) -> np.ndarray:
        """Return those of the weighted Hankel matrix."""
        return self.found(factor).svd.values

    def decompose(self, factor: PastFuture) -> ObserverMarkov:
        """Observer Markov parameters, and the Hankel matrices of the system's."""
        p, nu = self.lags, factor.nu
        require_excitation(factor, 0, p + 1, "rows of lags")
        arx = varx(factor, self.feedthrough)
        h = arx.response(2 * p + 1)[1:]
        U, Y = factor.u(p, p + 1), factor.y(p, p + 1)
        u_weight = np.linalg.norm(U, axis=1) / np.sqrt(factor.factor.columns)
        noisy = np.linalg.norm(arx.E) > NOISE_FREE * np.linalg.norm(Y)
        cov = arx.E @ arx.E.T / factor.factor.columns
        e_weight = la.cholesky(cov, lower=True) if noisy else np.empty((len(Y), 0))
        weighted = np.concatenate([h[:, :, :nu] * u_weight, h[:, :, nu:] @ e_weight], axis=2)
        return ObserverMarkov(
            hankel_svd(weighted[:-1], p), hankel_of(weighted[1:], p), weighted, u_weight, e_weight, arx.D, arx.E
        )

    def realize(self, factor: PastFuture, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        found, nu, H = self.found(factor), factor.nu, self.found(factor).svd
        shift = Shift.of_pair(H, found.shifted, order)
        A, notes = self.dynamics(shift)
        BK = onto(A, shift.C, found.markov) if notes else H.delta(order)[:, : H.m]
        noisy = found.e_weight.size > 0
        K = la.solve(found.e_weight.T, BK[:, nu:].T).T if noisy else np.zeros((order, factor.ny))
        inputs = Inputs(BK[:, :nu] / found.u_weight, found.D)
        return self.completed(factor, A, shift.C, K, found.E, H.values, inputs, warnings=notes)
