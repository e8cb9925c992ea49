"""Score: every metric of one estimate on one record, and against the truth where it is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.errors import ExciteError, in_words
from excite.models.model import Dynamic, Model, Predictor
from excite.types.channel import Channel, listed
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.metrics.judgement import Case, Judgement
from identify.metrics.metric import Metric, NotApplicable, Value
from identify.metrics.registry import metrics_at
from identify.steps.initial_state import initial_state
from identify.steps.threads import blas_threads

UNCLIPPED = "_unclipped"
SAME_RATE = 1e-6  # relative difference of two sampling times that are the same


@dataclass(frozen=True)
class Score:
    """What the metrics say of one estimate.

    Parameters
    ----------
    values : metric -> value, finite; only of the metrics that apply. Fit and VAF are clipped at 0, `…_unclipped` beside
        them are not.
    per_output : metric -> one value per output, of fit and VAF; NaN for an output that has none.
    reason : why there is no score at all, or None.
    reasons : metric -> why it has no value.
    """

    values: Mapping[str, float]
    per_output: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    reason: str | None = None
    reasons: Mapping[str, str] = field(default_factory=dict)


def score(
    estimate: Estimate | Model,
    validation: Experiment | None,
    truth: Truth | None = None,
    *,
    horizons: Sequence[int] = (),
    band_hz: tuple[float, float] | None = None,
    clean: Experiment | None = None,
) -> Score:
    """Score an estimate (or a model) on a validation record, and against the truth when it is given.

    Simulation and one-step prediction start from the initial state that fits the record best; where samples are missing,
    each gap-free part does. Metrics that do not apply to the model, or to what is known, have a reason instead of a value.

    Parameters
    ----------
    validation : the record, or None to judge against the truth alone.
    truth : at the model's rate.
    horizons : further prediction horizons in samples, reported as fit_<h>_step.
    band_hz : low and high frequency of the frequency-response errors; None follows from the truth's poles.
    clean : the noise-free twin of a simulated validation run, scored as fit_clean (simulation) and, at the longest
        horizon, fit_clean_<h>_step.

    Raises
    ------
    ExciteError : the record or the truth has another sampling time or other channels than the model, or no sample of the
        record is complete.

    Examples
    --------
    >>> from excite import Experiment, StateSpaceModel
    >>> model = StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=1.0)
    >>> u = [1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0]
    >>> data = Experiment(u, model.simulate(Experiment(u, u, dt=1.0).u), dt=1.0)
    >>> result = score(model, data)
    >>> round(result.values["fit_simulation"], 6), result.reasons["fit_one_step"]
    (100.0, 'the model has no noise part')
    """
    return score_in(case_of(validation, truth, horizons=horizons, band_hz=band_hz, clean=clean), estimate)


def case_of(
    validation: Experiment | None,
    truth: Truth | None = None,
    *,
    horizons: Sequence[int] = (),
    band_hz: tuple[float, float] | None = None,
    clean: Experiment | None = None,
) -> Case:
    """Return what `score` judges on, for any number of models: what is known of the truth is then derived once."""
    return Case(predictions, validation, truth, clean, tuple(horizons), band_hz)


def score_in(case: Case, estimate: Estimate | Model) -> Score:
    """Score an estimate (or a model) in a case."""
    model = estimate.model if isinstance(estimate, Estimate) else estimate
    if case.validation is not None:
        check_same_system(model, case.validation)
        gap_free((case.validation,), 1)  # refuses a record without a complete sample
    if case.truth is not None:
        _check_same_truth(model, case.truth.model)
    with blas_threads(len(model.inputs) + len(model.outputs)):
        return _scored(Judgement(model, case))


def _scored(judgement: Judgement) -> Score:
    """Return the values of all metrics, and why some have none."""
    values: dict[str, float] = {}
    per_output: dict[str, tuple[float, ...]] = {}
    reasons: dict[str, str] = {}
    for metric in metrics_at(judgement.case.horizons):
        found: Value = ()
        try:
            found = np.asarray(metric.measure(judgement), float)
        except NotApplicable as error:
            reasons[metric.name], found = str(error), error.per_output
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a metric, perhaps of another package, that fails takes nothing else with it
            reasons[metric.name] = in_words(error)
        _enter(metric, found, values, per_output, reasons)
    return Score(values, per_output, None, reasons)


def _enter(
    metric: Metric,
    found: Value,
    values: dict[str, float],
    per_output: dict[str, tuple[float, ...]],
    reasons: dict[str, str],
) -> None:
    """Put what a metric found under its name: clipped, and as it is under `…_unclipped`."""
    raw = np.asarray(found, float)
    versions = {metric.name: raw if metric.lowest is None else np.maximum(raw, metric.lowest)}
    if metric.lowest is not None:
        versions[metric.name + UNCLIPPED] = raw
    for name, each in versions.items():
        if each.ndim and each.size:
            per_output[name] = tuple(each.tolist())
    if metric.name in reasons:
        return
    if not raw.size or not np.isfinite(raw).all():
        reasons[metric.name] = f"comes out as {', '.join(f'{value:g}' for value in np.atleast_1d(raw)) or 'nothing'}"
        return
    values |= {name: float(np.mean(each)) for name, each in versions.items()}


def mean_score(scores: Sequence[Score]) -> Score:
    """Return the mean of one model's scores on several records; what one of them lacks has no mean."""
    values = {
        name: float(np.mean([s.values[name] for s in scores]))
        for name in scores[0].values
        if all(name in s.values for s in scores)
    }
    per_output = {
        name: tuple(np.mean([s.per_output[name] for s in scores], axis=0).tolist())
        for name in scores[0].per_output
        if all(name in s.per_output for s in scores)
    }
    reasons = {name: reason for s in reversed(scores) for name, reason in s.reasons.items()}
    return Score(values, per_output, next((s.reason for s in scores if s.reason), None), reasons)


