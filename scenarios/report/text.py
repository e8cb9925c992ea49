"""A run, and a single estimate, as text for a terminal."""

from collections.abc import Mapping
from textwrap import wrap

import numpy as np

from excite.models.model import Dynamic
from excite.models.modes import DELAY, continuous_poles
from excite.types.channel import listed
from identify.estimate import Estimate, Status
from scenarios.report.tables import certificate_text, expectations, note, number, ranking, to_text
from scenarios.report.verdict import verdict
from scenarios.run.results import RunResult, ViewResult

WIDTH = 140


def summary_text(result: RunResult) -> list[str]:
    """Return what `excite run` prints: certificates, a ranking table per view, verdicts, expectations, where it lies."""
    lines = [result.scenario.name, result.scenario.description, ""]
    for view in result.views:
        lines += _view(result, view)
    if result.expectations:
        lines += [*to_text(*expectations(result)).splitlines(), ""]
    lines += [f"warning: {warning}" for warning in result.warnings]
    lines += [f"note: {note}" for note in result.notes]
    if result.old:
        lines.append(f"old: no longer asked for, and left where it is: {listed(result.old)}")
    return [*lines, f"report: {result.folder / 'report.html'}"]


def failures(result: RunResult) -> list[str]:
    """Return one line for each row that failed otherwise than with an answer in words."""
    return [
        f"{view.name}: {row.title}: {crashes[0]} (the traceback is in scores.json)"
        for view in result.views
        for row in view.comparison.rows
        if (crashes := [failure.reason for failure in row.failures if failure.traceback])
    ]


def _view(result: RunResult, view: ViewResult) -> list[str]:
    roles, name, found = view.view.roles, view.name, view.comparison
    kind = "in closed loop" if roles.closed else "inputs free of feedback"
    title = f"== {name}: {listed(roles.inputs)} -> {listed(roles.outputs)}; dt {found.uniform_dt * 1e3:g} ms; {kind}"
    lines = [title, *view.rule.notes]
    if view.predictor_radius is not None:
        lines.append(f"truth's predictor A - KC: spectral radius {view.predictor_radius:.4f}")
    judged = "reference" if roles.closed else "input"
    certificate = certificate_text(result.certificates[name])
    lines += [f"{judged}: {certificate[0]}", *(f"  {line}" for line in certificate[1:])]
    lines += ["", *to_text(*ranking(found, compact=True)).splitlines()]
    lines += [f"  {row.title}: {text}" for row in found.rows if (text := note(found, row))]
    return [*lines, *wrap(verdict(found), WIDTH), ""]


def pole_std(estimate: Estimate) -> np.ndarray | None:
    """Return the standard deviation of each pole where the estimate tells it."""
    known = estimate.uncertainty
    return None if known is None or known.withheld else np.sqrt(np.trace(known.poles(), axis1=1, axis2=2))


def estimate_text(estimate: Estimate, fit: Mapping[str, np.ndarray]) -> list[str]:
    """Return what `excite identify` prints: poles, singular values, fits, status and warnings."""
    model = estimate.model
    order = "" if estimate.order is None else f", order {estimate.order}"
    dt = "" if model.dt is None else f", dt {model.dt:g} s"
    lines = [f"{estimate.method}{order}{dt}, {estimate.seconds:.2f} s"]
    if estimate.route:
        condition = "" if estimate.condition is None else f", condition {number(estimate.condition)}"
        lines.append(f"data compressed by {estimate.route}{condition}")
    lines += _poles(estimate)
    if estimate.singular_values is not None:
        values = estimate.singular_values
        shown = values[: max(2 * (estimate.order or 0), 10)]
        lines.append("singular values " + " ".join(map(number, shown)) + (" …" if len(shown) < len(values) else ""))
    for name, values in fit.items():
        each = listed([f"{c.name} {v:.2f}" for c, v in zip(model.outputs, values, strict=True)])
        lines.append(f"fit on these data, {name.replace('_', ' ')}, %: {each}")
    if estimate.status is not Status.OK:
        lines.append(f"status: {estimate.status.value}")
    return lines + [f"warning: {warning}" for warning in estimate.warnings]


def _poles(estimate: Estimate) -> list[str]:
    """Return the poles of a model in the upper half plane: z-plane, or rad/s where the model is in continuous time."""
    model = estimate.model
    if not isinstance(model, Dynamic):
        return [f"a {type(model).__name__}: no poles"]
    poles = model.poles()
    lasting = np.abs(poles) > DELAY if model.dt is not None else np.ones(len(poles), bool)
    s = poles if model.dt is None else continuous_poles(poles, model.dt)
    headers = ["pole" if model.dt is not None else "pole rad/s", "frequency Hz", "damping"]
    std = pole_std(estimate)
    rows = [
        [
            f"{z.real:.4f}" + (f" ± {abs(z.imag):.4f}j" if z.imag else ""),
            number(abs(p) / (2 * np.pi)),
            number(-p.real / abs(p)),
        ]
        for z, p in zip(poles, s, strict=True)
    ]
    if std is not None:
        headers.append("standard deviation of the pole")
        rows = [[*row, number(each)] for row, each in zip(rows, std, strict=True)]
    lines = to_text(headers, [rows[k] for k in np.flatnonzero(lasting & (poles.imag >= 0))]).splitlines()
    if not lasting.all():
        lines.append(f"poles at the origin, which only delay: {np.sum(~lasting)}")
    return lines
