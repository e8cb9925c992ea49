"""excite identify and excite score."""

from pathlib import Path

import click
import numpy as np

from excite.errors import ExciteError, placed
from excite.files import load_recording
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from scenarios.cli.common import (
    assignments,
    data_options,
    json_option,
    new_file,
    print_json,
    print_lines,
    read_experiment,
)


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option("--method", required=True, metavar="NAME", help="Identification method; `excite methods` lists them.")
@click.option("--order", type=int, help="Model order; chosen at the largest singular-value gap when not given.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Method setting, e.g. block_rows=20.")
@data_options
@click.option("-o", "out", type=click.Path(), help="Model file to write (JSON).")
@json_option
def identify(
    file: tuple[str, ...],
    method: str,
    order: int | None,
    settings: tuple[str, ...],
    out: str | None,
    as_json: bool,
    **reading: object,
) -> int:
    """Identify a model from one or several data FILEs (several: one estimate from all of them)."""
    from identify.estimate_json import estimate_to_dict
    from identify.method import load_method
    from identify.score import score as score_estimate
    from scenarios.report.text import estimate_text
    from scenarios.run.store import write_json

    if out is not None:
        new_file(out, *file)
    chosen = load_method(method, **assignments(settings, "--set"))
    data = tuple(read_experiment(path, **reading) for path in file)
    with placed(", ".join(file)):
        estimate = chosen.fit(data, order)
    scores = [score_estimate(estimate, experiment).per_output for experiment in data]
    fit = {
        name: np.mean([s[f"fit_{name}"] for s in scores], axis=0)
        for name in ("simulation", "one_step")
        if f"fit_{name}" in scores[0]
    }
    result = estimate_to_dict(estimate, {"simulation": None, "one_step": None, **fit})
    if out is not None:
        write_json(Path(out), result)
    if as_json:
        print_json(result)
    else:
        print_lines(estimate_text(estimate, fit))
        if out is not None:
            click.echo(f"model written to {out}")
    return 0


@click.command()
@click.argument("model", type=click.Path())
@click.argument("file", type=click.Path())
@click.option(
    "--truth",
    type=click.Choice(["auto", "none"]),
    default="none",
    show_default=True,
    help="auto: score against the truth of the simulated plant that FILE, one of our recordings, comes from.",
)
@data_options
@json_option
def score(model: str, file: str, truth: str, as_json: bool, **reading: object) -> int:
    """Score MODEL (from `excite identify -o`) on the data in FILE."""
    from identify.estimate_json import load_estimate
    from identify.metrics.metric import Need
    from identify.metrics.registry import find_metric
    from identify.score import by_reason
    from identify.score import score as score_estimate
    from identify.score_json import score_to_dict

    estimate = load_estimate(model)
    experiment = read_experiment(file, **reading)
    known = _truth(file, experiment, reading) if truth == "auto" else None
    with placed(f"{model} on {file}"):
        result = score_estimate(estimate, experiment, known)
    if as_json:
        print_json({"schema_version": 1, "model": model, "file": file, **score_to_dict(result)})
        return 0
    for name, value in result.values.items():
        if metric := find_metric(name):
            click.echo(f"{name:<34} {value:>10.4g}  {metric.summary}")
    unasked = {Need.CLEAN} | ({Need.TRUTH, Need.TRUE_MODEL} if known is None else set())
    lacking = {name: why for name, why in result.reasons.items() if not find_metric(name).needs & unasked}
    for reason, names in by_reason(lacking).items():
        click.echo(f"no {', '.join(names)}: {reason}")
    return 0


def _truth(file: str, experiment: Experiment, reading: dict) -> Truth:
    from plants.plant import load_plant

    with placed("--truth auto"):
        recording = load_recording(file)
    view = reading["view"] or recording.default
    given = [f"--{key}" for key in ("inputs", "outputs", "reference", "dt", "time") if reading[key] is not None]
    if given:
        raise ExciteError(f"--truth auto: the truth is that of a recorded view; drop {', '.join(given)}, or --truth")
    if recording.origin.plant is None or view is None:
        raise ExciteError(
            f"{file}: does not say which plant and view it comes from, so there is no truth; drop --truth"
        )
    origin = recording.origin
    plant = load_plant(origin.plant, preset=origin.preset, parameters=origin.parameters)
    truth = plant.truth(recording, view)
    return truth.lift(round(experiment.dt / truth.model.dt))