def absent(scores: Sequence[Score]) -> dict[str, str]:
    """Return metric -> why it has no value in every one of several runs, with the number of runs where it is not all."""
    reasons: dict[str, list[str]] = {}
    for each in scores:
        for name, reason in each.reasons.items():
            reasons.setdefault(name, []).append(reason)
    count = len(scores)
    return {
        name: found[0] if len(found) == count else f"in {len(found)} of {count} runs: {found[0]}"
        for name, found in reasons.items()
    }


def by_reason(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Return reason -> the metrics that have no value for it."""
    groups: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        groups.setdefault(reason, []).append(name)
    return groups


def predictions(model: Dynamic, experiment: Experiment, horizons: Sequence[int] = ()) -> dict[str, np.ndarray]:
    """Return yhat (N, ny) by name: simulation, one_step, and <h>_step for the further horizons."""
    x0 = initial_state(model, experiment, predictor=False)
    with np.errstate(over="ignore", invalid="ignore"):
        yhat = {"simulation": model.response(experiment, x0)}
        if isinstance(model, Predictor) and model.predicts:
            x0 = initial_state(model, experiment, predictor=True)
            ahead = model.predictions(experiment, (1, *horizons), x0)
            yhat |= dict(zip(("one_step", *(f"{h}_step" for h in horizons)), ahead, strict=True))
    return yhat


def _check_same_truth(model: Model, true: Model) -> None:
    """Refuse to compare a model with a truth of another rate or other channel counts."""
    if model.dt is not None and true.dt is not None and abs(model.dt / true.dt - 1) > SAME_RATE:
        raise ExciteError(f"truth has dt {true.dt} s, the model {model.dt} s; lift the truth to the model's rate")
    for what in ("inputs", "outputs"):
        if len(getattr(model, what)) != len(getattr(true, what)):
            raise ExciteError(
                f"truth has {len(getattr(true, what))} {what}, the model {len(getattr(model, what))}; choose the channels"
            )


def check_same_system(model: Model, experiment: Experiment) -> None:
    """Refuse to score a model on a record of another rate, or whose channels are known to be others.

    One in continuous time fits any rate; names that have nothing in common are taken to be two spellings of the same.
    """
    if model.dt is not None and (experiment.dt is None or abs(model.dt / experiment.dt - 1) > SAME_RATE):
        raise ExciteError(f"the model has dt {model.dt} s, the record {experiment.dt} s; resample the record")
    for what, columns in (("inputs", experiment.u), ("outputs", experiment.y)):
        if len(getattr(model, what)) != columns.shape[1]:
            raise ExciteError(
                f"the model has {len(getattr(model, what))} {what}, the record {columns.shape[1]}; choose the channels"
            )
        _check_same_channels(getattr(model, what), getattr(experiment, what), what)


def _check_same_channels(of_model: Sequence[Channel], of_record: Sequence[Channel], what: str) -> None:
    """Refuse the same names in another order, and another unit of the same name."""
    names, others = ([c.name for c in channels] for channels in (of_model, of_record))
    if names != others and sorted(names) == sorted(others):
        raise ExciteError(
            f"the model's {what} are {listed(of_model)}, the record's {listed(of_record)}; give them in the model's order"
        )
    for mine, other in zip(of_model, of_record, strict=True):
        if mine.name == other.name and mine.unit and other.unit and mine.unit != other.unit:
            raise ExciteError(
                f"{what}: '{mine.name}' is in {mine.unit} in the model and in {other.unit} in the record; convert one"
            )
