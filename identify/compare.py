"""Methods side by side: trials, what keeps them, and the comparison that is made of them."""

import traceback
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.digest import digest
from excite.errors import ExciteError, in_words
from excite.models.frequency_response import FrequencyResponse
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.data.records import Data, Records
from identify.entries import Entry, entries, packages_of
from identify.estimate import Estimate
from identify.fit import fit
from identify.method import Method
from identify.metrics.fits import floor_metric
from identify.metrics.frequency import band_of
from identify.metrics.ranking import ranking_value
from identify.metrics.registry import load_metric
from identify.registry import METHODS
from identify.score import UNCLIPPED, Score, absent, case_of, mean_score, score_in

STATISTICS = ("median", "q25", "q75", "min", "max", "mean")
RANK_BY = ("fit_simulation",)
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Failure:
    """Why a trial gave no estimate: one line for the reader, and the traceback where it was not an answer in words."""

    reason: str
    traceback: str | None = None

    @classmethod
    def of(cls, error: BaseException) -> "Failure":
        """Return what an error that is being handled says; an answer in words needs no traceback."""
        return cls(in_words(error), None if isinstance(error, ExciteError) else traceback.format_exc())


@dataclass(frozen=True, eq=False)
class Trial:
    """One entry at one order on one set of records: an estimate with its score, or a failure.

    order : as it was asked for; data : name of the records.
    """

    label: str
    method: str
    order: int | str | None
    data: str
    estimate: Estimate | None = None
    score: Score | None = None
    failure: Failure | None = None

    def under(self, label: str) -> "Trial":
        """Return the trial under another label."""
        return self if self.label == label else replace(self, label=label)


@dataclass(frozen=True, eq=False)
class Row:
    """All trials of one label and order; what tables and figures show on one line.

    summary : metric -> statistic -> value over the trials; reasons : metric -> why it has no value; rank_value :
    geometric mean of the losses of the ranking metrics (inf where a trial failed or a ranking metric does not apply);
    consistent_in_closed_loop : of the method; reason : why the row stands last, or None.
    """

    label: str
    method: str
    order: int | str | None
    consistent_in_closed_loop: bool
    trials: tuple[Trial, ...]
    summary: Mapping[str, Mapping[str, float]]
    reasons: Mapping[str, str]
    rank_value: float
    reason: str | None = None

    @property
    def title(self) -> str:
        """Label and order, for tables and legends."""
        return self.label if self.order is None else f"{self.label} n={self.order}"

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Those of the trials that gave one."""
        return tuple(trial.estimate for trial in self.trials if trial.estimate is not None)

    @property
    def scores(self) -> tuple[Score, ...]:
        """Those of the trials that gave one."""
        return tuple(trial.score for trial in self.trials if trial.score is not None)

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Those of the trials that failed."""
        return tuple(trial.failure for trial in self.trials if trial.failure is not None)

    def statistics(self, metric: str) -> Mapping[str, float]:
        """Return median, quartiles, … of a metric; NaN where it has none."""
        return self.summary.get(metric, dict.fromkeys(STATISTICS, float("nan")))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Rows, best first, and what they are judged against.

    name : of the view or the records; dt : s; closed : whether the input depended on the output; truth : at this rate,
    or None; truth_score : that of the truth itself; validation, clean : the first validation record as measured, and its
    noise-free twin where there is one; band_hz, horizons : what scores refer to (samples); rank_by : metrics.
    """

    name: str
    dt: float | None
    closed: bool
    rows: tuple[Row, ...]
    validation: Experiment | None
    rank_by: tuple[str, ...]
    truth: Truth | None = None
    truth_score: Score | None = None
    clean: Experiment | None = None
    band_hz: tuple[float, float] | None = None
    horizons: tuple[int, ...] = ()

    @property
    def uniform_dt(self) -> float:
        """The sampling time, s; raises ExciteError where the records have none."""
        if self.dt is None:
            raise ExciteError(
                f"{self.name}: sampling is not uniform, and one sampling time is needed; resample the record"
            )
        return self.dt

    @property
    def best(self) -> Row | None:
        """The first row that gave a model in every trial."""
        return next((row for row in self.rows if row.reason is None), None)

    @property
    def floor(self) -> tuple[str, float] | None:
        """The linearisation floor: its metric and the truth's value, None without a truth or where it has no value."""
        if self.truth is None or self.truth_score is None:
            return None
        name = floor_metric(self.truth, self.horizons)
        return (name, self.truth_score.values[name]) if name in self.truth_score.values else None

    @property
    def failed(self) -> bool:
        """Whether no trial gave an estimate."""
        return not any(row.estimates for row in self.rows)


