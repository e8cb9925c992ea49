"""What a run leaves behind, as data: the table, the figures and the report are made from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from excite.persistency.certificate import Certificate
from excite.types.experiment import Experiment
from excite.types.signal import Signal
from excite.types.truth import Truth
from identify import compare
from identify.estimate import Estimate
from identify.score import Score, floor_metric
from identify.steps.kalman import spectral_radius
from scenarios.scenario.sampling_rule import Horizons
from scenarios.scenario.spec import Expectation, Scenario, ViewSpec


@dataclass(frozen=True, eq=False)
class Row:
    """One method at one order in one view, over all estimation runs.

    estimates, scores : one a run (an estimate is None where the method failed); summary : metric -> statistic -> value;
    rank_value : geometric mean of the medians of the ranking metrics (inf when the method failed);
    closed_loop : the method is consistent in closed loop; reason : why it failed, or None.
    """

    method: str
    order: int
    closed_loop: bool
    estimates: tuple[Estimate | None, ...]
    scores: tuple[Score, ...]
    summary: Mapping[str, Mapping[str, float]]
    rank_value: float
    reason: str | None = None

    @property
    def label(self) -> str:
        """Name for tables and legends."""
        return f"{self.method} n={self.order}"

    @property
    def compared(self) -> compare.Row:
        """The same as a row of a Comparison, one trial per run."""
        trials = [
            compare.Trial(
                label=self.method,
                method=self.method,
                order=self.order,
                data=f"run {k}",
                estimate=estimate,
                score=None if estimate is None else score,
                failure=compare.Failure(score.reason or "no estimate") if estimate is None else None,
            )
            for k, (estimate, score) in enumerate(zip(self.estimates, self.scores, strict=True))
        ]
        return compare.Row(
            label=self.method,
            method=self.method,
            order=self.order,
            consistent_in_closed_loop=self.closed_loop,
            trials=tuple(trials),
            summary=self.summary,
            rank_value=self.rank_value,
            reason=self.reason,
        )


@dataclass(frozen=True, eq=False)
class ViewResult:
    """All rows of one view, best first, with what they are judged against.

    dt : s, after decimation; truth : lifted to that rate, or None; truth_score : score of the truth itself, whose
    fit_clean (on the noise-free validation run) is the linearisation floor; validation, clean : the first validation
    run as measured and its noise-free twin.
    """

    spec: ViewSpec
    dt: float
    horizons: Horizons
    horizons_s: tuple[float, ...]
    truth: Truth | None
    band_hz: tuple[float, float] | None
    truth_score: Score | None
    validation: Experiment
    clean: Experiment
    rows: tuple[Row, ...]

    @property
    def comparison(self) -> compare.Comparison:
        """The same as a Comparison, which figures are drawn of."""
        return compare.Comparison(
            name=self.spec.name,
            dt=self.dt,
            closed=self.spec.roles.closed,
            rows=tuple(row.compared for row in self.rows),
            validation=self.validation,
            rank_by=(),
            truth=self.truth,
            truth_score=self.truth_score,
            clean=self.clean,
            band_hz=self.band_hz,
            horizons_s=self.horizons_s,
        )

    @property
    def floor(self) -> tuple[str, float] | None:
        """The linearisation floor: its metric and the truth's value, None without a truth."""
        if self.truth is None:
            return None
        steps = [max(1, round(h / self.dt)) for h in self.horizons_s]
        name = floor_metric(self.truth, steps)
        return name, self.truth_score.values[name]

    @property
    def predictor_radius(self) -> float | None:
        """Spectral radius of the truth's A - K C, None without a noise model."""
        model = self.truth and self.truth.model
        return None if model is None or model.K is None else spectral_radius(model.A - model.K @ model.C)


@dataclass(frozen=True, eq=False)
class RunResult:
    """A finished run. certificates : by view, at its rate; expectations : (expectation, value, met)."""

    scenario: Scenario
    folder: Path
    signal: Signal
    certificates: Mapping[str, Certificate]
    views: tuple[ViewResult, ...]
    expectations: tuple[tuple[Expectation, float, bool], ...]
    warnings: tuple[str, ...]
