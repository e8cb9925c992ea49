"""Design, fly, identify, score: one scenario from start to finish, resumed where it was left."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.files import load_recording, save_recording, save_signal
from excite.types.experiment import Experiment
from excite.types.models import Model
from excite.types.recording import Recording
from excite.types.truth import Truth
from identify.estimate import Estimate
from identify.method import experiments
from identify.metrics import default_band
from identify.model_json import estimate_from_dict, estimate_to_dict
from identify.score import Score, floor_metric, score
from scenarios.design import Design, built_methods, make_design, setting_truth
from scenarios.results import Row, RunResult, SettingResult
from scenarios.rule import Horizons
from scenarios.spec import STATISTICS, Scenario, SettingSpec, check_scenario, statistics
from scenarios.store import open_folder, read_json, write_json

Progress = Callable[[str, int, int], None]
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
KINDS = ("estimation", "validation", "clean")
VALIDATION_OFFSET = 10_000  # between the noise seeds of estimation and validation runs


def run_scenario(scenario: Scenario, folder: Path, jobs: int = 1, progress: Progress = lambda *_: None) -> RunResult:
    """Run a checked scenario in a folder and return what it found; finished pieces are not made again."""
    design = make_design(scenario)
    with open_folder(folder, scenario.source):
        certificates = {name: c.to_dict() for name, c in design.certificates.items()}
        write_json(folder / "certificate.json", certificates)
        if not (folder / "excitation.csv").exists():
            save_signal(design.signal, folder / "excitation.csv", certificate=certificates)
        flights = [("estimation", k) for k in range(scenario.estimation_runs)]
        flights += [(kind, k) for kind in KINDS[1:] for k in range(scenario.validation_runs)]
        fits = [(spec.name, k) for spec in scenario.settings for k in range(scenario.estimation_runs)]
        total = len(flights) + len(fits)
        done = 0
        for stage, task, pieces in (("flying", fly, flights), ("identifying", identify, fits)):
            for _ in _each(task, dict(scenario.source), folder, pieces, jobs):
                done += 1
                progress(stage, done, total)
        result = _collect(scenario, design, folder)
        write_json(folder / "scores.json", to_json(result))
        return result


def _each(task: Callable, source: dict, folder: Path, pieces: list, jobs: int) -> Iterator[None]:
    """Do the pieces that are not there yet, in this process or in several (each then with one BLAS thread)."""
    if jobs == 1 or len(pieces) == 1:
        for piece in pieces:
            yield task(source, folder, *piece)
        return
    with _single_threaded(), ProcessPoolExecutor(
        jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_leave_interrupts_to_parent
    ) as pool:
        futures = [pool.submit(task, source, folder, *piece) for piece in pieces]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Have processes started inside use one BLAS thread each: several times two threads only get in each other's way."""
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def _leave_interrupts_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def recording_path(folder: Path, kind: str, k: int) -> Path:
    """Where the recording of one flight lies."""
    return folder / "recordings" / f"{kind}_{k:02d}.npz"