class Judge:
    """Scores models on validation records and against the truth, where there is one.

    validation, clean : records, and their noise-free twins (none, or one each); truth : at the records' rate; horizons :
    further prediction horizons in samples.
    """

    def __init__(
        self,
        validation: Sequence[Experiment] = (),
        truth: Truth | None = None,
        *,
        clean: Sequence[Experiment] = (),
        horizons: Sequence[int] = (),
        band_hz: tuple[float, float] | None = None,
    ) -> None:
        self.validation, self.truth, self.clean, self.horizons = tuple(validation), truth, tuple(clean), tuple(horizons)
        twins = self.clean or (None,) * len(self.validation)
        self.cases = [
            case_of(measured, truth, horizons=self.horizons, band_hz=band_hz, clean=twin)
            for measured, twin in zip(self.validation or (None,), twins or (None,), strict=True)
        ]
        self.band_hz = band_hz if truth is None else band_of(self.cases[0])

    def __call__(self, model: Any) -> Score:
        """Return the mean score of an estimate or a model over the validation records."""
        return mean_score([score_in(case, model) for case in self.cases])

    def key(self) -> str:
        """Return a digest of all that a score depends on."""
        return digest(self.validation, self.clean, self.truth, self.horizons, self.band_hz)


def run_trials(
    chosen: Sequence[Entry],
    data: Data,
    judge: Judge,
    *,
    name: str = "data",
    store: MutableMapping[str, Trial] | None = None,
    base: str | None = None,
    progress: Progress = lambda done, total: None,
) -> tuple[Trial, ...]:
    """Return the trials of all entries and orders on one set of records.

    Parameters
    ----------
    name : of the records, in the trials.
    store : keeps every trial under its key as soon as it is finished, and gives back what it holds; a trial that is kept
        is not made again.
    base : digest of data and judge, where the caller knows it; else they are digested here.
    """
    store = {} if store is None else store
    base = digest(data, judge.key()) if base is None else base
    pairs = [(entry, order) for entry in chosen for order in entry.orders]
    shared: dict[Any, Any] = {}
    trials = []
    for done, (entry, order) in enumerate(pairs):
        key = trial_key(base, entry.method, order)
        kept = store.get(key)
        if kept is None:
            kept = _keep(store, key, _trial(entry, order, data, judge, name, shared))
        trials.append(kept.under(entry.label))
        progress(done + 1, len(pairs))
    return tuple(trials)


def trial_key(base: str, method: Method, order: int | str | None) -> str:
    """Return the key of a trial: digest of data and judge, the method with its settings, and the packages it rests on."""
    return digest(base, method.name, method.settings(), order, packages_of(method, order))


def _trial(entry: Entry, order: int | str | None, data: Data, judge: Judge, name: str, shared: dict[Any, Any]) -> Trial:
    """Fit and score; any exception but an interrupt is a failure of this trial alone."""
    known = entry.label, entry.method.name, order, name
    try:
        estimate = fit(data, entry.method, order, shared=shared)
        return Trial(*known, estimate=estimate, score=judge(estimate))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # of whatever kind, an exit among them: the other trials go on
        return Trial(*known, failure=Failure.of(error))


def _keep(store: MutableMapping[str, Trial], key: str, trial: Trial) -> Trial:
    """Put a trial into the store; an estimate that has no form to be kept in is a failure of this trial alone."""
    try:
        store[key] = trial
    except Exception as error:
        if isinstance(error.__cause__ or error.__context__, OSError):  # the store cannot be written
            raise
        trial = replace(trial, estimate=None, score=None, failure=Failure.of(error))
        store[key] = trial
    return trial


