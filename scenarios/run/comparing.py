"""A comparison of methods on measured data, kept in a folder and resumed where it was left."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from excite.digest import code_digest, digest
from excite.types.experiment import Experiment
from identify.compare import Comparison, Entry, Judge, Row, compared, run_trials
from identify.data.records import Records
from identify.estimate_json import estimate_to_dict
from scenarios.run.pieces import IDENTIFYING, order_suffix, stems_of, trial_names
from scenarios.run.results import row_json
from scenarios.run.store import INDEX, Shelf, Store, hold, make_folder

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
    models stand in the folder, those of an earlier comparison that this one does not ask for among "old".

    place : what the JSON calls the validation record.
    """
    records = Records.of(data)
    judge = Judge((validation,))
    base, stems = digest(records, judge.key()), stems_of(entries)
    names = trial_names(entries, base, stems, TRIALS)
    make_folder(folder / INDEX)
    with hold(folder):
        store = Store(folder)
        shelf = Shelf(store, names, code_digest(*IDENTIFYING))
        trials = run_trials(entries, records, judge, store=shelf, base=base, progress=progress)
        claims = {entry.method.name: entry.method.consistent_in_closed_loop for entry in entries}
        found = compared(trials, judge, name="data", rank_by=rank_by, closed=records.closed, consistent=claims)
        models = {f"{stems[row.label]}{order_suffix(row.order)}.json": row for row in found.rows if row.estimates}
        for name, row in models.items():
            store.write_json(name, estimate_to_dict(row.estimates[0], row.scores[0].per_output))
        report = {
            "schema_version": 2,
            "validation": place,
            "rank_by": found.rank_by[0],
            "rows": [_row(row) for row in found.rows],
            "old": sorted(store.names() - {*names.values()}),
        }
        store.write_json(RESULT, report)
    return found, report


def _row(row: Row) -> dict[str, Any]:
    """Return a row of one trial: what it scored, or why it failed."""
    values = row.scores[0].values if row.scores else {}
    return {**row_json(row), "values": values}
