"""Which method to trust in a view, and why, in words."""

from collections.abc import Sequence

import numpy as np

from excite.words import number
from identify.metrics.metrics import continuous_poles, pole_errors
from scenarios.report.columns import COLUMNS, columns_of, complex_text
from scenarios.report.rows import diverging, first_estimate, sound, spread, trusted
from scenarios.run.results import Row, RunResult, ViewResult

FAR = 0.1  # pole error beyond which the verdict says which pole is meant


def verdict(view: ViewResult, rank_by: Sequence[str]) -> str:
    """Return in a few sentences which row of a view to trust, how good it is, and how clear its lead is."""
    name, row = view.spec.name, trusted(view)
    if row is None:
        reasons = "; ".join(dict.fromkeys(r.reason for r in view.rows if r.reason)) or "none was run"
        return f"{name}: no method gave a model ({reasons})."
    good = sound(view)
    runs = f"median of {len(row.scores)} runs" if len(row.scores) > 1 else "one run"
    sentences = [f"{name}: trust {row.method} at order {row.order} ({', '.join(_values(row, rank_by))}; {runs})."]
    first = next(r for r in view.rows if r.reason is None)
    if not good:
        sentences.append("Beware: the input depends on the output through feedback, which biases every method run.")
    elif first is not row:
        sentences.append(f"{first.label} ranks higher here, but is biased in closed loop.")
    rival = next((r for r in good if r.method != row.method), None)
    if rival is not None and np.isfinite(rival.rank_value) and row.rank_value > 0:
        ratio = number(rival.rank_value / row.rank_value)
        unclear = "; their quartiles overlap, so that this may be chance" if _overlap(row, rival, rank_by) else ""
        sentences.append(f"Next comes {rival.label}, its ranking value {ratio} times as large{unclear}.")
    if view.truth is not None and spread(row, "pole_error_max")["median"] > FAR:
        sentences.append(_worst_pole(view, row))
    if count := diverging(row):
        sentences.append(
            f"Simulated over the whole validation run it diverges in {count} of {len(row.scores)} runs, as integrating or "
            "very slow poles do when they are a little off: use it over limited horizons."
        )
    if view.floor is not None:
        metric, floor = view.floor
        fit = spread(row, metric)["median"]
        ahead = next((c.header for c in columns_of(view)[0] if c.metric == metric), metric)
        if np.isfinite(fit):
            sentences.append(
                f"{_sentence(ahead)}: {fit:.1f} %, where the linearised truth itself reaches {floor:.1f} %."
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
    paragraphs += [verdict(view, scenario.rank_by) for view in result.views]
    if result.expectations:
        met = sum(met for *_, met in result.expectations)
        paragraphs.append(f"Expectations met: {met} of {len(result.expectations)}.")
    return paragraphs


def _worst_pole(view: ViewResult, row: Row) -> str:
    """Return which true pole the row's first run misses most."""
    errors = pole_errors(view.truth.poles, first_estimate(row).model.poles(), view.dt)
    if errors.missing:
        return "Not every pole is found: the order is below that of the truth."
    k = int(np.argmax(errors.relative))
    pole = complex_text(continuous_poles(errors.true[k : k + 1], view.dt)[0])
    return f"Not every pole is found well: in the first run, that at {pole} rad/s is off by {100 * errors.relative[k]:.3g} %."


def _sentence(header: str) -> str:
    text = header.removesuffix(" [%]")
    return text[0].upper() + text[1:]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _values(row: Row, metrics: Sequence[str]) -> list[str]:
    """Return the medians of metrics with the names and units of the table."""
    columns = {column.metric: column for column in COLUMNS}
    texts = []
    for metric in metrics:
        column = columns.get(metric)
        name, unit = column.header[:-1].split(" [") if column else (metric, "–")
        value = number((column.scale if column else 1) * spread(row, metric)["median"])
        texts.append(f"{name} {value}" if unit == "–" else f"{name} {value} {unit}")
    return texts


def _overlap(a: Row, b: Row, metrics: Sequence[str]) -> bool:
    """Whether the quartile ranges of two rows meet in every metric; a single run tells nothing."""
    if min(len(a.scores), len(b.scores)) < 2:
        return False
    pairs = [(spread(a, m), spread(b, m)) for m in metrics]
    return all(x["q25"] <= y["q75"] and y["q25"] <= x["q75"] for x, y in pairs)