def compared(
    trials: Iterable[Trial],
    judge: Judge,
    *,
    name: str,
    rank_by: Sequence[str] = RANK_BY,
    closed: bool = False,
    consistent: Mapping[str, bool] | None = None,
) -> Comparison:
    """Return the comparison of trials, their rows ranked; rows without a ranking value stand last, with the reason.

    consistent : method -> whether it is consistent in closed loop, where it is no registered one.
    """
    groups: dict[tuple[str, Any], list[Trial]] = {}
    for trial in trials:
        groups.setdefault((trial.label, trial.order), []).append(trial)
    rows = [_row(tuple(group), tuple(rank_by), consistent or {}) for group in groups.values()]
    first = judge.validation[0] if judge.validation else None
    return Comparison(
        name=name,
        dt=judge.truth.model.dt if first is None and judge.truth is not None else None if first is None else first.dt,
        closed=closed,
        rows=tuple(sorted(rows, key=lambda row: (row.rank_value, _unclipped(row, rank_by[0])))),
        validation=first,
        rank_by=tuple(rank_by),
        truth=judge.truth,
        truth_score=None if judge.truth is None else judge(judge.truth.model),
        clean=judge.clean[0] if judge.clean else None,
        band_hz=judge.band_hz,
        horizons=judge.horizons,
    )


def _unclipped(row: Row, metric: str) -> float:
    """Return what orders rows of equal value: the fit below 0 that is clipped in tables."""
    median = row.statistics(metric + UNCLIPPED)["median"]
    return 0.0 if np.isnan(median) else -median


def _row(trials: tuple[Trial, ...], rank_by: tuple[str, ...], consistent: Mapping[str, bool]) -> Row:
    first = trials[0]
    scores = [trial.score for trial in trials if trial.score is not None]
    names = dict.fromkeys(name for score in scores for name in score.values)
    summary = {name: statistics([score.values.get(name, float("nan")) for score in scores]) for name in names}
    failed = [trial.failure for trial in trials if trial.failure is not None]
    reasons = absent(scores)
    medians = {name: each["median"] for name, each in summary.items()}
    value, reason = (np.inf, failed[0].reason) if failed else ranking_value(medians, reasons, rank_by)
    claim = consistent[first.method] if first.method in consistent else METHODS[first.method].consistent_in_closed_loop
    return Row(first.label, first.method, first.order, claim, trials, summary, reasons, value, reason)


def statistics(values: Sequence[float]) -> dict[str, float]:
    """Median, quartiles, extremes and mean; all NaN when any trial failed to give a number."""
    array = np.asarray(values, float)
    if array.size == 0 or np.isnan(array).any():
        return dict.fromkeys(STATISTICS, float("nan"))
    q25, median, q75 = np.percentile(array, [25, 50, 75])
    return dict(zip(STATISTICS, map(float, (median, q25, q75, array.min(), array.max(), array.mean())), strict=True))


def compare(
    data: Experiment | Iterable[Experiment] | Data,
    methods: str | Method | Entry | Iterable[str | Method | Entry],
    orders: int | str | Sequence[int | str | None] | None = None,
    validation: Experiment | None = None,
    truth: Truth | None = None,
    *,
    store: MutableMapping[str, Trial] | None = None,
    rank_by: Sequence[str] = RANK_BY,
    horizons: Sequence[int] = (),
    band_hz: tuple[float, float] | None = None,
    progress: Progress = lambda done, total: None,
) -> Comparison:
    """Compare methods on measured data: fit every method at every order, score on validation data, rank.

    Parameters
    ----------
    data : experiments to estimate from (all together), or a FrequencyResponse.
    methods : names, Methods with their settings, or Entries with labels of their own.
    orders : tried by each method that has an order; None leaves the choice to the method.
    validation : record to score on; without one, the metrics that need none remain.
    truth : what is known to be true, where the data are simulated.
    store : any mapping from key to Trial: what it holds is not computed again, and every trial is put there as soon as
        it is finished.
    rank_by : metrics; horizons : further prediction horizons in samples; band_hz : of the frequency-response errors.

    Examples
    --------
    >>> from identify.examples import series
    >>> data, truth = series()
    >>> found = compare(data.window(0, 1000), ["arx", "ssarx"], [2, 4], validation=data.window(1000))
    >>> len(found.rows), found.best.method in ("arx", "ssarx")
    (4, True)
    """
    if not rank_by:
        raise ExciteError("rank_by: is empty; give at least one metric")
    for metric in rank_by:
        load_metric(metric)  # refused now, and not after all the fits
    ready = data if isinstance(data, FrequencyResponse) else Records.of(data)
    chosen = entries(methods, orders)
    judge = Judge(() if validation is None else (validation,), truth, horizons=horizons, band_hz=band_hz)
    trials = run_trials(chosen, ready, judge, store=store, progress=progress)
    claims = {entry.method.name: entry.method.consistent_in_closed_loop for entry in chosen}
    closed = isinstance(ready, Records) and ready.closed
    return compared(trials, judge, name="data", rank_by=rank_by, closed=closed, consistent=claims)
