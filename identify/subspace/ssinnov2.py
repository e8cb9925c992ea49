"""SSinnov2: data-driven impulse response with estimated innovations as input, for open- and closed-loop data."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from identify.steps.compression import PastFuture, regress
from identify.subspace.ssinnov1 import InnovationResponse, Ssinnov1
from identify.subspace.varx import varx


@dataclass(frozen=True)
class Ssinnov2(Ssinnov1):
    """Data-driven impulse response, with innovations as further input: w2h of Markovsky (2012).

    Mercère, Markovsky and Ramos (2016), section IV-B.

    Any combination g of the Hankel columns with zero past and an impulse as future input has the impulse response as
    future output: [U_p; E_p; Y_p; U_f; E_f] g = [0; I; 0], h = Y_f g, g of least norm. With the innovations of a
    high-order ARX model as E, h is the first block column of H_u and H_e in the plain least-squares fit of Y_f, without
    the Toeplitz structure of `ssinnov1`. The past that sets the initial condition is `lags` samples long; with all
    samples of the ARX model in it, the two methods would be one. From the response on they are the same.

    past : ARX order; future : samples of impulse response; lags : at least the lag of the innovation model (its order, for
    one output).
    """

    name: ClassVar[str] = "ssinnov2"
    summary: ClassVar[str] = "data-driven impulse response with estimated innovations as input; open and closed loop"

    lags: int = 10

    def horizons(self) -> tuple[int, int]:
        """(past, lags + future)."""
        return self.past, self.lags + self.future

    def decompose(self, factor: PastFuture) -> InnovationResponse:
        """First block column of the regression of Y_f on what came before and on future inputs."""
        p, f, nu, ny, now = self.past, self.future, factor.nu, factor.ny, self.past + self.lags
        arx = varx(factor, self.feedthrough)
        U, Y = factor.u(p, now + f), factor.y(p, now + f)
        past = np.vstack([factor.z(i) for i in range(self.lags + f)]).reshape(self.lags + f, -1, U.shape[1])
        E = Y - (arx.theta @ past).reshape(Y.shape) - (arx.D @ U.reshape(-1, nu, U.shape[1])).reshape(Y.shape)
        initial = np.vstack([U[: self.lags * nu], E[: self.lags * ny], Y[: self.lags * ny]])
        _, on_u, on_e = regress(Y[self.lags * ny :], initial, U[self.lags * nu :], E[self.lags * ny :])
        h = np.hstack([on_u[:, :nu], on_e[:, :ny]]).reshape(f, ny, nu + ny)
        return InnovationResponse.of(h[1:], h[0, :, :nu] if self.feedthrough else arx.D, arx.E)
