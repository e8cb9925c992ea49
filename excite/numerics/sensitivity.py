"""How predictions and frequency responses move with a model's parameters, and what a record says about these.

Prediction-error methods, covariances (delta method), the Cramer-Rao bound and input design all ask here. Memory is bounded
in the length of the record: derivatives are made and summed block by block (excite.numerics.derivatives).
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.model import Parametric, Record
from excite.models.state_space import StateSpaceModel
from excite.numerics.derivatives import blocks, frf_derivatives

__all__ = [
    "Gram",
    "blocks",
    "directions",
    "frf_derivatives",
    "information_inverse",
    "predictor_derivatives",
    "predictor_gram",
    "similarity",
]

RANK = 1e-10  # part of a direction that is none of its own
SINGULAR = 1e-14  # reciprocal condition of scaled information below which data do not determine the parameters


@dataclass(frozen=True, eq=False)
class Gram:
    """What a record says about the parameters of a model, to second order.

    gram : sum J^T W J (p, p), with J(t) = d yhat(t) / d theta; gradient : sum J^T W e (p,), minus the gradient of
    1/2 sum e^T W e, so that gram^-1 gradient is the Gauss-Newton step; residual_cov : mean of e e^T (ny, ny), e = y - yhat;
    count : samples N. With W the inverse covariance of Gaussian innovations, `gram` is the Fisher information.

    Grams of several records add up.
    """

    gram: np.ndarray
    gradient: np.ndarray
    residual_cov: np.ndarray
    count: int

    def __add__(self, other: "Gram") -> "Gram":
        count = self.count + other.count
        cov = (self.count * self.residual_cov + other.count * other.residual_cov) / max(count, 1)
        return Gram(self.gram + other.gram, self.gradient + other.gradient, cov, count)

    def profiled(self, keep: int) -> "Gram":
        """Return what is left about the first `keep` parameters when the others (x0 of this record) are unknown.

        Schur complement; directions of the others that the record does not show cost nothing.
        """
        M, N = self.gram[:keep, keep:], self.gram[keep:, keep:]
        size = np.sqrt(np.maximum(np.diag(N), np.finfo(float).tiny))
        solved = la.pinvh(N / np.outer(size, size), rtol=1e-12) @ (
            np.column_stack([M.T, self.gradient[keep:]]) / size[:, None]
        )
        lost = (M / size) @ solved
        gram = self.gram[:keep, :keep] - lost[:, :keep]
        return Gram((gram + gram.T) / 2, self.gradient[:keep] - lost[:, keep], self.residual_cov, self.count)


def predictor_gram(
    model: Parametric,
    record: Record,
    weight: np.ndarray | None = None,
    x0: np.ndarray | None = None,
    initial: bool = False,
) -> Gram:
    """Return sum J^T W J and what belongs to it for the one-step prediction errors of a model on a record.

    Parameters
    ----------
    model : StateSpaceModel, PolynomialModel, FirModel, FosterModel; without a noise part, the errors are those of simulation
    record : anything with u, y and (for FosterModel) time_s, without missing samples
    weight : W (ny, ny), symmetric, unit matrix when not given
    x0 : state at the first sample, zero when not given
    initial : take x0 as further parameters, the last n of p; `Gram.profiled` removes them again

    >>> model = PolynomialModel([[[1.0]], [[-0.5]]], [[[0.0]], [[2.0]]], dt=0.1)
    >>> predictor_gram(model, record).gram.shape
    (2, 2)
    """
    ny = len(model.outputs)
    W = np.eye(ny) if weight is None else np.asarray(weight, float)
    if W.shape != (ny, ny) or not np.isfinite(W).all() or not np.allclose(W, W.T, rtol=1e-9, atol=0):
        raise ExciteError(f"predictor_gram: weight of shape {W.shape}; give a finite symmetric matrix ({ny}, {ny})")
    p = len(model.theta()) + (model.order if initial else 0)
    gram, gradient, scatter, count = np.zeros((p, p)), np.zeros(p), np.zeros((ny, ny)), 0
    for block in blocks(model, record, x0, initial):
        weighted = block.residuals @ W
        scatter += block.residuals.T @ block.residuals
        count += len(weighted)
        for i, (columns, J) in enumerate(block.parts):
            gradient[columns] += J.T @ weighted[:, i]
            for k, (others, J_other) in enumerate(block.parts[: i + 1]):
                if W[i, k] != 0:
                    found = W[i, k] * (J.T @ J_other)
                    gram[np.ix_(columns, others)] += found
                    if k < i:
                        gram[np.ix_(others, columns)] += found.T
    return Gram(gram, gradient, scatter / max(count, 1), count)


def predictor_derivatives(
    model: Parametric,
    record: Record,
    start: int = 0,
    stop: int | None = None,
    x0: np.ndarray | None = None,
    initial: bool = False,
) -> np.ndarray:
    """Return d yhat(t | t - 1) / d theta as (stop - start, ny, p) for samples start … stop - 1 of a record.

    As in `predictor_gram`; what lies before `start` is filtered, not kept.
    """
    start, stop, _ = slice(start, stop).indices(len(record.y))
    p = len(model.theta()) + (model.order if initial else 0)
    found = np.zeros((max(stop - start, 0), len(model.outputs), p))
    for block in blocks(model, record, x0, initial):
        first, last = max(start, block.start), min(stop, block.start + len(block.residuals))
        if block.start >= stop:
            break
        for i, (columns, J) in enumerate(block.parts if first < last else ()):
            found[first - start : last - start, i, columns] = J[first - block.start : last - block.start]
    return found


def similarity(model: StateSpaceModel, x0: np.ndarray | None = None) -> np.ndarray:
    """Return the directions of theta (p, n^2) in which only the basis of the state changes, not the model.

    For x' = (I + Z) x to first order: dA = Z A - A Z, dB = Z B, dC = -C Z, dK = Z K, and dx0 = Z x0 where x0 is given
    (McKelvey, Helmersson, Ribarits, Automatica 40, 2004: data driven local coordinates).
    """
    n, unit = model.order, np.eye(model.order)
    K = np.zeros((n, len(model.C))) if model.K is None else model.K
    moved = {
        "A": np.einsum("ip,qj->ijpq", unit, model.A) - np.einsum("ip,qj->ijpq", model.A, unit),
        "B": np.einsum("ip,qj->ijpq", unit, model.B),
        "C": -np.einsum("ip,qj->ijpq", model.C, unit),
        "D": np.zeros((*model.D.shape, n, n)),
        "K": np.einsum("ip,qj->ijpq", unit, K),
    }
    rows = [moved[key].reshape(getattr(model, key).size, n * n) for key in model.free()]
    if x0 is not None:
        rows.append(np.einsum("ip,q->ipq", unit, x0).reshape(n, n * n))
    return np.vstack(rows)


def directions(model: Parametric, x0: np.ndarray | None = None) -> np.ndarray:
    """Return an orthonormal basis U (p, q) of the directions of theta in which the model itself changes.

    All directions, except for a StateSpaceModel: there, those orthogonal to a change of the state's basis; U U^T is the
    projector onto them. Gauss-Newton steps, covariances and bounds are taken in these q coordinates, and whatever does not
    depend on the basis (poles, frequency responses, predictions) comes out the same in every basis. x0 : given where the
    parameters include the initial state.
    """
    p = len(model.theta()) + (0 if x0 is None else model.order)
    return _orthogonal_to(similarity(model, x0)) if isinstance(model, StateSpaceModel) else np.eye(p)


def _orthogonal_to(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (p, q) of what is orthogonal to the columns (p, r), whatever their lengths."""
    length = np.linalg.norm(columns, axis=0)
    if not length.any():
        return np.eye(len(columns))
    Q, R, _ = la.qr(columns[:, length > 0] / length[length > 0], pivoting=True)
    return Q[:, int((np.abs(np.diag(R)) > RANK).sum()) :]


def information_inverse(information: np.ndarray, gauge: np.ndarray | None = None) -> np.ndarray:
    """Return the covariance of theta (p, p) that information allows at best (Cramer and Rao), inverse where there is one.

    gauge : directions (p, r) of theta that change nothing, `similarity(model)` of a StateSpaceModel; along them, the
    covariance is any that serves: the variance dg^T P dg of a function g that does not depend on the basis (poles, frequency
    response, predictions) is the same in every basis. Raises ExciteError where data do not determine the other directions.
    """
    size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    U = np.eye(len(size)) if gauge is None else _orthogonal_to(size[:, None] * gauge)
    values, vectors = la.eigh(U.T @ (information / np.outer(size, size)) @ U)
    if len(values) and not values[0] > SINGULAR * values[-1]:
        raise ExciteError(
            f"the information about {len(values)} parameters is singular (reciprocal condition {values[0] / values[-1]:.1e}): "
            "the data do not determine all of them; lower the order, or excite more"
        )
    root = (U @ (vectors / np.sqrt(values))) / size[:, None]
    return root @ root.T
