"""Design, fly, identify, score: one scenario from start to finish, resumed where it was left."""

from collections.abc import Callable, Iterable
from pathlib import Path

from identify.compare import compared
from scenarios.run.executor import Executor, Local
from scenarios.run.plan import EXCITATION, Plan, make_plan, signal_code, signal_key
from scenarios.run.results import RunResult, ViewResult, to_json
from scenarios.run.store import Store, open_folder
from scenarios.scenario.spec import Scenario

Progress = Callable[[str, int, int], None]


def run_scenario(
    scenario: Scenario, folder: Path, executor: Executor | int = 1, progress: Progress = lambda *_: None
) -> RunResult:
    """Run a checked scenario in a folder and return what it found; finished pieces are not made again.

    executor : where pieces are made, or a number of processes.
    """
    executor = Local(executor) if isinstance(executor, int) else executor
    plan = make_plan(scenario, Store(folder) if folder.is_dir() else None)
    with open_folder(folder, scenario.source) as store:
        certificates = {name: c.to_dict() for name, c in plan.design.certificates.items()}
        store.write_json("certificate.json", certificates)
        store.adopt(plan.slots())
        notes, code = _notes(scenario, plan, store), signal_code(scenario)
        for name, signal in plan.signals.items():
            key = signal_key(scenario, _seed(scenario, name))
            if not store.has(name, key, code):
                store.save_signal(name, key, code, signal, certificates if name == EXCITATION else None)
        _make(plan, store, executor, progress)
        result = _collect(scenario, plan, store, notes)
        store.write_json("scores.json", to_json(result))
        return result


def _seed(scenario: Scenario, name: str) -> int:
    """Return the realisation seed of a signal: validation_00.csv has that after the excitation's."""
    return scenario.seed if name == EXCITATION else scenario.seed + 1 + int(Path(name).stem.rpartition("_")[2])


def _make(plan: Plan, store: Store, executor: Executor, progress: Progress) -> None:
    """Make what is not there yet: flights first, which identifications read."""
    stages = (("playing", plan.flights), ("identifying", plan.identifications))
    wanted = [[piece for piece in pieces if not piece.finished(store)] for _, pieces in stages]
    total = sum(len(pieces) for _, pieces in stages)
    done = total - sum(map(len, wanted))
    with executor.each(str(store.folder), max(map(len, wanted))) as each:
        for (stage, _), pieces in zip(stages, wanted, strict=True):
            for _ in each(pieces):
                done += 1
                progress(stage, done, total)


def _notes(scenario: Scenario, plan: Plan, store: Store) -> tuple[str, ...]:
    """Return what is made again because the code has changed since, in one line."""
    made_by = {
        **dict.fromkeys(plan.signals, signal_code(scenario)),
        **{flight.name: flight.code for flight in plan.flights},
        **{slot.name: slot.code for slot in plan.slots().values()},
    }
    return store.outdated(made_by)


def _collect(scenario: Scenario, plan: Plan, store: Store, notes: Iterable[str]) -> RunResult:
    views = tuple(_view_result(scenario, plan, store, spec.name) for spec in scenario.views)
    checked = []
    for expectation in scenario.expect:
        rows = next(view.comparison.rows for view in views if view.name == expectation.view)
        mine = rows if expectation.method == "best" else [r for r in rows if expectation.method in (r.label, r.method)]
        value = mine[0].statistics(expectation.metric)[expectation.statistic] if mine else float("nan")
        checked.append((expectation, value, expectation.holds(value)))
    old = tuple(sorted(store.names() - plan.names()))
    return RunResult(
        scenario,
        store.folder,
        plan.design.signal,
        plan.design.certificates,
        views,
        tuple(checked),
        plan.design.warnings,
        tuple(notes),
        old,
    )


def _view_result(scenario: Scenario, plan: Plan, store: Store, name: str) -> ViewResult:
    pieces = plan.of_view(name)
    view = pieces[0].view.chosen(store.recording(pieces[0].first))
    trials = [trial for piece in pieces for trial in piece.trials(store)]
    claims = {entry.method.name: entry.method.consistent_in_closed_loop for entry in pieces[0].entries}
    comparison = compared(
        trials,
        pieces[0].judge(store, view),
        name=name,
        rank_by=scenario.rank_by,
        closed=view.roles.closed,
        consistent=claims,
    )
    return ViewResult(view, plan.design.horizons[name], comparison)
