"""Rows of text from a run, for the terminal and the page alike."""

import re
from collections.abc import Sequence

import numpy as np

from excite.models.model import Dynamic
from excite.models.modes import continuous_poles
from excite.persistency.certificate import Certificate
from excite.words import NONE, joined, number
from identify.compare import Comparison, Row
from identify.estimate import Status
from identify.metrics.metric import Metric, Need
from identify.metrics.poles import pole_errors
from identify.score import by_reason
from scenarios.report.columns import columns_of, complex_text
from scenarios.report.rows import diverging, first_estimate, trusted
from scenarios.run.results import RunResult

Table = tuple[list[str], list[list[str]]]


def ranking(found: Comparison, compact: bool = False) -> Table:
    """Return the methods of one comparison, best first, below what the truth itself reaches; empty columns are dropped.

    compact : only the columns that fit a terminal, with short headers and without the notes.
    """
    columns, names = columns_of(found, compact)
    rows, rank = _truth_rows(found, columns, compact), 0
    for row in found.rows:
        rank += row.reason is None
        cells = [_cell(row, c, compact and k > 0) for k, c in enumerate(columns)]
        place, order = str(rank) if row.reason is None else NONE, NONE if row.order is None else str(row.order)
        rows.append([place, row.label, order, *cells, note(found, row)])
    headers = ["rank", "method", "order", *names, "note"]
    keep = [k for k in range(len(headers) - compact) if k < 3 or any(row[k] not in (NONE, "") for row in rows)]
    return [headers[k] for k in keep], [[row[k] for k in keep] for row in rows]


def _truth_rows(found: Comparison, columns: Sequence[Metric], compact: bool) -> list[list[str]]:
    """Return what the truth itself reaches: without noise (the linearisation floor), and on the measured run."""
    reached = found.truth_score
    if reached is None:
        return []
    names = (
        ("linearisation floor", "truth, measured")
        if compact
        else ("linearisation floor (noise-free truth)", "truth on the measured run")
    )

    def cell(metric: Metric, record: Need) -> str:
        judged = record in metric.needs and not metric.needs_truth
        value = reached.values.get(metric.name, np.nan) if judged else np.nan
        return number(metric.scale * value, metric.decimals)

    records = zip(names, (Need.CLEAN, Need.RECORD), strict=True)
    return [["", name, "", *(cell(metric, record) for metric in columns), ""] for name, record in records]


def _cell(row: Row, metric: Metric, plain: bool) -> str:
    statistic = row.statistics(metric.name)
    texts = {k: number(metric.scale * statistic[k], metric.decimals) for k in ("median", "q25", "q75")}
    if plain or not metric.quartiles or len(row.scores) < 2 or texts["median"] == NONE:
        return texts["median"]
    return f"{texts['median']} [{texts['q25']} {texts['q75']}]"


def note(found: Comparison, row: Row) -> str:
    """Return what must be known about a row beside its numbers."""
    if row.failures:
        count, reason = len(row.trials), row.failures[0].reason
        return f"failed in {len(row.failures)} of {count} runs: {reason}" if count > 1 else reason
    notes = [f"not ranked by {row.reason}"] if row.reason is not None else []
    if isinstance(row.order, str):
        notes.append(f"order {joined(sorted({str(e.order) for e in row.estimates}))} chosen")
    if found.closed and not row.consistent_in_closed_loop:
        notes.append("biased in closed loop")
    unstable = sum(e.status is Status.UNSTABLE for e in row.estimates)
    if unstable:
        notes.append(f"unstable in {unstable} of {len(row.estimates)} runs")
    if count := diverging(row):
        notes.append(f"simulation diverges in {count} of {len(row.scores)} runs")
    for metric, text in (("poles_missing", "missing"), ("poles_surplus", "surplus")):
        poles = row.statistics(metric)["median"]
        if poles > 0:
            notes.append(f"{poles:.0f} {text} pole{'s' if poles > 1 else ''}")
    return "; ".join(notes + _without_value(found, row))


def _without_value(found: Comparison, row: Row) -> list[str]:
    """Return which metrics that others have the row lacks, and why."""
    lacking = {
        metric.words(found.dt): row.reasons[metric.name]
        for metric in columns_of(found)[0]
        if metric.name in row.reasons and not _has_value(row, metric) and any(_has_value(r, metric) for r in found.rows)
    }
    return [f"no {', '.join(names)}: {reason}" for reason, names in by_reason(lacking).items()]


