"""excite compare."""

import click
import numpy as np

from excite.errors import ExciteError, placed
from scenarios.cli.common import assignments, json_option, parse_orders
from scenarios.cli.output import ProgressLine, grouped, new_folder, print_json, print_lines
from scenarios.cli.reading import data_options, read_experiment

RANK_BY = "fit_simulation"


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option("--methods", required=True, metavar="A,B,…", help="Methods to compare.")
@click.option("--orders", default="2:6", show_default=True, metavar="2:10", help="Orders: 4, or 2,4,8, or 2:10.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Setting of every method that has it.")
@click.option(
    "--validation", type=click.Path(), help="Validation record; else the last third of the last FILE is kept."
)
@data_options
@click.option("-o", "folder", required=True, type=click.Path(), help="Folder for the models and comparison.json.")
@json_option
def compare(
    file: tuple[str, ...],
    methods: str,
    orders: str,
    settings: tuple[str, ...],
    validation: str | None,
    folder: str,
    as_json: bool,
    **reading: object,
) -> int:
    """Fit several methods and orders to the data in FILEs and rank them by fit on validation data."""
    from identify.estimate_json import estimate_to_dict
    from identify.fit import fit
    from identify.score import UNCLIPPED, score
    from identify.settings import load_methods
    from scenarios.run.store import write_json

    wanted = parse_orders(orders)
    chosen = load_methods([m.strip() for m in methods.split(",")], assignments(settings, "--set"))
    target = new_folder(folder)
    data = [read_experiment(path, **reading) for path in file]
    if validation is not None:
        label, judged = validation, read_experiment(validation, **reading)
    elif len(data[-1]) < 3:
        raise ExciteError(f"{file[-1]}: {len(data[-1])} samples leave none to validate on; give --validation")
    else:
        cut = 2 * len(data[-1]) // 3
        label, data[-1], judged = f"last third of {file[-1]}", data[-1].window(0, cut), data[-1].window(cut)
    progress, rows, shared, models = ProgressLine(), [], {}, {}
    pairs = [(name, n) for name in chosen for n in wanted]
    for i, (name, n) in enumerate(pairs):
        method = chosen[name]
        row = {"method": name, "order": n, "values": {}, "reason": None, "reasons": {}}
        try:
            with placed(", ".join(file)):
                estimate = fit(tuple(data), method, n, shared=shared)
            with placed(label):
                result = score(estimate, judged)
            row["values"], row["reasons"] = result.values, result.reasons
            models[f"{name}-n{n}.json"] = estimate_to_dict(estimate, result.per_output)
        except ExciteError as error:
            row["reason"] = str(error)
        rows.append(row)
        progress("identifying", i + 1, len(pairs))
    rows.sort(key=lambda row: -row["values"].get(f"{RANK_BY}{UNCLIPPED}", -np.inf))
    report = {"schema_version": 1, "validation": label, "rank_by": RANK_BY, "rows": rows}
    for name, model in models.items():
        write_json(target / name, model)
    write_json(target / "comparison.json", report)
    if as_json:
        print_json(report)
    else:
        print_lines([f"validation: {label}", *_table(rows)])
    return 0 if models else 2


def _table(rows: list[dict]) -> list[str]:
    """Return the table of all metrics with a value in some row; below it, why the others have none."""
    from excite.words import NONE, number
    from identify.metrics.registry import metrics_at
    from scenarios.report.tables import to_text

    good = [row for row in rows if row["reason"] is None]
    shown = [metric for metric in metrics_at(()) if any(metric.name in row["values"] for row in good)]
    text, notes = [], []
    for i, row in enumerate(good):
        values = [row["values"].get(metric.name, np.nan) for metric in shown]
        cells = [number(metric.scale * value, metric.decimals) for metric, value in zip(shown, values, strict=True)]
        rank = str(i + 1) if RANK_BY in row["values"] else NONE
        text.append([rank, row["method"], str(row["order"]), *cells])
        lacking = {metric.name: row["reasons"][metric.name] for metric in shown if metric.name not in row["values"]}
        notes += [f"{row['method']} n={row['order']}: no {', '.join(names)}: {why}" for why, names in grouped(lacking)]
    failed = [f"{row['method']} n={row['order']} failed: {row['reason']}" for row in rows if row["reason"] is not None]
    headers = ["rank", "method", "order", *(f"{metric.name} {metric.unit}" for metric in shown)]
    return [*to_text(headers, text).splitlines(), *notes, *failed]
