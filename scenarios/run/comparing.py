"""A comparison of methods on measured data, kept in a folder and resumed where it was left."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from excite.digest import digest
from excite.types.experiment import Experiment
from identify.compare import Comparison, Judge, Row, compared, run_trials
from identify.data.records import Records
from identify.entries import Entry
from identify.estimate_json import estimate_to_dict
from scenarios.run.pieces import slots_of, stems_of
from scenarios.run.results import row_json
from scenarios.run.store import INDEX, Shelf, Store, check_comparison, clear, hold, make_folder

TRIALS = "trials"
RESULT = "comparison.json"


def compare_in_folder(
    folder: Path,
    entries: Sequence[Entry],
    data: Sequence[Experiment],
    validation: Experiment,
    *,
    place: str,
    rank_by: Sequence[str] = ("fit_simulation",),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Comparison, dict[str, Any]]:
    """Fit every entry at every order, and score it on the validation record; return the comparison and its JSON.

    Every trial is in `trials` as soon as it is finished, and is not made again for the same data, settings and code. The
    models stand in the folder; trials and models of an earlier comparison that this one does not ask for are listed as
    "old", and "notes" says what was made again because the code has changed.

    place : what the JSON calls the validation record.
    """
    records = Records.of(data)
    judge = Judge((validation,))
    base, stems = digest(records, judge.key()), stems_of(entries, reserved=(Path(RESULT).stem, INDEX, TRIALS))
    slots = slots_of(entries, base, stems, TRIALS)
    check_comparison(folder, RESULT)
    make_folder(folder / INDEX)
    with hold(folder):
        store = Store(folder)
        store.adopt(slots)
        notes = store.outdated({slot.name: slot.code for slot in slots.values()})
        trials = run_trials(entries, records, judge, store=Shelf(store, slots), base=base, progress=progress)
        claims = {entry.method.name: entry.method.consistent_in_closed_loop for entry in entries}
        found = compared(trials, judge, name="data", rank_by=rank_by, closed=records.closed, consistent=claims)
        _write_models(store, found, stems)
        old = store.names() - {slot.name for slot in slots.values()}
        report = {
            "schema_version": 2,
            "validation": place,
            "rank_by": found.rank_by[0],
            "rows": [_row(row) for row in found.rows],
            "notes": list(notes),
            "old": sorted(old | {name for name in map(_model_of, old) if store.path(name).exists()}),
        }
        store.write_json(RESULT, report)
    return found, report


def _write_models(store: Store, found: Comparison, stems: dict[tuple, str]) -> None:
    """Write the model of each row into the folder; a row that has none now leaves none of an earlier comparison."""
    for row in found.rows:
        name = f"{stems[row.label, row.order]}.json"
        if row.estimates:
            store.write_json(name, estimate_to_dict(row.estimates[0], row.scores[0].per_output))
        else:
            clear(store.path(name))


def _model_of(trial: str) -> str:
    """Return the name of the model whose trial is a piece."""
    return Path(trial).name


def _row(row: Row) -> dict[str, Any]:
    """Return a row of one trial: what it scored, or why it failed."""
    values = row.scores[0].values if row.scores else {}
    return {**row_json(row), "values": values}
