"""excite compare."""

import sys
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import click

from excite.errors import ExciteError
from excite.types.channel import listed
from scenarios.cli.common import assignments, json_option, parse_methods, parse_orders
from scenarios.cli.output import ProgressLine, new_folder, print_json, print_lines
from scenarios.cli.reading import data_options, read_experiment

if TYPE_CHECKING:
    from identify.compare import Comparison


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option(
    "--methods",
    required=True,
    metavar="A,B,…",
    help="Methods to compare; with settings of their own as ssarx(past=30).",
)
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
    **reading: Any,
) -> int:
    """Fit several methods and orders to FILEs and rank them.

    They are ranked by their fit on validation data. Finished fits are kept in the folder: the same
    command goes on where it was interrupted.
    """
    from identify.compare import entries
    from identify.settings import load_methods
    from scenarios.run.comparing import compare_in_folder

    wanted = parse_orders(orders)
    chosen = entries(load_methods(parse_methods(methods), assignments(settings, "--set")), wanted)
    target = new_folder(folder)
    data = [read_experiment(path, **reading) for path in file]
    if validation is not None:
        label, judged = validation, read_experiment(validation, **reading)
    elif len(data[-1]) < 3:
        raise ExciteError(f"{file[-1]}: {len(data[-1])} samples leave none to validate on; give --validation")
    else:
        cut = 2 * len(data[-1]) // 3
        label, data[-1], judged = f"last third of {file[-1]}", data[-1].window(0, cut), data[-1].window(cut)
    line = ProgressLine()
    try:
        with redirect_stdout(sys.stderr):  # what a plug-in prints is no result
            found, report = compare_in_folder(
                target, chosen, data, judged, place=label, progress=lambda done, total: line("identifying", done, total)
            )
    except KeyboardInterrupt:
        click.echo(f"\n{target}: finished fits are kept; the same command goes on from there", err=True)
        raise
    if as_json:
        print_json(report)
    else:
        old = [f"old: not asked for this time: {listed(report['old'])}"] if report["old"] else []
        print_lines([f"validation: {label}", *_table(found), *old])
    for note in report["notes"]:
        click.echo(f"note: {note}", err=True)
    for row in found.rows:
        for failure in row.failures:
            if failure.traceback:
                reason = f"{failure.reason} (the traceback is in {target / 'comparison.json'})"
                click.echo(f"warning: {row.title}: {reason}", err=True)
    if found.failed:
        click.echo(
            f"excite: {target}: no method gave a model; see the reasons in {target / 'comparison.json'}", err=True
        )
        return 2
    return 0


def _table(found: "Comparison") -> list[str]:
    """Return the table of all metrics with a value in some row; below it, why the others have none."""
    from excite.words import NONE, number
    from identify.metrics.metric import SIMULATED
    from identify.metrics.registry import metrics_at
    from identify.score import by_reason
    from scenarios.report.tables import to_text

    good = [row for row in found.rows if row.estimates]
    shown = [metric for metric in metrics_at(()) if any(metric.name in row.summary for row in good)]
    text, notes = [], []
    for i, row in enumerate(good):
        values = [row.statistics(metric.name)["median"] for metric in shown]
        cells = [number(metric.scale * value, metric.decimals) for metric, value in zip(shown, values, strict=True)]
        rank = NONE if row.reason is not None else str(i + 1)
        text.append([rank, row.label, NONE if row.order is None else str(row.order), *cells])
        lacking = {metric.name: row.reasons[metric.name] for metric in shown if metric.name not in row.summary}
        notes += [f"{row.title}: no {', '.join(names)}: {reason}" for reason, names in by_reason(lacking).items()]
    broken = {
        metric.name: good[0].reasons[metric.name]
        for metric in metrics_at(())
        if good and metric not in shown and not metric.needs & SIMULATED and metric.name in good[0].reasons
    }
    notes += [f"no {', '.join(names)} in any row: {reason}" for reason, names in by_reason(broken).items()]
    failed = [f"{row.title} failed: {row.reason}" for row in found.rows if not row.estimates]
    headers = ["rank", "method", "order", *(f"{metric.name} {metric.unit}" for metric in shown)]
    return [*to_text(headers, text).splitlines(), *notes, *failed]
