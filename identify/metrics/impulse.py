"""Error of the impulse response against the truth."""

import numpy as np

from excite.models.model import Dynamic
from identify.metrics.judgement import Judgement
from identify.metrics.metric import Metric, Need, NotApplicable

COUNT = 200  # Markov parameters that are compared


def impulse_error(model: Dynamic, truth: Dynamic, count: int = COUNT) -> float:
    """Return the relative error of the first Markov parameters: ||h - hhat||_2 / ||h||_2.

    Parameters
    ----------
    model, truth : with the same inputs, outputs and sampling time.
    count : Markov parameters h_0 … that are compared.

    Returns
    -------
    0 for a perfect model, 1 for one that responds to nothing, inf or NaN where a response overflows.

    References
    ----------
    Mercère, Markovsky and Ramos (2016), eq. (40d).
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        h = truth.impulse(count)
        return float(np.linalg.norm(model.impulse(count) - h) / np.linalg.norm(h))


def _compute(judgement: Judgement) -> float:
    if judgement.model.dt is None:
        raise NotApplicable("the model is in continuous time, the truth's impulse response is sampled")
    return impulse_error(judgement.dynamic, judgement.truth.model)


IMPULSE_ERROR = Metric(
    "impulse_error",
    "relative error of the first 200 Markov parameters (e_h)",
    _compute,
    tells="Error of the impulse response, in the mean square over its first 200 samples and all channels.",
    cannot_tell="What comes later, where the response lasts longer. Large responses govern it.",
    header="impulse error",
    unit="–",
    needs=frozenset({Need.IMPULSE, Need.TRUE_MODEL, Need.INPUT}),
    column=False,
)
