"""SSinnov1: innovation estimation and structured least squares, for open- and closed-loop data."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from identify.data.records import Records
from identify.estimate import Estimate
from identify.steps.completion import Inputs
from identify.steps.compression import PastFuture
from identify.steps.hankel_svd import HankelSvd, hankel_svd, onto
from identify.steps.kalman import noise_free
from identify.steps.shift import Shift
from identify.subspace.subspace_method import TwoHorizonMethod
from identify.subspace.varx import varx


@dataclass(frozen=True, eq=False)
class InnovationResponse:
    """What SSinnov1 and SSinnov2 find before they know the order.

    response (count, ny, nu), noise (count, ny, ny) : CB, CAB, … and CK, CAK, …; D (ny, nu); E : innovation rows;
    H : SVD of the Hankel matrix of `response`.
    """

    response: np.ndarray
    noise: np.ndarray
    D: np.ndarray
    E: np.ndarray
    H: HankelSvd

    @classmethod
    def of(cls, h: np.ndarray, D: np.ndarray, E: np.ndarray) -> "InnovationResponse":
        """From the responses to u and e side by side, (count, ny, nu + ny) from lag 1 on."""
        nu = D.shape[1]
        return cls(h[:, :, :nu], h[:, :, nu:], D, E, hankel_svd(h[:, :, :nu], (len(h) + 1) // 2))


@dataclass(frozen=True)
class Ssinnov1(TwoHorizonMethod):
    """Innovation-based identification (Mercère, Markovsky and Ramos 2016, section IV).

    The residual of a high-order ARX model estimates the innovations E_f. With the past projected out, the future obeys
    Y_f = H_u U_f + H_e E_f in open loop (27), E_f = Y_f - H_u U_f - H_y Y_f in closed loop (29), H being lower block
    Toeplitz in the Markov parameters of the innovation or predictor form. With E_f of that ARX model both hold exactly,
    so the structured least-squares problem (31)-(39) leaves no residual, in either form, and its solution is the impulse
    response of the ARX model, which a recursion gives without the Kronecker products. Kung's method realizes A, B, C from
    the response to u alone (together with the noise response it would spend states on the noise), and K follows from
    the noise response by least squares.

    past, future : horizons; stability_guard : on, because at too high an order the method goes unstable in every other
    run; switch it off for plants that are unstable or integrate.
    """

    name: ClassVar[str] = "ssinnov1"
    summary: ClassVar[str] = "innovation estimation and structured least squares; open and closed loop"
    consistent_in_closed_loop: ClassVar[bool] = True

    stability_guard: bool = True

    def largest_order(self, data: Records) -> int:
        """Rows, less one block for the shift, or columns of the Hankel matrix of future - 1 responses to u."""
        rows = self.future // 2
        return max(1, min((rows - 1) * len(data.outputs), (self.future - rows) * len(data.inputs)))

    def singular_values(self, factor: PastFuture) -> np.ndarray:
        """Return those of the Hankel matrix of the response."""
        return self.found(factor).H.values

    def decompose(self, factor: PastFuture) -> InnovationResponse:
        """Impulse response of the ARX model."""
        arx = varx(factor, self.feedthrough)
        return InnovationResponse.of(arx.response(self.future)[1:], arx.D, arx.E)

    def realize(self, factor: PastFuture, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        found, H = self.found(factor), self.found(factor).H
        shift = replace(Shift.of_gamma(H.gamma(order), H.ny), rows=len(found.response))
        A, notes = self.dynamics(shift)
        C, B = shift.C, onto(A, shift.C, found.response) if notes else H.delta(order)[:, : H.m]
        silent = noise_free(found.E, factor.y(factor.past, factor.past + 1))
        K = np.zeros(C.T.shape) if silent else onto(A, C, found.noise)
        inputs = Inputs(B, found.D)
        return self.completed(factor, A, C, K, found.E, H.values, inputs, predictor=factor.closed, warnings=notes)
