"""Design, fly, identify, score: one scenario from start to finish, resumed where it was left."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import ExciteError, placed
from excite.files import load_recording, load_signal, save_recording, save_signal
from excite.models.model import Model
from excite.types.experiment import Experiment
from excite.types.recording import Recording
from identify.data.coherence import select_outputs
from identify.data.records import Records
from identify.estimate import Estimate
from identify.estimate_json import estimate_from_dict, estimate_to_dict
from identify.fit import fit
from identify.metrics.frequency import band_of
from identify.metrics.ranking import ranking_value
from identify.score import Score, absent, case_of, mean_score, score_in
from identify.score_json import score_from_dict, score_to_dict
from scenarios.run.design import Design, built_methods, make_design, view_horizons, view_truth
from scenarios.run.results import Row, RunResult, ViewResult
from scenarios.run.store import intact, make_folder, open_folder, read_json, write_json
from scenarios.scenario.sampling_rule import Horizons
from scenarios.scenario.spec import STATISTICS, Scenario, ViewSpec, check_scenario, check_signal, statistics

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
        for kind, k in [("estimation", 0), *(("validation", k) for k in range(scenario.validation_runs))]:
            path = excitation_path(folder, kind, k)
            if not path.with_name(f"{path.name}.json").exists():  # written after the CSV file it describes
                signal_k = design.signal if kind == "estimation" else scenario.design(scenario.seed + 1 + k)
                check_signal(scenario, signal_k)
                save_signal(signal_k, path, certificate=certificates if kind == "estimation" else None)
        flights = [("estimation", k) for k in range(scenario.estimation_runs)]
        flights += [(kind, k) for kind in KINDS[1:] for k in range(scenario.validation_runs)]
        fits = [(spec.name, k) for spec in scenario.views for k in range(scenario.estimation_runs)]
        done, total = 0, len(flights) + len(fits)
        wanted = {
            fly: [piece for piece in flights if not recording_path(folder, *piece).exists()],
            identify: [piece for piece in fits if _unfinished(scenario, folder, *piece)],
        }
        with _workers(min(jobs, max(map(len, wanted.values())))) as each:
            for stage, task, pieces in (("playing", fly, flights), ("identifying", identify, fits)):
                done += len(pieces) - len(wanted[task])
                for _ in each(task, [(dict(scenario.source), folder, *piece) for piece in wanted[task]]):
                    done += 1
                    progress(stage, done, total)
        result = _collect(scenario, design, folder)
        write_json(folder / "scores.json", to_json(result))
        return result


@contextmanager
def _workers(jobs: int) -> Iterator[Callable[[Callable, list], Iterator]]:
    """Yield a map over pieces, here or in other processes (each with one BLAS thread), which end when this one does."""
    if jobs <= 1:
        yield lambda task, pieces: (task(*piece) for piece in pieces)
        return
    others = multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")
    with _single_threaded(), ProcessPoolExecutor(jobs, mp_context=context, initializer=_end_with_parent) as pool:

        def each(task: Callable, pieces: list) -> Iterator[None]:
            with _interrupts_ignored():  # by the processes that the first submit starts; Ctrl-C is for this one
                futures = [pool.submit(task, *piece) for piece in pieces]
            return (future.result() for future in as_completed(futures))

        try:
            yield each
        except BaseException as error:
            for child in multiprocessing.active_children():
                if child not in others:
                    child.terminate()
            if isinstance(error, BrokenProcessPool):
                raise ExciteError(
                    "a worker process died, perhaps for lack of memory; give the same command with fewer --jobs: it goes "
                    "on from the finished pieces"
                ) from error
            raise


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


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C inside, as processes started there go on to do; only the main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _end_with_parent() -> None:
    """Leave this process as soon as its parent is gone, however that died."""

    def watch() -> None:
        multiprocessing.parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _unfinished(scenario: Scenario, folder: Path, view: str, k: int) -> bool:
    """Whether a method of the view still has no result for an estimation run."""
    mine = [(m.name, n) for m in scenario.methods if m.view == view for n in m.orders]
    return not all(result_path(folder, view, name, n, k).exists() for name, n in mine)


def recording_path(folder: Path, kind: str, k: int) -> Path:
    """Where the recording of one flight lies."""
    return folder / "recordings" / f"{kind}_{k:02d}.npz"


def excitation_path(folder: Path, kind: str, k: int) -> Path:
    """Where the signal of a flight lies: designed once, so that what a search decided holds for every flight."""
    return folder / ("excitation.csv" if kind == "estimation" else f"validation_{k:02d}.csv")


def fly(source: dict, folder: Path, kind: str, k: int) -> None:
    """Fly one estimation, validation or noise-free validation run and record it.

    Estimation runs share one excitation under different noise; validation runs have a fresh realisation of it.
    """
    scenario = check_scenario(source, str(folder))
    path = excitation_path(folder, kind, k)
    with intact(path):
        excitation = load_signal(path)
    seed = scenario.seed + k + (0 if kind == "estimation" else VALIDATION_OFFSET)
    noise = False if kind == "clean" else scenario.noise
    parameters = source["plant"].get("parameters")
    with placed(f"{kind} run {k}" + (f" with plant.parameters {parameters}" if parameters else "")):
        recording = scenario.plant.run(excitation, inject=scenario.inject, noise=noise, seed=seed)
    path = recording_path(folder, kind, k)
    make_folder(path.parent)
    save_recording(recording, path)


def flown(folder: Path, kind: str, k: int) -> Recording:
    """Return the recording of one flight."""
    path = recording_path(folder, kind, k)
    with intact(path):
        return load_recording(path)


def prepared(scenario: Scenario, spec: ViewSpec, rule: Horizons, recording: Recording) -> Experiment:
    """Return a view's experiment: roles, start discarded, decimated."""
    experiment = recording.experiment(spec.roles)
    skip = round(scenario.discard_s / experiment.dt)
    return experiment.window(skip - skip % rule.every).decimate(rule.every)


