"""excite metrics."""

import click

from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines


@click.command()
@click.argument("name", required=False)
@json_option
def metrics(name: str | None, as_json: bool) -> int:
    """List the metrics by which models are judged, or describe one."""
    from identify.metrics.metric import describe
    from identify.metrics.registry import list_metrics, load_metric

    described = {key: describe(load_metric(key)) for key in ([name] if name else list_metrics())}
    if as_json:
        print_json({"schema_version": 1, "metrics": described})
    elif name is None:
        print_lines([f"{key:<34} {d['summary']}" for key, d in described.items()])
    else:
        d = described[name]
        needs = f"needs: {'; '.join(d['needs'])}" if d["needs"] else "needs nothing but a model"
        better = f"{'smaller' if d['smaller_is_better'] else 'larger'} is better; {d['best']:g} for a perfect model"
        shown = f"shown as: {d['header']}"
        print_lines(
            [
                f"{name}: {d['summary']}",
                better,
                shown,
                needs,
                f"tells: {d['tells']}",
                f"cannot tell: {d['cannot_tell']}",
            ]
        )
    return 0
