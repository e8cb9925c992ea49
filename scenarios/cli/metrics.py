"""excite metrics."""

from textwrap import wrap

import click

from identify.metrics.metric import describe
from identify.metrics.registry import list_metrics, load_metric
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines

WIDTH = 110


@click.command()
@click.argument("name", required=False)
@json_option
def metrics(name: str | None, as_json: bool) -> int:
    """List the metrics by which models are judged, or describe one: what it tells, and what it cannot."""
    described = {key: describe(load_metric(key)) for key in ([name] if name else list_metrics())}
    if as_json:
        print_json({"schema_version": 1, "metrics": described})
    elif name is None:
        print_lines([f"{key:<34} {d['summary']}" for key, d in described.items()])
    else:
        d = described[name]
        better = "smaller" if d["smaller_is_better"] else "larger"
        lines = [f"{name}: {d['summary']}", f"in tables: {d['header']}; {better} is better, {d['best']:g} is perfect"]
        lines += [f"needs: {', '.join(d['needs']) or 'nothing'}"]
        lines += wrap(f"tells: {d['tells']}", WIDTH) + wrap(f"cannot tell: {d['cannot_tell']}", WIDTH)
        print_lines(lines)
    return 0
