"""Replicates: the scatter of models that were estimated again and again."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.estimate import Estimate
from identify.fit import fit
from identify.method import Method
from identify.registry import load_method
from identify.uncertainty.uncertainty import Uncertainty

FEWEST = 10


@dataclass(frozen=True, eq=False)
class Replicates(Uncertainty):
    """The sample covariance of functions over several models, from a bootstrap or a Monte Carlo study."""

    model: Model
    models: tuple[Model, ...]
    kind: str = "bootstrap"
    withheld: str | None = None

    def __post_init__(self) -> None:
        if len(self.models) < FEWEST:
            raise ExciteError(f"Replicates: {len(self.models)} models; give at least {FEWEST}")

    def of(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Return the sample covariance (m, m) of a real function of the model."""
        values = np.array([np.ravel(function(model)) for model in self.models])
        return np.atleast_2d(np.cov(values.T))


def bootstrap(
    estimate: Estimate,
    data: Experiment | Iterable[Experiment] | Records,
    replicates: int = 100,
    seed: int = 0,
    block: int | None = None,
    method: Method | None = None,
) -> Estimate:
    """Return the estimate with the uncertainty of a block bootstrap of its simulation residuals.

    Each replicate is identified from yhat + e*, where e* are blocks of the residuals y - yhat drawn with replacement
    (Künsch 1989), long enough to keep their correlation. It holds in open loop, where the noise does not move u.

    Parameters
    ----------
    data : those the estimate was made from, without missing samples.
    replicates, seed : number of models, and of their random stream.
    block : samples per block, the cube root of the record's length by default.
    method : the method with its settings, where it is no registered one.
    """
    records, model = Records.of(data), estimate.model
    if not isinstance(model, Dynamic):
        raise ExciteError(
            f"bootstrap: a {type(model).__name__} cannot be simulated; take a method with a dynamic model"
        )
    if records.closed:
        raise ExciteError("bootstrap: the data were taken in closed loop, where the noise moves the input too")
    if any(record.incomplete is not None for record in records.measured):
        raise ExciteError("bootstrap: samples are missing; give the gap-free parts as separate records")
    chosen = method or load_method(estimate.method, **estimate.settings)
    rng, models = np.random.default_rng(seed), []
    x0 = estimate.x0 or (None,) * len(records)
    fitted = [model.simulate(record.u, x) for record, x in zip(records.measured, x0, strict=True)]
    for _ in range(replicates):
        again = [
            replace(record, y=yhat + _blocks(record.y - yhat, block, rng), references=record.references or None)
            for record, yhat in zip(records.measured, fitted, strict=True)
        ]
        models.append(fit(again, chosen, estimate.order).model)
    return replace(estimate, uncertainty=Replicates(model, tuple(models)))


def _blocks(residual: np.ndarray, block: int | None, rng: np.random.Generator) -> np.ndarray:
    """Return as many samples, made of blocks of the residual (N, ny) about its mean, drawn with replacement."""
    N = len(residual)
    block = min(N, block or max(1, round(N ** (1 / 3))))
    starts = rng.integers(N - block + 1, size=-(-N // block))
    index = (starts[:, None] + np.arange(block)).ravel()[:N]
    return (residual - residual.mean(0))[index]