def chosen(scenario: Scenario, spec: ViewSpec, rule: Horizons, folder: Path) -> ViewSpec:
    """Return the view with the outputs that the first estimation run shows coherent, where it asks for that."""
    if spec.coherence is None:
        return spec
    data = prepared(scenario, spec, rule, flown(folder, "estimation", 0))
    with placed(f"{scenario.file}: view '{spec.name}': coherence"):
        kept = select_outputs(data, scenario.bands_hz[spec.name], spec.coherence)
    return replace(spec, roles=replace(spec.roles, outputs=tuple(kept)))


def identify(source: dict, folder: Path, view: str, k: int) -> None:
    """Fit every method and order of one view on one estimation run, and score it on the validation runs."""
    scenario = check_scenario(source, str(folder))
    spec = next(s for s in scenario.views if s.name == view)
    path = excitation_path(folder, "estimation", k)
    with intact(path):
        rule = view_horizons(scenario, spec, load_signal(path))
    spec, recording = chosen(scenario, spec, rule, folder), flown(folder, "estimation", k)
    data = Records.of(prepared(scenario, spec, rule, recording))
    judge = _Judge(scenario, spec, rule, folder, recording)
    shared: dict[tuple, Any] = {}
    for m, method in built_methods(scenario, spec, rule):
        for n in m.orders:
            path = result_path(folder, view, m.name, n, k)
            if path.exists():
                continue
            try:
                estimate = fit(data, method, n, shared=shared)
                outcome = judge(estimate)
            except ExciteError as error:
                estimate, outcome = None, Score({}, reason=str(error))
            fitted = estimate and estimate_to_dict(estimate, outcome.per_output)
            write_json(path, {"estimate": fitted, "score": score_to_dict(outcome)})


def result_path(folder: Path, view: str, method: str, order: int, k: int) -> Path:
    """Where one estimate with its score lies."""
    return folder / "models" / view / f"{method}-n{order}" / f"run_{k:02d}.json"


class _Judge:
    """Scores estimates of one view on all validation runs and against the truth of the estimation run."""

    def __init__(self, scenario: Scenario, spec: ViewSpec, rule: Horizons, folder: Path, recording: Recording) -> None:
        runs = range(scenario.validation_runs)
        self.validation, self.clean = (
            [prepared(scenario, spec, rule, flown(folder, kind, k)) for k in runs] for kind in ("validation", "clean")
        )
        truth = view_truth(scenario, spec, recording)
        self.truth = truth and truth.lift(rule.every)
        dt, band = self.validation[0].dt, scenario.bands_hz.get(spec.name)
        steps = tuple(max(1, round(h / dt)) for h in scenario.horizons_s)
        self.cases = [
            case_of(measured, self.truth, horizons=steps, band_hz=band, clean=clean)
            for measured, clean in zip(self.validation, self.clean, strict=True)
        ]
        self.band = band if self.truth is None else band_of(self.cases[0])

    def __call__(self, model: Estimate | Model) -> Score:
        return mean_score([score_in(case, model) for case in self.cases])


