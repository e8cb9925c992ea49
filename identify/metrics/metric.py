"""Metric: one number (or one per output) that says what a model is worth, with all that tables and rankings need."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from identify.metrics.judgement import Judgement, predicts

FAMILY = "<h>"  # stands for the horizon in the name of a family of metrics
Value = float | Sequence[float] | np.ndarray  # one number, or one per output (ny,)
AHEAD = "{ahead}"  # stands for the horizon as time in a header


class NotApplicable(ExciteError):
    """A metric has no value in a case; the message says why.

    per_output : the values of the single outputs, where some of them have one.
    """

    def __init__(self, reason: str, per_output: Sequence[float] | np.ndarray = ()) -> None:
        super().__init__(reason)
        self.per_output = np.asarray(per_output, float)


class Need(Enum):
    """What a metric needs; where it is missing, the metric does not apply."""

    POLES = "a model with poles"
    SIMULATION = "a model that can be simulated"
    PREDICTION = "a model with a noise part"
    IMPULSE = "a model with an impulse response"
    RECORD = "a validation record"
    INPUT = "an input"
    CLEAN = "a noise-free twin of the validation record"
    TRUTH = "a known truth"
    TRUE_MODEL = "a truth that is more than a frequency response"

    def missing(self, judgement: Judgement) -> str | None:
        """Return why a judgement does not have it, or None."""
        model, case = judgement.model, judgement.case
        if self in ABILITIES:
            return None if isinstance(model, Dynamic) else f"{_kind(model)} {ABILITIES[self]}"
        if self is Need.PREDICTION:
            return None if predicts(model) else "the model has no noise part"
        if self is Need.RECORD:
            return "no validation record is given" if case.validation is None else None
        if self is Need.INPUT:
            return None if model.inputs else "the model has no input"
        if self is Need.CLEAN:
            return "no noise-free twin of the validation record is known" if case.clean is None else None
        if case.truth is None:
            return "no truth is known"
        if self is Need.TRUE_MODEL and not isinstance(case.truth.model, Dynamic):
            return f"the truth is {_kind(case.truth.model)} alone"
        return None


def _kind(model: Model) -> str:
    name = type(model).__name__
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


SIMULATED = frozenset({Need.CLEAN, Need.TRUTH, Need.TRUE_MODEL})  # what measured data lack as a rule

# What is said of a model that is no Dynamic.
ABILITIES = {
    Need.POLES: "has no poles",
    Need.SIMULATION: "cannot be simulated",
    Need.IMPULSE: "has no impulse response",
}


@dataclass(frozen=True, eq=False)
class Metric:
    """One metric; whoever shows, ranks by, stores or explains it reads this object.

    A family of metrics, one per prediction horizon, is a function horizon (samples) -> Metric. Its name in the registry
    has `<h>` in place of the horizon, as fit_<h>_step.

    Parameters
    ----------
    name : key in scenario files, scores and JSON.
    summary : what the number is, in one line.
    compute : Judgement -> number, or one number per output, whose mean is the value. It may count on its needs, and
        raises NotApplicable where it has no value for another reason.
    tells, cannot_tell : what a reader may conclude from it, and what not.
    header, unit : name and unit in tables; `{ahead}` in the header becomes the horizon as time.
    scale : factor from the value to the unit; decimals : shown, None for three digits.
    short : header in a terminal, with the unit.
    needs : what must be there.
    smaller_is_better, best : which way is better, and the value of a perfect model.
    lowest : values below are set to it, beside which `<name>_unclipped` keeps them.
    quartiles : tables show [q25 q75] behind the median.
    column, compact : whether the report's table has it, and the terminal's.
    horizon : samples, of a metric at one prediction horizon; longest : of its family only the longest is computed.
    exceptions : name of a conformance check that does not hold -> the reason.

    Examples
    --------
    >>> Metric("order", "number of poles", lambda judgement: len(judgement.dynamic.poles()), "How large the model is.",
    ...     "Whether it is right.", header="order", unit="–", needs=frozenset({Need.POLES})).title()
    'order [–]'
    """

    name: str
    summary: str
    compute: Callable[[Judgement], Value]
    tells: str
    cannot_tell: str
    header: str
    unit: str
    scale: float = 1.0
    decimals: int | None = None
    short: str = ""
    needs: frozenset[Need] = frozenset()
    smaller_is_better: bool = True
    best: float = 0.0
    lowest: float | None = None
    quartiles: bool = False
    column: bool = True
    compact: bool = False
    horizon: int | None = None
    longest: bool = False
    exceptions: Mapping[str, str] = field(default_factory=dict)

    def not_applicable(self, judgement: Judgement) -> str | None:
        """Return why the metric has no value for a judgement, or None."""
        if FAMILY in self.name:
            return f"{self.name} stands for a family; write the horizon in samples in place of {FAMILY}"
        reasons = (need.missing(judgement) for need in Need if need in self.needs)
        if reason := next(filter(None, reasons), None):
            return reason
        horizons = judgement.case.horizons
        if self.horizon is not None and self.horizon not in (
            [max(horizons)] if self.longest and horizons else horizons
        ):
            which = "longest horizon" if self.longest and horizons else "horizon"
            return f"{self.horizon} samples are no {which} that was asked for"
        return None

    def measure(self, judgement: Judgement) -> Value:
        """Return what `compute` returns; raises NotApplicable with the reason where a need is missing."""
        if reason := self.not_applicable(judgement):
            raise NotApplicable(reason)
        return self.compute(judgement)

    def loss(self, value: float) -> float:
        """Return how far a value is from that of a perfect model; smaller is better for every metric."""
        return value - self.best if self.smaller_is_better else self.best - value

    @property
    def needs_truth(self) -> bool:
        """Whether the metric compares with the truth."""
        return bool(self.needs & {Need.TRUTH, Need.TRUE_MODEL})

    @property
    def needs_data(self) -> bool:
        """Whether the metric looks at a validation record, measured or noise-free."""
        return bool(self.needs & {Need.RECORD, Need.CLEAN})

    def words(self, dt: float | None = None) -> str:
        """Return the header without its unit, the horizon in ms where the sampling time dt (s) is known."""
        return self.header.replace(AHEAD, self._ahead(dt))

    def title(self, dt: float | None = None) -> str:
        """Return the header with its unit, "pole error max [%]"."""
        return f"{self.words(dt)} [{self.unit}]"

    def short_title(self, dt: float | None = None) -> str:
        """Return the header for a terminal, "pole max %"."""
        return self.short.replace(AHEAD, self._ahead(dt)) or self.title(dt)

    def _ahead(self, dt: float | None) -> str:
        if self.horizon is None:
            return "… ms"
        return f"{self.horizon} samples" if dt is None else f"{self.horizon * dt * 1e3:.4g} ms"


def describe(metric: Metric) -> dict[str, Any]:
    """Return what there is to know about a metric as plain values: what `excite metrics NAME --json` prints."""
    return {
        "name": metric.name,
        "summary": metric.summary,
        "header": metric.title(),
        "unit": metric.unit,
        "scale": metric.scale,
        "smaller_is_better": metric.smaller_is_better,
        "best": metric.best,
        "needs": [need.value for need in Need if need in metric.needs],
        "tells": metric.tells,
        "cannot_tell": metric.cannot_tell,
    }
