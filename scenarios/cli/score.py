"""excite score."""

from typing import Any

import click

from excite.errors import ExciteError, placed
from excite.files import load_recording
from excite.types.channel import listed
from excite.types.truth import Truth
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json
from scenarios.cli.reading import data_options, read_experiment


@click.command()
@click.argument("model", type=click.Path())
@click.argument("file", type=click.Path())
@click.option(
    "--truth",
    type=click.Choice(["auto", "none"]),
    default="none",
    show_default=True,
    help="auto: score against the truth of the simulated plant that FILE, a recording of excite, comes from.",
)
@data_options
@json_option
def score(model: str, file: str, truth: str, as_json: bool, **reading: Any) -> int:
    """Score MODEL (from `excite identify -o`) on the data in FILE."""
    from identify.estimate_json import load_estimate
    from identify.metrics.metric import SIMULATED, Need
    from identify.metrics.registry import find_metric
    from identify.score import by_reason
    from identify.score import score as score_estimate
    from identify.score_json import score_to_dict

    estimate = load_estimate(model)
    experiment = read_experiment(file, **reading)
    known = _truth(file, experiment.dt, reading) if truth == "auto" else None
    with placed(f"{model} on {file}"):
        result = score_estimate(estimate, experiment, known)
    for what in ("inputs", "outputs"):
        mine, theirs = ([c.name for c in getattr(each, what)] for each in (estimate.model, experiment))
        if mine != theirs:
            taken = f"{what} {listed(mine)} of the model are taken to be {listed(theirs)} of the record, in this order"
            click.echo(f"warning: {taken}", err=True)
    if as_json:
        print_json({"schema_version": 1, "model": model, "file": file, **score_to_dict(result)})
        return 0
    for name, value in result.values.items():
        if metric := find_metric(name):
            click.echo(f"{name:<34} {value:>10.4g}  {metric.summary}")
    unasked = SIMULATED if known is None else {Need.CLEAN}
    expected = {name for name in result.reasons if (metric := find_metric(name)) and metric.needs & unasked}
    lacking = {name: why for name, why in result.reasons.items() if name not in expected}
    for reason, names in by_reason(lacking).items():
        click.echo(f"no {', '.join(names)}: {reason}")
    return 0


def _truth(file: str, dt: float | None, reading: dict) -> Truth:
    """Return the truth of the view of a recording that was read, at its sampling time dt, s."""
    from plants.truth_of import truth_of

    with placed("--truth auto"):
        recording = load_recording(file)
    given = [f"--{key}" for key in ("inputs", "outputs", "reference", "dt", "time") if reading[key] is not None]
    if given:
        raise ExciteError(f"--truth auto: the truth is that of a recorded view; drop {', '.join(given)}, or --truth")
    with placed(file):
        return truth_of(recording, reading["view"], dt)
