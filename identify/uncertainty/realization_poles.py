"""How far the poles of a realization scatter, judged from the one record at hand."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.linalg as la
from scipy.fft import fft, ifft, prev_fast_len, rfft

from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import states
from excite.types.experiment import Experiment
from identify.steps.hankel_svd import HankelSvd
from identify.uncertainty.first_order import FirstOrder

PIECE = 4096  # samples whose spectra are held at once; long against the noise's memory


def noise_weights(H: HankelSvd, model: StateSpaceModel, columns: np.ndarray) -> np.ndarray:
    """Return the first-order weight of the noise in each pole, (n, lags, ny, m) complex.

    A comes from H = (O X + N0) S and its shift (O A X + N1) S, where N0 and N1 are block-Hankel matrices of the
    products R_vz of the noise v with an instrument z (m channels), N0[i, j] = R_vz(i + j), N1[i, j] = R_vz(i + j + 1)
    counted from the first lag, and S (`columns`, rows (j, z)) combines their columns. To first order in the noise, with
    w^H A = lambda w^H, A q = lambda q and w^H q = 1,

        delta lambda = w^H O^+ (N1 - lambda N0) S (X S)^+ q = sum_tau <W(tau), R_vz(tau)>:

    errors of the singular vectors cancel, for the shifted matrix has the range and the row space of the first.
    Poles are in the order of `StateSpaceModel.poles`.
    """
    n = model.order
    values, left, right = la.eig(model.A, left=True)
    order = np.abs(model.poles()[:, None] - values).argmin(1)
    values, left, right = values[order], left[:, order].conj(), right[:, order]
    left = left / np.sum(left * right, axis=0)
    root = np.sqrt(H.values[:n])
    row = ((H.left[:, :n] / root) @ left).T.reshape(n, -1, H.ny)
    column = (columns @ (H.right[:n].T / root) @ right).T.reshape(n, -1, H.m)
    edge = np.zeros((n, 1, H.ny))
    row = np.concatenate([edge, row], axis=1) - values[:, None, None] * np.concatenate([row, edge], axis=1)
    lags = row.shape[1] + column.shape[1] - 1
    return ifft(fft(row, lags, axis=1)[..., None] * fft(column, lags, axis=1)[:, :, None, :], axis=1)


def pole_uncertainty(
    model: StateSpaceModel, weights: np.ndarray, records: Sequence[tuple[Experiment, np.ndarray, np.ndarray]]
) -> FirstOrder:
    """Return the covariance (n, 2, 2) of the real and the imaginary part of each pole.

    After Miller (2012), Theorem 4.1, whose double sum of m(j) m(k)^T and v(j) v(k)^T is the covariance of the products R_vz;
    here it is carried on to the poles, which do not depend on the state basis. In print the Kronecker factors are
    exchanged (Theorem B.1 gives P_v (x) P_m) and the factor [I, -Z U^T (U U^T)^-1] is lost.

    weights : of `noise_weights`, for R_vz summed over all samples; records : (experiment, its x0, its instrument z).
    The noise is what the model's simulation leaves. Its products with z are compared at all circular shifts of the one
    against the other (piece by piece), which keeps both spectra and needs no lag window. This holds where z is
    independent of v: past inputs in open loop, or the reference. It does not where outputs are the instrument (methods
    that model the noise, output-only methods), nor without an instrument.
    """
    n, lags = weights.shape[:2]
    filters = np.concatenate([weights.real, weights.imag]).reshape(2 * n, lags, -1)
    cov = np.zeros((2 * n, 2 * n))
    for experiment, x0, z in records:
        if len(z) < lags:
            continue  # too short to have entered the products
        count = max(1, len(z) // max(PIECE, 4 * lags))
        length = prev_fast_len(len(z) // count, real=True)
        scale = len(z) / (len(z) // length) / length**3
        response = np.ascontiguousarray(rfft(filters, length, axis=1).transpose(1, 0, 2))
        twice = np.full((len(response), 1), 2.0)  # every frequency but 0 and the last of an even length stands for two
        twice[[0, -1] if length % 2 == 0 else [0]] = 1.0
        for piece, v in enumerate(_residuals(model, experiment, x0, length)):
            Z = rfft(z[piece * length : (piece + 1) * length], axis=0)
            product = rfft(v, axis=0).conj()[:, :, None] * Z[:, None, :]
            found = (response @ product.reshape(len(Z), -1, 1))[..., 0]
            cov += scale * ((twice * found).T @ found.conj()).real
    cov = cov.reshape(2, n, 2, n)[:, np.arange(n), :, np.arange(n)]
    return FirstOrder(model, cov)


def _residuals(model: StateSpaceModel, experiment: Experiment, x: np.ndarray, length: int) -> Iterator[np.ndarray]:
    """Yield y - yhat of whole pieces, (length, ny) each, the state carried from one to the next."""
    for start in range(0, len(experiment) - length + 1, length):
        u, y = experiment.u[start : start + length], experiment.y[start : start + length]
        x_all = states(model.A, model.B, u, x)
        yield y - x_all @ model.C.T - u @ model.D.T
        x = model.A @ x_all[-1] + model.B @ u[-1]
