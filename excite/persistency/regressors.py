"""What data tell about a stated model structure: the joint information of lagged outputs and inputs.

In closed loop the order of persistency of u alone says little: noise makes a fed-back input rich, yet it may be an exact
linear function of past outputs. What counts is whether the regressors of the model, outputs and inputs together, are
linearly independent (Söderström, Ljung and Gustavsson, IEEE TAC 21, 1976).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la

from excite.arguments import is_whole
from excite.errors import ExciteError
from excite.numerics.hankel import columns_of, hankel_factor
from excite.types.experiment import Experiment

SINGULAR = 1e-10  # scaled regressors with singular values below this fraction of the largest are dependent
POOR = 1e3  # condition of the information matrix from which the data are accepted only with a warning


@dataclass(frozen=True)
class Information:
    """Joint information of the regressors of one model structure.

    structure : the model, in words; condition : of the information matrix R^T R / N, every regressor at unit norm (inf
    when singular); singular : whether regressors are linearly dependent; status : "rejected", "accepted with a warning" or
    "accepted"; weakest : the combination of unit-norm regressors that the data tell least about, largest weights first;
    equations : rows of the regression; text : one sentence for the reader.
    """

    structure: str
    condition: float
    singular: bool
    status: str
    weakest: tuple[tuple[str, float], ...]
    equations: int
    path: str
    text: str

    @property
    def ok(self) -> bool:
        """Whether the model can be identified from these data."""
        return not self.singular

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        return {**asdict(self), "condition": self.condition if np.isfinite(self.condition) else None}

    def __str__(self) -> str:
        return self.text


def information(
    data: Experiment | Sequence[Experiment], na: int, nb: int, delay: int = 1, poor: float = POOR
) -> Information:
    """Judge data for ARX(na, nb, delay) by the joint information of its regressors.

    y(t) = -sum_{i=1..na} A_i y(t - i) + sum_{i=delay..delay+nb-1} B_i u(t - i) + e(t)

    Scaled to unit norm, the regressors phi(t) = [y(t-1), …, u(t-delay), …] give the information matrix M = R^T R, whose
    condition bounds by how much the least-squares variance in the worst direction exceeds that in the best. R is the
    triangular factor of the block-Hankel matrix of [u, y]; where its Gram matrix cannot tell the small singular values,
    it comes from a QR decomposition, so no verdict of singularity rests on squared data. Missing samples (NaN) part a
    record in two.

    Parameters
    ----------
    data : one experiment or several, side by side. na, nb : lags of each output and of each input; delay : first lag of
    the inputs. poor : condition of M from which a warning is given.

    Raises
    ------
    ExciteError when the structure is none or the data leave fewer equations than unknowns.
    """
    records = [data] if isinstance(data, Experiment) else list(data)
    for key, value, least in (("na", na, 0), ("nb", nb, 0), ("delay", delay, 0)):
        if not is_whole(value) or value < least:
            raise ExciteError(f"information: {key} {value!r}; give a whole number of at least {least}")
    if na + nb == 0 or not records:
        raise ExciteError("information: no lags or no record given; give na or nb of at least 1 and one experiment")
    first = records[0]
    nu, ny = first.u.shape[1], first.y.shape[1]
    lags = max(na, nb + delay - 1 if nb else 0)
    segments = [part for r in records for part in _gap_free(np.hstack([r.u, r.y]), lags + 1)]
    if columns_of(segments, lags + 1) < (lags + 1) * (nu + ny):
        raise ExciteError(
            f"information: ARX({na}, {nb}, {delay}) of {nu} inputs and {ny} outputs needs {(lags + 1) * (nu + ny)} rows, "
            f"but the data leave {columns_of(segments, lags + 1)}; record more samples or lower na and nb"
        )
    H = hankel_factor(segments, lags + 1)
    chosen = [(lag, nu + a, f"{first.outputs[a].name}(t-{lag})") for lag in range(1, na + 1) for a in range(ny)]
    chosen += [(lag, a, f"{first.inputs[a].name}(t-{lag})") for lag in range(delay, delay + nb) for a in range(nu)]
    rows = H.L[[(lags - lag) * (nu + ny) + column for lag, column, _ in chosen]]
    norms = np.linalg.norm(rows, axis=1)
    directions, s, _ = la.svd(rows / np.where(norms > 0, norms, 1.0)[:, None], full_matrices=False)
    singular = bool(s[-1] <= SINGULAR * s[0])
    condition = float("inf") if singular else float((s[0] / s[-1]) ** 2)
    status = "rejected" if singular else "accepted with a warning" if condition > poor else "accepted"
    weights = sorted(zip((c[2] for c in chosen), directions[:, -1].tolist(), strict=True), key=lambda w: -abs(w[1]))
    weakest = tuple(w for w in weights if abs(w[1]) > 0.1)
    structure = f"ARX({na}, {nb}, {delay})"
    combination = " ".join(f"{weight:+.2f} {name}" for name, weight in weakest)
    why = {
        "rejected": f"the regressors are linearly dependent ({combination} = 0 in units of their norms); excite the "
        "reference, or let the controller's order or delay rise",
        "accepted with a warning": f"condition {condition:.2g} of the scaled information matrix; least is known about "
        f"{combination}; a richer reference would help",
        "accepted": f"condition {condition:.2g} of the scaled information matrix",
    }[status]
    return Information(
        structure, condition, singular, status, weakest, H.columns, H.path, f"{structure}: {status}: {why}"
    )


def _gap_free(w: np.ndarray, least: int) -> list[np.ndarray]:
    """Runs of at least `least` samples without NaN."""
    bad = np.flatnonzero(np.isnan(w).any(1))
    edges = np.concatenate([[-1], bad, [len(w)]])
    runs = [w[a + 1 : b] for a, b in pairwise(edges)]
    return [run for run in runs if len(run) >= least] or [w[:0]]
