"""excite run."""

import os
import sys
from contextlib import redirect_stdout
from pathlib import Path

import click

from excite.errors import ExciteError
from scenarios.cli.common import json_option
from scenarios.cli.output import ProgressLine, as_path, print_json, print_lines


@click.command()
@click.argument("scenario")
@click.option("-o", "folder", type=click.Path(), help="Folder of the run; runs/NAME when not given.")
@click.option("--runs", type=click.IntRange(1), help="Estimation runs, instead of the scenario's own number.")
@click.option(
    "--jobs", type=click.IntRange(1), default=os.cpu_count, help="Processes to use; all cores when not given."
)
@json_option
def run(scenario: str, folder: str | None, runs: int | None, jobs: int, as_json: bool) -> int:
    """Design, play, identify, score and report, as SCENARIO says.

    SCENARIO is a TOML file or a shipped name (`excite scenarios` lists them). A run that was interrupted goes on
    where it was when the same command is given again; --runs may change between.
    """
    from scenarios.report.figures import all_figures, write_figures
    from scenarios.report.page import write_report
    from scenarios.report.text import failures, summary_text
    from scenarios.run.executor import Local
    from scenarios.run.results import to_json
    from scenarios.run.run import run_scenario
    from scenarios.scenario.reading import load_scenario

    checked = load_scenario(scenario, runs)
    if folder == "":
        raise ExciteError("-o '': is no folder; name one that is there or can be made")
    target = Path("runs") / checked.name if folder is None else as_path(folder)
    try:
        with redirect_stdout(sys.stderr):  # what a plug-in prints is no result
            result = run_scenario(checked, target, jobs, ProgressLine())
            figures = all_figures(result)
        drawn = write_figures(figures, target / "figures", Local(jobs))
        write_report(result, target / "report.html", drawn)
    except KeyboardInterrupt:
        click.echo(f"\n{target}: finished pieces are kept; the same command goes on from there", err=True)
        raise
    if as_json:
        print_json(to_json(result))
    else:
        print_lines(summary_text(result))
    for text in failures(result):
        click.echo(f"warning: {text}", err=True)
    if result.failed:
        click.echo(f"excite: {target}: no method gave a model; see the reasons in the tables", err=True)
        return 2
    return 0 if all(met for _, _, met in result.expectations) else 1
