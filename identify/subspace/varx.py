"""The high-order vector ARX model that starts the predictor-form methods."""

from dataclasses import dataclass

import numpy as np

from identify.steps.compression import PastFuture, regress


@dataclass(frozen=True, eq=False)
class Varx:
    """y(t) = theta z(t) + D u(t) + e(t) with z(t) the past of t, oldest sample first, Mercère et al. (2016), eq. (20).

    theta (ny, p (nu + ny)); D (ny, nu), zero unless it was fitted; E (ny, …) : innovation rows.
    """

    theta: np.ndarray
    D: np.ndarray
    E: np.ndarray

    @property
    def on_u(self) -> np.ndarray:
        """Coefficients of u (p, ny, nu), lag 1 first: C Ak^(k-1) (B - K D)."""
        return self._newest_first(self.theta[:, : self._inputs])

    @property
    def on_y(self) -> np.ndarray:
        """Coefficients of y (p, ny, ny), lag 1 first: C Ak^(k-1) K."""
        return self._newest_first(self.theta[:, self._inputs :])

    @property
    def _inputs(self) -> int:
        ny, nu = self.D.shape
        return self.theta.shape[1] // (nu + ny) * nu

    def _newest_first(self, coefficients: np.ndarray) -> np.ndarray:
        ny, nu = self.D.shape
        lags = self.theta.shape[1] // (nu + ny)
        return coefficients.reshape(ny, lags, -1).transpose(1, 0, 2)[::-1]

    def response(self, count: int) -> np.ndarray:
        """Responses of y to u and to e, (count, ny, nu + ny), from lag 0 on: D, CB, CAB, … and I, CK, CAK, …"""
        ny, nu = self.D.shape
        on_u, on_y = self.on_u, self.on_y
        h = np.zeros((count, ny, nu + ny))
        h[0] = np.hstack([self.D, np.eye(ny)])
        h[1 : len(on_u) + 1, :, :nu] = on_u[: count - 1]
        for k in range(1, count):
            j = min(k, len(on_y))
            h[k] += np.einsum("jab,jbc->ac", on_y[:j], h[k - j : k][::-1])
        return h


def varx(data: PastFuture, feedthrough: bool) -> Varx:
    """Fit the ARX model of `past` lags in the first block row of the future."""
    now = data.past
    Z, U, Y = data.z(), data.u(now, now + 1), data.y(now, now + 1)
    theta, D = regress(Y, Z, U) if feedthrough else (regress(Y, Z)[0], np.zeros((data.ny, data.nu)))
    return Varx(theta, D, Y - theta @ Z - D @ U)