def _has_value(row: Row, metric: Metric) -> bool:
    return bool(np.isfinite(row.statistics(metric.name)["median"]))


def true_poles(found: Comparison) -> Table:
    """Return the truth's poles (upper half plane) with what the trusted row's first run found for each."""
    row = trusted(found)
    estimate = first_estimate(row) if row is not None else None
    if estimate is not None and not isinstance(estimate.model, Dynamic):
        estimate = None  # a model without poles
    headers = ["kind", "pole [rad/s]", "|s| [rad/s]", "frequency [Hz]", "damping [–]", "time constant [s]"]
    if found.truth is None:
        return headers, []
    z, dt = found.truth.poles, found.uniform_dt
    matched = pole_errors(z, z if estimate is None else estimate.dynamic.poles(), dt)
    s, s_hat = (continuous_poles(p, dt) for p in (matched.true, matched.estimated))
    if estimate is not None and row is not None:
        headers += [f"{row.title}, first run [rad/s]", "error [%]"]
    rows = []
    for k in np.lexsort((s.imag, np.abs(s))):
        if s[k].imag < -1e-9 * max(abs(s[k]), 1):
            continue
        size, kind = abs(s[k]), matched.kind[k]
        integrator = kind == "integrator"
        texts = [kind, "0" if integrator else complex_text(s[k]), "0" if integrator else number(size)]
        texts += [number(size / (2 * np.pi)) if kind == "oscillatory" else NONE]
        texts += [number(-s[k].real / size) if kind == "oscillatory" else NONE]
        texts += [number(-1 / s[k].real) if kind == "real" else NONE]
        if estimate is not None:
            texts += [complex_text(s_hat[k]), number(100 * matched.relative[k])]
        rows.append(texts)
    return headers, rows


def expectations(result: RunResult) -> Table:
    """Return what the scenario expects, what came out, and whether it was met."""
    rows = [
        [e.key, f"{e.comparison} {e.bound:g}", NONE if np.isnan(value) else f"{value:.4g}", "met" if met else "missed"]
        for e, value, met in result.expectations
    ]
    return ["expectation", "bound", "value", "verdict"], rows


def certificate_text(cert: Certificate) -> list[str]:
    """Return the certificate of persistency in lines for a reader."""
    lines = [
        f"persistently exciting of order {cert.order}{'' if cert.reached else ' only'} ({cert.block_rows} asked for), "
        f"{cert.samples} samples of {cert.dt:g} s",
        f"margin {number(cert.margin)} of the channels' rms; condition of the input matrix {number(cert.condition)}",
    ]
    if cert.line_order is not None:
        lines.append(f"order by counting spectral lines of one period: {cert.line_order}")
    bands = ", ".join(f"{number(a)} to {number(b)} Hz" for a, b in cert.missing_hz)
    lines.append(f"bands without excitation: {bands or 'none up to the Nyquist frequency'}")
    lines += [
        f"{name}: rms {number(rms)}, peak {number(peak)}, crest factor {number(peak / rms) if rms else NONE}"
        for name, rms, peak in zip(cert.channels, cert.rms, cert.peak, strict=True)
    ]
    if cert.usable_response_s is not None:
        lines.append(f"responses of the channels stay apart for {number(cert.usable_response_s)} s")
    return lines + [f"warning: {warning}" for warning in cert.warnings]


def to_text(headers: Sequence[str], rows: Sequence[Sequence[str]], width: int = 140) -> str:
    """Return aligned columns, numbers to the right; only the last column is shortened, to keep within `width`."""
    columns = list(zip(headers, *rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    spare = width - sum(widths[:-1]) - 2 * (len(widths) - 1)
    widths[-1] = min(widths[-1], max(spare, len(headers[-1]), 12))
    numeric = [all(c in ("", NONE) or re.match(r"[-−∞<>=\d]", c) for c in column[1:]) for column in columns]
    lines = []
    for row in (headers, *rows):
        cells = [c if len(c) <= w else c[: w - 1] + "…" for c, w in zip(row, widths, strict=True)]
        padded = [c.rjust(w) if right else c.ljust(w) for c, w, right in zip(cells, widths, numeric, strict=True)]
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)