def _collect(scenario: Scenario, design: Design, folder: Path) -> RunResult:
    views = tuple(_view_result(scenario, spec, design.horizons[spec.name], folder) for spec in scenario.views)
    checked = []
    for expectation in scenario.expect:
        rows = next(s.rows for s in views if s.spec.name == expectation.view)
        rows = rows if expectation.method == "best" else [r for r in rows if r.method == expectation.method]
        value = rows[0].summary.get(expectation.metric, {}).get(expectation.statistic, float("nan"))
        checked.append((expectation, value, expectation.holds(value)))
    return RunResult(scenario, folder, design.signal, design.certificates, views, tuple(checked), design.warnings)


def _view_result(scenario: Scenario, spec: ViewSpec, rule: Horizons, folder: Path) -> ViewResult:
    spec, recording = chosen(scenario, spec, rule, folder), flown(folder, "estimation", 0)
    judge = _Judge(scenario, spec, rule, folder, recording)
    rows = []
    for m, method in built_methods(scenario, spec, rule):
        for n in m.orders:
            outcomes = [_outcome(result_path(folder, spec.name, m.name, n, k)) for k in range(scenario.estimation_runs)]
            estimates, scores = zip(*outcomes, strict=True)
            rows.append(_row(m.name, n, method.consistent_in_closed_loop, estimates, scores, scenario.rank_by))
    rows.sort(key=lambda row: row.rank_value)
    return ViewResult(
        spec,
        judge.validation[0].dt,
        rule,
        scenario.horizons_s,
        judge.truth,
        judge.band,
        None if judge.truth is None else judge(judge.truth.model),
        judge.validation[0],
        judge.clean[0],
        tuple(rows),
    )


def _outcome(path: Path) -> tuple[Estimate | None, Score]:
    with intact(path):
        outcome = read_json(path)
        fitted = outcome["estimate"]
        return fitted and estimate_from_dict(fitted, "estimate"), score_from_dict(outcome["score"])


def _row(
    method: str, order: int, closed_loop: bool, estimates: tuple, scores: tuple[Score, ...], rank_by: tuple[str, ...]
) -> Row:
    failure = next((s.reason for s in scores if s.reason), None)
    good = [s for s in scores if s.reason is None]
    names = dict.fromkeys(name for s in good for name in s.values)
    summary = {name: statistics([s.values.get(name, float("nan")) for s in good]) for name in names}
    medians = {name: each["median"] for name, each in summary.items()}
    rank, unranked = (np.inf, None) if failure else ranking_value(medians, absent(good), rank_by)
    return Row(method, order, closed_loop, estimates, scores, summary, rank, failure or unranked)


def to_json(result: RunResult) -> dict[str, Any]:
    """Return what `excite run --json` prints and scores.json holds."""
    return {
        "schema_version": 1,
        "scenario": result.scenario.name,
        "folder": str(result.folder),
        "certificate": {name: c.to_dict() for name, c in result.certificates.items()},
        "warnings": result.warnings,
        "views": {s.spec.name: _view_json(s) for s in result.views},
        "expectations": [
            {"expectation": f"{e.key} {e.comparison} {e.bound:g}", "value": value, "met": met}
            for e, value, met in result.expectations
        ],
    }


def _view_json(view: ViewResult) -> dict[str, Any]:
    return {
        "dt": view.dt,
        "decimation": view.horizons.every,
        "past": view.horizons.past,
        "future": view.horizons.future,
        "rule": view.horizons.notes,
        "band_hz": view.band_hz,
        "truth_kind": view.truth and view.truth.kind,
        "predictor_spectral_radius": view.predictor_radius,
        "floor": view.floor,
        "truth": view.truth_score and view.truth_score.values,
        "ranking": [
            {
                "rank": i + 1,
                "method": row.method,
                "order": row.order,
                "consistent_in_closed_loop": row.closed_loop,
                "rank_value": row.rank_value,
                "reason": row.reason,
                "metrics": {name: {k: stats[k] for k in STATISTICS} for name, stats in row.summary.items()},
                "reasons": absent([s for s in row.scores if s.reason is None]),
            }
            for i, row in enumerate(view.rows)
        ],
    }
