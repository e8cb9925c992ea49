"""excite compare."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import click

from excite.errors import ExciteError
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
    **reading: object,
) -> int:
    """Fit several methods and orders to the data in FILEs and rank them by fit on validation data.

    Finished fits are kept in the folder: the same command goes on where it was interrupted.
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
        found, report = compare_in_folder(
            target, chosen, data, judged, place=label, progress=lambda done, total: line("identifying", done, total)
        )
    except KeyboardInterrupt:
        click.echo(f"\n{target}: finished fits are kept; the same command goes on from there", err=True)
        raise
    if as_json:
        print_json(report)
    else:
        old = [f"old: not asked for this time: {', '.join(report['old'])}"] if report["old"] else []
        print_lines([f"validation: {label}", *_table(found), *old])
    for row in found.rows:
        for failure in row.failures:
            if failure.traceback:
                reason = f"{failure.reason} (the traceback is in {target / 'comparison.json'})"
                click.echo(f"warning: {row.title}: {reason}", err=True)
    return 2 if found.failed else 0


def _table(found: "Comparison") -> list[str]:
    from excite.words import number
    from scenarios.report.tables import to_text

    shown = ("fit_simulation", "fit_one_step", "vaf_simulation", "vaf_one_step")
    good = [row for row in found.rows if row.estimates]
    text = [
        [
            str(i + 1),
            row.label,
            "" if row.order is None else str(row.order),
            *("" if name not in row.summary else number(row.statistics(name)["median"], 2) for name in shown),
        ]
        for i, row in enumerate(good)
    ]
    failed = [f"{row.title} failed: {row.reason}" for row in found.rows if not row.estimates]
    notes = [f"{row.title}: {text}" for row in good for text in _grouped(row.reasons, shown)]
    return [*to_text(["rank", "method", "order", *(f"{name} %" for name in shown)], text).splitlines(), *notes, *failed]


def _grouped(reasons: Mapping[str, str], shown: Sequence[str]) -> list[str]:
    """Return why metrics that the table shows have no value, each reason once."""
    groups: dict[str, list[str]] = {}
    for name in shown:
        if name in reasons:
            groups.setdefault(reasons[name], []).append(name)
    return [f"no {', '.join(names)}: {reason}" for reason, names in groups.items()]
