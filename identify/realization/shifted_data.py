"""What realization from data and from covariances share: the instrument, the projection, and the way to a model."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import certify
from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.steps.covariance import cross_covariance, smoothed_covariance
from identify.steps.hankel_svd import HankelSvd
from identify.steps.input_matrices import input_matrices
from identify.steps.kalman import spectral_radius
from identify.uncertainty.realization_poles import noise_weights, pole_uncertainty
from identify.uncertainty.uncertainty import Uncertainty
from identify.uncertainty.withheld import Withheld

ROUNDING = 1e-13  # singular values below this fraction of the largest are rounding
BIASED = "biased: feedback correlates the instrument with the noise; record the reference and take it as the instrument"


@dataclass(frozen=True, eq=False)
class ShiftedData:
    """Output rows with the input rows projected out, H = O X S, as an SVD; and one sample later, O A X S.

    columns : S, rows (lag, channel) of the instrument's lags in ascending order.
    """

    svd: HankelSvd
    shifted: np.ndarray
    columns: np.ndarray


def shifted_data(U: np.ndarray, Y: np.ndarray, ny: int, m: int) -> ShiftedData:
    """Project r + 1 block rows of inputs out of r + 1 block rows of outputs (ny channels), Miller (2012), eq. (4.13)-(4.14).

    The same projection serves both shifts, so that both have the states X S. m : channels of the instrument.
    """
    right = la.svd(U, check_finite=False)[2]
    S = right[len(U) :].T
    H = Y @ S
    left, values, right = la.svd(H[:-ny], full_matrices=False, check_finite=False)
    return ShiftedData(HankelSvd(left, values, right, ny, m), H[ny:], S)


def check_input_rows(U: np.ndarray, experiments: tuple[Experiment, ...], rows: int) -> None:
    """Raise ExciteError when the input rows, seen through the instrument, are not of full row rank."""
    norms = np.linalg.norm(U, axis=1, keepdims=True)
    singular = la.svdvals(U / np.where(norms > 0, norms, 1.0))
    if len(singular) < len(U) or singular[-1] <= ROUNDING * singular[0]:
        found = certify(experiments, block_rows=rows).order
        raise ExciteError(
            f"{rows} block rows of the input are not independent as the instrument sees them (the input is persistently "
            f"exciting of order {found}); excite more frequencies, take fewer block_rows, or more lags"
        )


def reference_missing(data: Records) -> str | None:
    """Return why the reference cannot be the instrument, or None."""
    for k, experiment in enumerate(data.measured):
        record = data.place(k)
        if experiment.reference is None:
            return f"{record}no reference is recorded to be the instrument; name its channels as reference"
        if np.isnan(experiment.reference).any():
            row, column = np.argwhere(np.isnan(experiment.reference))[0]
            return (
                f"{record}sample {row} of channel '{experiment.references[column].name}' is missing (NaN); fill it or "
                "give the gap-free parts as separate records"
            )
    return None


def instruments_of(parts: tuple[Experiment, ...], reference: bool) -> tuple[np.ndarray, ...]:
    """Return the reference of each part, or its inputs."""
    return tuple(e.u if not reference or e.reference is None else e.reference for e in parts)


def covariances(
    experiments: tuple[Experiment, ...],
    instruments: tuple[np.ndarray, ...],
    first_lag: int,
    last_lag: int,
    segments: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Return R_u (lags, nu, m) and R_y (lags, ny, m) over all records; `segments` above 1 smooth them."""
    R = []
    for key in ("u", "y"):
        pairs = [(getattr(e, key), z) for e, z in zip(experiments, instruments, strict=True)]
        if segments > 1:
            R.append(smoothed_covariance(pairs, first_lag, last_lag, segments))
        else:
            R.append(cross_covariance(pairs, first_lag, last_lag))
    return R[0], R[1]


def covariance_input_matrices(
    R_u: np.ndarray, R_y: np.ndarray, A: np.ndarray, C: np.ndarray, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return B, D by least squares on R_y = C R_x + D R_u, R_x(tau + 1) = A R_x(tau) + B R_u(tau); Miller (2012), eq. (5.6).

    R_u (lags, nu, m), R_y (lags, ny, m). Each channel of the instrument is a record of its own, with covariances for
    samples and R_x at the first lag for its initial state (5.3 in print counts powers of A from lag 0 instead): that is
    Theorem 5.1, zero-based: block (i, j) is driven by R_u of input i and instrument floor(j / ny), at output j mod ny.
    """
    records = tuple(Experiment(R_u[:, :, j], R_y[:, :, j], dt=1.0) for j in range(R_u.shape[2]))
    found = input_matrices(records, A, C, np.zeros((len(A), len(C))), feedthrough)
    return found.B, found.D


def scatter(
    shifted: ShiftedData, parts: tuple[Experiment, ...], instruments: tuple[np.ndarray, ...] | None, products: int = 1
) -> Callable[[StateSpaceModel, tuple[np.ndarray, ...]], Uncertainty]:
    """Return what tells the uncertainty of a model's poles, given the model and the initial states.

    instruments : (N_i, m) of each record, None where no instrument is free of the noise; products : how many each entry
    of H averages (1 where H holds sums).
    """

    def tell(model: StateSpaceModel, x0: tuple[np.ndarray, ...]) -> Uncertainty:
        if instruments is None:
            return Withheld(model, "no instrument is free of the noise")
        if spectral_radius(model.A) >= 1:
            return Withheld(model, "A is not stable, so that no simulation tells the noise")
        weights = noise_weights(shifted.svd, model, shifted.columns) / products
        return pole_uncertainty(model, weights, list(zip(parts, x0, instruments, strict=True)))

    return tell
