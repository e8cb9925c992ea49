"""The Fisher information of any parametric model, as a metric."""

import numpy as np

from excite.models.model import Parametric
from excite.models.state_space import StateSpaceModel
from excite.numerics.sensitivity import frf_derivatives, information_inverse, predictor_gram, similarity
from identify.metrics.judgement import Judgement
from identify.metrics.metric import Metric, Need, NotApplicable


def gain_sd(judgement: Judgement) -> float:
    """Return the largest standard deviation of a static gain by the Cramer-Rao bound of the validation record."""
    model, record = judgement.model, judgement.record
    if not isinstance(model, Parametric):
        raise NotApplicable(f"a {type(model).__name__} has no parameters")
    if record.incomplete is not None:
        raise NotApplicable("samples are missing")
    gram = predictor_gram(model, record)
    weight = np.linalg.inv(gram.residual_cov)
    information = predictor_gram(model, record, (weight + weight.T) / 2).gram
    covariance = information_inverse(information, similarity(model) if isinstance(model, StateSpaceModel) else None)
    slopes = frf_derivatives(model, np.zeros(1)).real.reshape(-1, len(covariance))
    return float(np.sqrt(np.einsum("ip,pq,iq->i", slopes, covariance, slopes).max()))


GAIN_SD = Metric(
    "gain_sd",
    "largest standard deviation of a static gain (Cramer-Rao bound of the validation record)",
    gain_sd,
    tells="How well a record of this length and excitation can know the static gain.",
    cannot_tell="Errors of structure: it trusts the model.",
    header="gain sd",
    unit="–",
    needs=frozenset({Need.RECORD, Need.SIMULATION}),
)
