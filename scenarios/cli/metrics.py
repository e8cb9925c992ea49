"""excite metrics."""

import click

from excite.errors import ExciteError, did_you_mean
from identify.score import METRICS
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines


@click.command()
@click.argument("name", required=False)
@json_option
def metrics(name: str | None, as_json: bool) -> int:
    """List the metrics by which models are judged, or describe one."""
    if name is not None and name not in METRICS:
        raise ExciteError(f"metric '{name}' does not exist; {did_you_mean(name, METRICS)}")
    described = {
        key: {"summary": METRICS[key][0], "smaller_is_better": METRICS[key][1]}
        for key in ([name] if name else sorted(METRICS))
    }
    if as_json:
        print_json({"schema_version": 1, "metrics": described})
    elif name is None:
        print_lines([f"{key:<34} {d['summary']}" for key, d in described.items()])
    else:
        better = "smaller" if described[name]["smaller_is_better"] else "larger"
        print_lines([f"{name}: {described[name]['summary']}", f"{better} is better"])
    return 0
