"""Which method to trust in a view, and why, in words."""

from collections.abc import Sequence

import numpy as np

from excite.models.modes import continuous_poles
from excite.words import number
from identify.compare import Comparison, Row
from identify.metrics.poles import pole_errors
from identify.metrics.registry import load_metric
from scenarios.report.columns import complex_text
from scenarios.report.rows import diverging, first_estimate, sound, trusted
from scenarios.run.results import RunResult

MANY = 1000  # ratio of ranking values beyond which its digits say nothing
FAR = 0.1  # pole error beyond which the verdict says which pole is meant


def verdict(found: Comparison) -> str:
    """Return in a few sentences which row of a comparison to trust, how good it is, and how clear its lead is."""
    (name, row), rank_by = (found.name, trusted(found)), found.rank_by
    if row is None:
        reasons = "; ".join(dict.fromkeys(r.reason for r in found.rows if r.reason)) or "none was run"
        what = "gave a model" if all(first_estimate(r) is None for r in found.rows) else "can be ranked"
        return f"{name}: no method {what} ({reasons})."
    good = sound(found)
    runs = f"median of {len(row.scores)} runs" if len(row.scores) > 1 else "one run"
    order = "" if row.order is None else f" at order {row.order}"
    sentences = [f"{name}: trust {row.label}{order} ({', '.join(_values(found, row, rank_by))}; {runs})."]
    first = next(r for r in found.rows if r.reason is None)
    if not good:
        sentences.append("Beware: the input depends on the output through feedback, which biases every method run.")
    elif first is not row:
        sentences.append(f"{first.title} ranks higher here, but is biased in closed loop.")
    rival = next((r for r in good if r.label != row.label), None)
    if rival is not None and np.isfinite(rival.rank_value) and row.rank_value > 0:
        ratio = rival.rank_value / row.rank_value
        times = number(ratio) if ratio < MANY else f"more than {MANY:g}"
        unclear = "; their quartiles overlap, so that this may be chance" if _overlap(row, rival, rank_by) else ""
        sentences.append(f"Next comes {rival.title}, its ranking value {times} times as large{unclear}.")
    if found.truth is not None and row.statistics("pole_error_max")["median"] > FAR:
        sentences.append(_worst_pole(found, row))
    if count := diverging(row):
        sentences.append(
            f"Simulated over the whole validation run it diverges in {count} of {len(row.scores)} runs, as integrating or "
            "very slow poles do when they are a little off: use it over limited horizons."
        )
    if found.floor is not None:
        metric, floor = found.floor
        fit = row.statistics(metric)["median"]
        if np.isfinite(fit):
            words = load_metric(metric).words(found.dt)
            sentences.append(
                f"{words[0].upper()}{words[1:]}: {fit:.1f} %, where the linearised truth itself reaches {floor:.1f} %."
            )
    return " ".join(sentences)


def summary(result: RunResult) -> list[str]:
    """Return what was designed and flown, a verdict for each view, and how the expectations came out."""
    scenario, signal = result.scenario, result.signal
    period = f" (period {signal.period * signal.dt:.4g} s)" if signal.period else ""
    kind = "signal" if signal.recipe is None else signal.recipe.kind
    paragraphs = [
        f"A {kind} of {signal.duration_s:.4g} s on {_count(signal.u.shape[1], 'channel')}{period} was designed and "
        f"played on {scenario.plant.name} at its injection point {scenario.inject}: "
        f"{_count(scenario.estimation_runs, 'run')} to estimate from, {_count(scenario.validation_runs, 'run')} with "
        "fresh excitation and noise to validate on."
    ]
    paragraphs += [verdict(view.comparison) for view in result.views]
    if result.expectations:
        met = sum(met for *_, met in result.expectations)
        paragraphs.append(f"Expectations met: {met} of {len(result.expectations)}.")
    return paragraphs


def _worst_pole(found: Comparison, row: Row) -> str:
    """Return which true pole the row's first run misses most."""
    estimate, truth, dt = first_estimate(row), found.truth, found.uniform_dt
    assert estimate is not None and truth is not None  # the metric that brought us here has a value
    errors = pole_errors(truth.poles, estimate.dynamic.poles(), dt)
    if errors.missing:
        return f"{errors.missing} of the truth's poles have no counterpart in the model of the first run."
    k = int(np.argmax(errors.relative))
    pole = complex_text(continuous_poles(errors.true[k : k + 1], dt)[0])
    return f"Not every pole is found well: in the first run, that at {pole} rad/s is off by {100 * errors.relative[k]:.3g} %."


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _values(found: Comparison, row: Row, names: Sequence[str]) -> list[str]:
    """Return the medians of metrics with the names and units of the table."""
    texts = []
    for metric in map(load_metric, names):
        text = f"{metric.words(found.dt)} {number(metric.scale * row.statistics(metric.name)['median'])}"
        texts.append(text if metric.unit == "–" else f"{text} {metric.unit}")
    return texts


def _overlap(a: Row, b: Row, metrics: Sequence[str]) -> bool:
    """Whether the quartile ranges of two rows meet in every metric; a single run tells nothing."""
    if min(len(a.scores), len(b.scores)) < 2:
        return False
    pairs = [(a.statistics(m), b.statistics(m)) for m in metrics]
    return all(x["q25"] <= y["q75"] and y["q25"] <= x["q75"] for x, y in pairs)
