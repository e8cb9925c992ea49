"""Methods side by side: trials, and the comparison that is made of them."""

from collections.abc import Mapping
from dataclasses import dataclass

from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.estimate import Estimate
from identify.score import Score


@dataclass(frozen=True)
class Failure:
    """Why a trial gave no estimate: one line for the reader, and the traceback where it was not an answer in words."""

    reason: str
    traceback: str | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """One method with its settings, at one order, on one set of records: an estimate with its score, or a failure.

    label : what tables call the method with these settings; data : name of the records.
    """

    label: str
    method: str
    order: int | None
    data: str
    estimate: Estimate | None = None
    score: Score | None = None
    failure: Failure | None = None


@dataclass(frozen=True, eq=False)
class Row:
    """All trials of one label and order; what tables and figures show on one line.

    summary : metric -> statistic -> value over the trials; rank_value : geometric mean of the medians of the ranking
    metrics (inf where it failed or a ranking metric does not apply); consistent_in_closed_loop : of the method;
    reason : why it stands last, or None.
    """

    label: str
    method: str
    order: int | None
    consistent_in_closed_loop: bool
    trials: tuple[Trial, ...]
    summary: Mapping[str, Mapping[str, float]]
    rank_value: float
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Rows, best first, and what they are judged against.

    name : of the view or the records; dt : s; closed : whether the input depended on the output; truth : at this rate,
    or None; truth_score : that of the truth itself; validation, clean : the validation record as measured, and its
    noise-free twin where there is one; band_hz, horizons_s : what scores refer to; rank_by : metrics.
    """

    name: str
    dt: float
    closed: bool
    rows: tuple[Row, ...]
    validation: Experiment | None
    rank_by: tuple[str, ...]
    truth: Truth | None = None
    truth_score: Score | None = None
    clean: Experiment | None = None
    band_hz: tuple[float, float] | None = None
    horizons_s: tuple[float, ...] = ()