def fly(source: dict, folder: Path, kind: str, k: int) -> None:
    """Fly one estimation, validation or noise-free validation run and record it.

    Estimation runs share one excitation under different noise; validation runs have a fresh realisation of it.
    """
    path = recording_path(folder, kind, k)
    if path.exists():
        return
    scenario = check_scenario(source, "scenario")
    excitation = scenario.design(scenario.seed if kind == "estimation" else scenario.seed + 1 + k)
    seed = scenario.seed + k + (0 if kind == "estimation" else VALIDATION_OFFSET)
    noise = False if kind == "clean" else scenario.noise
    recording = scenario.plant.run(excitation, inject=scenario.inject, noise=noise, seed=seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_recording(recording, path)


def view(scenario: Scenario, spec: SettingSpec, rule: Horizons, recording: Recording) -> Experiment:
    """Return a setting's experiment: roles, start discarded, decimated."""
    experiment = recording.experiment(spec.name if spec.plants_own else spec.roles)
    skip = round(scenario.discard_s / experiment.dt)
    return experiment.window(skip - skip % rule.every).decimate(rule.every)


def lifted(truth: Truth | None, every: int) -> Truth | None:
    """Return the truth at the decimated rate."""
    return None if truth is None else replace(truth, model=truth.model.lift(every))


def identify(source: dict, folder: Path, setting: str, k: int) -> None:
    """Fit every method and order of one setting on one estimation run, and score it on the validation runs."""
    scenario = check_scenario(source, "scenario")
    spec = next(s for s in scenario.settings if s.name == setting)
    design = make_design(scenario)
    rule = design.horizons[setting]
    wanted = [(m, method, n) for m, method in built_methods(scenario, spec, rule) for n in m.orders]
    wanted = [w for w in wanted if not result_path(folder, setting, w[0].name, w[2], k).exists()]
    if not wanted:
        return
    data = None
    factors: dict[tuple, Any] = {}
    for m, method, n in wanted:
        if data is None:
            recording = load_recording(recording_path(folder, "estimation", k))
            data = experiments(view(scenario, spec, rule, recording))
            judge = _Judge(scenario, spec, rule, folder, recording)
        try:
            method.check(data, n)
            if method.factor_key() not in factors:
                factors[method.factor_key()] = method.prepare(data)
            estimate = method.fit(data, n, factors[method.factor_key()])
            outcome = judge(estimate)
        except ExciteError as error:
            estimate, outcome = None, Score({}, reason=str(error))
        write_json(
            result_path(folder, setting, m.name, n, k),
            {"estimate": estimate and estimate_to_dict(estimate, outcome.per_output), "score": score_to_dict(outcome)},
        )


def result_path(folder: Path, setting: str, method: str, order: int, k: int) -> Path:
    """Where one estimate with its score lies."""
    return folder / "models" / setting / f"{method}-n{order}" / f"run_{k:02d}.json"


class _Judge:
    """Scores estimates of one setting on all validation runs and against the truth of the estimation run."""

    def __init__(
        self, scenario: Scenario, spec: SettingSpec, rule: Horizons, folder: Path, recording: Recording
    ) -> None:
        runs = range(scenario.validation_runs)
        self.validation, self.clean = (
            [view(scenario, spec, rule, load_recording(recording_path(folder, kind, k))) for k in runs]
            for kind in ("validation", "clean")
        )
        self.truth = lifted(setting_truth(scenario, spec, recording), rule.every)
        dt = self.validation[0].dt
        self.steps = tuple(max(1, round(h / dt)) for h in scenario.horizons_s)
        self.band = scenario.bands_hz.get(spec.name)
        if self.band is None and self.truth is not None:
            self.band = default_band(self.truth.model)

        self.floor = None
        if self.truth is not None:
            self.floor_metric = floor_metric(self.truth, self.steps)
            self.floor = self(self.truth.model).values[self.floor_metric]

    def __call__(self, model: Estimate | Model) -> Score:
        scores = [
            score(model, measured, self.truth, horizons=self.steps, band_hz=self.band, clean=clean)
            for measured, clean in zip(self.validation, self.clean, strict=True)
        ]
        values = {name: float(np.mean([s.values[name] for s in scores])) for name in scores[0].values}
        per_output = {
            name: tuple(np.mean([s.per_output[name] for s in scores], axis=0).tolist()) for name in scores[0].per_output
        }
        if self.floor is not None:
            values["fit_below_floor"] = self.floor - values.get(self.floor_metric, np.nan)
        return Score(values, per_output)


def score_to_dict(outcome: Score) -> dict[str, Any]:
    """Plain values of a score."""
    return {"values": dict(outcome.values), "per_output": dict(outcome.per_output), "reason": outcome.reason}


def score_from_dict(data: Mapping[str, Any]) -> Score:
    """Rebuild a score; null becomes NaN."""

    def number(value: float | None) -> float:
        return float("nan") if value is None else value

    per_output = {name: tuple(map(number, each)) for name, each in data["per_output"].items()}
    return Score({name: number(v) for name, v in data["values"].items()}, per_output, data["reason"])


def _collect(scenario: Scenario, design: Design, folder: Path) -> RunResult:
    settings = tuple(_setting_result(scenario, spec, design.horizons[spec.name], folder) for spec in scenario.settings)
    checked = []
    for expectation in scenario.expect:
        rows = next(s.rows for s in settings if s.spec.name == expectation.setting)
        rows = rows if expectation.method == "best" else [r for r in rows if r.method == expectation.method]
        value = rows[0].summary.get(expectation.metric, {}).get(expectation.statistic, float("nan"))
        checked.append((expectation, value, expectation.holds(value)))
    return RunResult(
        scenario, folder, design.signal, design.certificates, settings, tuple(checked), design.warnings
    )


def _setting_result(scenario: Scenario, spec: SettingSpec, rule: Horizons, folder: Path) -> SettingResult:
    recording = load_recording(recording_path(folder, "estimation", 0))
    judge = _Judge(scenario, spec, rule, folder, recording)
    rows = []
    for m, method in built_methods(scenario, spec, rule):
        for n in m.orders:
            paths = [result_path(folder, spec.name, m.name, n, k) for k in range(scenario.estimation_runs)]
            outcomes = [read_json(path) for path in paths]
            estimates = tuple(
                o["estimate"] and estimate_from_dict(o["estimate"], str(p)) for o, p in zip(outcomes, paths, strict=True)
            )
            scores = tuple(score_from_dict(o["score"]) for o in outcomes)
            rows.append(_row(m.name, n, method.closed_loop, estimates, scores, scenario.rank_by))
    rows.sort(key=lambda row: row.rank_value)
    return SettingResult(
        spec, judge.validation[0].dt, rule, scenario.horizons_s, judge.truth, judge.band,
        None if judge.truth is None else judge(judge.truth.model), judge.validation[0], judge.clean[0], tuple(rows),
    )  # fmt: skip


def _row(
    method: str, order: int, closed_loop: bool, estimates: tuple, scores: tuple[Score, ...], rank_by: tuple[str, ...]
) -> Row:
    reason = next((s.reason for s in scores if s.reason), None)
    good = [s for s in scores if s.reason is None]
    names = dict.fromkeys(name for s in good for name in s.values)
    summary = {name: statistics([s.values.get(name, float("nan")) for s in good]) for name in names}
    medians = np.array([summary.get(name, {}).get("median", np.nan) for name in rank_by])
    rank = float(np.exp(np.mean(np.log(np.maximum(medians, 1e-300))))) if not np.isnan(medians).any() else np.inf
    return Row(method, order, closed_loop, estimates, scores, summary, np.inf if reason else rank, reason)


def to_json(result: RunResult) -> dict[str, Any]:
    """Return what `excite run --json` prints and scores.json holds."""
    return {
        "schema_version": 1, "scenario": result.scenario.name, "folder": str(result.folder),
        "certificate": {name: c.to_dict() for name, c in result.certificates.items()},
        "warnings": result.warnings,
        "settings": {s.spec.name: _setting_json(s) for s in result.settings},
        "expectations": [
            {"expectation": f"{e.key} {e.comparison} {e.bound:g}", "value": value, "met": met}
            for e, value, met in result.expectations
        ],
    }  # fmt: skip


def _setting_json(setting: SettingResult) -> dict[str, Any]:
    return {
        "dt": setting.dt, "decimation": setting.horizons.every, "past": setting.horizons.past,
        "future": setting.horizons.future, "rule": setting.horizons.notes, "band_hz": setting.band_hz,
        "truth_kind": setting.truth and setting.truth.kind,
        "predictor_spectral_radius": setting.predictor_radius,
        "floor": setting.floor,
        "truth": setting.truth_score and setting.truth_score.values,
        "ranking": [
            {
                "rank": i + 1, "method": row.method, "order": row.order, "consistent_in_closed_loop": row.closed_loop,
                "rank_value": row.rank_value, "reason": row.reason,
                "metrics": {name: {k: stats[k] for k in STATISTICS} for name, stats in row.summary.items()},
            }
            for i, row in enumerate(setting.rows)
        ],
    }  # fmt: skip
