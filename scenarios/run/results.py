"""What a run leaves behind, as data: the table, the figures and the report are made from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.persistency.certificate import Certificate
from excite.types.signal import Signal
from identify.compare import STATISTICS, Comparison, Row
from identify.steps.kalman import spectral_radius
from scenarios.run.pieces import View
from scenarios.scenario.sampling_rule import Horizons
from scenarios.scenario.spec import Expectation, Scenario


@dataclass(frozen=True, eq=False)
class ViewResult:
    """One view of a run: what was identified, by which design rule, and the comparison of its methods."""

    view: View
    rule: Horizons
    comparison: Comparison

    @property
    def name(self) -> str:
        """Name of the view."""
        return self.view.name

    @property
    def predictor_radius(self) -> float | None:
        """Spectral radius of the truth's A - K C, None without a noise model."""
        truth = self.comparison.truth
        model = None if truth is None else truth.model
        return None if model is None or model.K is None else spectral_radius(model.A - model.K @ model.C)


@dataclass(frozen=True, eq=False)
class RunResult:
    """A finished run.

    certificates : by view, at its rate; expectations : (expectation, value, met); warnings : of the design; notes : what
    was made again, and why; old : pieces in the folder that the scenario no longer asks for.
    """

    scenario: Scenario
    folder: Path
    signal: Signal
    certificates: Mapping[str, Certificate]
    views: tuple[ViewResult, ...]
    expectations: tuple[tuple[Expectation, float, bool], ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    old: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether no method gave a model in any view."""
        return all(view.comparison.failed for view in self.views)


def to_json(result: RunResult) -> dict[str, Any]:
    """Return what `excite run --json` prints and scores.json holds."""
    return {
        "schema_version": 2,
        "scenario": result.scenario.name,
        "folder": str(result.folder),
        "certificate": {name: c.to_dict() for name, c in result.certificates.items()},
        "warnings": result.warnings,
        "notes": result.notes,
        "old": result.old,
        "views": {view.name: _view_json(view) for view in result.views},
        "expectations": [
            {"expectation": f"{e.key} {e.comparison} {e.bound:g}", "value": value, "met": met}
            for e, value, met in result.expectations
        ],
    }


def _view_json(view: ViewResult) -> dict[str, Any]:
    found = view.comparison
    return {
        "dt": found.dt,
        "decimation": view.rule.every,
        "past": view.rule.past,
        "future": view.rule.future,
        "rule": view.rule.notes,
        "band_hz": found.band_hz,
        "truth_kind": found.truth and found.truth.kind,
        "predictor_spectral_radius": view.predictor_radius,
        "floor": found.floor,
        "truth": found.truth_score and found.truth_score.values,
        "rank_by": found.rank_by,
        "ranking": [{"rank": i + 1, **row_json(row)} for i, row in enumerate(found.rows)],
    }


def row_json(row: Row) -> dict[str, Any]:
    """Return a row of a comparison as plain values, tracebacks of failed trials among them."""
    return {
        "label": row.label,
        "method": row.method,
        "order": row.order,
        "consistent_in_closed_loop": row.consistent_in_closed_loop,
        "rank_value": row.rank_value,
        "reason": row.reason,
        "failures": [
            {"data": trial.data, "reason": trial.failure.reason, "traceback": trial.failure.traceback}
            for trial in row.trials
            if trial.failure is not None
        ],
        "metrics": {name: {k: found[k] for k in STATISTICS} for name, found in row.summary.items()},
        "reasons": row.reasons,
    }
