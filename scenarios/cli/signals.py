"""excite check, export, simulate."""

from dataclasses import asdict
from typing import Any

import click

from excite import files
from excite.errors import ExciteError, did_you_mean
from excite.limits.limits import check as check_limits
from excite.persistency.certificate import certify, verdict
from excite.persistency.regressors import information
from identify.method import Method
from identify.registry import load_method, method_class
from scenarios.cli.common import (
    assignments,
    columns,
    data_options,
    json_option,
    new_file,
    one_column,
    print_json,
    print_lines,
    read_experiment,
)
from scenarios.cli.playing import limits_option, plot_later, plot_option, prepare, read_limits, refuse_rounded_excess

WRITABLE = {name: given.extensions for name, given in files.FORMATS.items() if given.write}


@click.command()
@click.argument("file", type=click.Path())
@click.option("--order", type=click.IntRange(1), help="Order that is needed; exit code 3 when it is not reached.")
@click.option("--noise-floor", type=float, help="Standard deviation below which nothing counts as excitation.")
@click.option("--method", "methods", multiple=True, metavar="NAME", help="Judge whether it is enough for this method.")
@click.option("--model-order", type=click.IntRange(1), default=4, show_default=True, help="Model order for --method.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Setting of the methods that have it.")
@click.option("--arx", metavar="NA,NB", help="Judge the joint information of (y, u), as closed-loop data need it.")
@limits_option
@plot_option
@data_options
@json_option
def check(
    file: str,
    order: int | None,
    noise_floor: float | None,
    methods: tuple[str, ...],
    model_order: int,
    settings: tuple[str, ...],
    arx: str | None,
    limits: str | None,
    plot: str | None,
    as_json: bool,
    **reading: Any,
) -> int:
    """Certify the persistency of excitation of the inputs in FILE; exit code 3 when it is not enough for what is asked."""
    from scenarios.report.tables import certificate_text

    draw = plot_later(plot)
    judged = [_method(name, settings, methods) for name in methods]
    signal = files.load_signal(file, columns(reading["inputs"]), dt=reading["dt"], time=one_column(reading["time"]))
    certificate = certify(signal, order or 20, noise_floor)
    result: dict[str, Any] = {"schema_version": 1, "file": file, **certificate.to_dict()}
    lines, enough = certificate_text(certificate), not order or certificate.reached
    for method in judged:
        what = f"{method.name} ({', '.join(f'{k} {v}' for k, v in asdict(method).items())}) and order {model_order}"
        needs = method.required_excitation(model_order), method.sufficient_excitation(model_order)
        found = verdict(signal, what, *needs, noise_floor)
        result.setdefault("verdicts", []).append(asdict(found))
        lines.append(str(found))
        enough = enough and found.ok
    if arx:
        joint = information(read_experiment(file, **reading), *_lags(arx))
        result["information"] = joint.to_dict()
        lines.append(str(joint))
        enough = enough and joint.ok
    if limits:
        report = check_limits(signal, read_limits(limits))
        result["limits"] = report.to_dict()
        lines += map(str, report.checks)
        enough = enough and report.ok
    draw(signal, limits)
    if as_json:
        print_json(result)
    else:
        print_lines(lines)
    return 0 if enough else 3


def _method(name: str, settings: tuple[str, ...], methods: tuple[str, ...]) -> Method:
    options, kinds = assignments(settings, "--set"), [method_class(m) for m in methods]
    for key in options:
        if not any(key in kind.__dataclass_fields__ for kind in kinds):
            raise ExciteError(f"--set {key}: none of {', '.join(methods)} has this setting")
    return load_method(name, **{k: v for k, v in options.items() if k in method_class(name).__dataclass_fields__})


def _lags(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(p.strip().isdigit() for p in parts):
        raise ExciteError(f"--arx {text}: give two whole numbers of lags, as 2,2")
    return int(parts[0]), int(parts[1])


@click.command()
@click.argument("file", type=click.Path())
@click.option("--to", "fmt", required=True, metavar="FORMAT", help=f"One of {', '.join(WRITABLE)}.")
@click.option(
    "-o", "out", required=True, type=click.Path(), help="File to write; one a channel where the format has one."
)
@click.option("--inputs", metavar="COLUMNS", help="Input columns: names or numbers from 0.")
@click.option("--dt", type=float, metavar="SECONDS", help="Sampling time of a file without a time column.")
@click.option("--time", metavar="COLUMN", help="Time column, in seconds.")
@limits_option
@plot_option
@json_option
def export(
    file: str,
    fmt: str,
    out: str,
    inputs: str | None,
    dt: float | None,
    time: str | None,
    limits: str | None,
    plot: str | None,
    as_json: bool,
) -> int:
    """Write the signal in FILE for the hardware, with the certificate of what will be played."""
    extension = new_file(out, file).suffix.lower()
    owners = [name for name, extensions in WRITABLE.items() if extension in extensions]
    if owners and fmt in WRITABLE and fmt not in owners:
        raise ExciteError(f"-o {out}: extension '{extension}' says {owners[0]}, but --to says {fmt}; make them agree")
    draw = plot_later(plot)
    played = prepare(files.load_signal(file, columns(inputs), dt=dt, time=one_column(time)), limits)
    refuse_rounded_excess(played.signal, limits, fmt)
    paths = files.export(played.signal, fmt, out, certificate=played.certificate.to_dict())
    draw(played.signal, limits)
    if as_json:
        print_json({"schema_version": 1, "files": [str(p) for p in paths], "format": fmt, **played.to_dict()})
        return 0
    for path in paths:
        click.echo(
            f"{path}: {len(played.signal.u)} samples of {played.signal.dt:g} s, {len(played.signal.channels)} channels"
        )
    if played.shaped is not None:
        print_lines(played.lines())
    return 0


@click.command()
@click.argument("plant")
@click.option("--input", "file", required=True, type=click.Path(), help="Signal file to play.")
@click.option("--inject", metavar="NAME", help="Where the signal enters; the plant's first place when not given.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise.")
@click.option("--no-noise", is_flag=True, help="Switch all noise off.")
@click.option("--preset", metavar="NAME", help="Preset of the plant.")
@click.option("--set", "parameters", multiple=True, metavar="KEY=VALUE", help="Override a plant parameter.")
@click.option("-o", "out", required=True, type=click.Path(), help="Recording to write (.npz keeps everything).")
@click.option(
    "--clip", type=click.Path(), metavar="FILE.gif", help="Film the flight (quadrotor; needs offscreen graphics)."
)
def simulate(
    plant: str,
    file: str,
    inject: str | None,
    seed: int,
    no_noise: bool,
    preset: str | None,
    parameters: tuple[str, ...],
    out: str,
    clip: str | None,
) -> int:
    """Play a signal file on a simulated PLANT and record it."""
    from plants.registry import load_plant

    if clip is not None and (plant != "quadrotor" or new_file(clip, file, out).suffix.lower() != ".gif"):
        raise ExciteError(f"--clip {clip}: only flights of the quadrotor can be filmed, into a file that ends in .gif")

    extension, known = new_file(out, file).suffix.lower(), [e for each in WRITABLE.values() for e in each]
    if extension not in known:
        raise ExciteError(f"-o {out}: extension '{extension}' cannot be written; {did_you_mean(extension, known)}")
    chosen = load_plant(plant, preset=preset, parameters=assignments(parameters, "--set"))
    recording = chosen.run(files.load_signal(file), inject=inject, noise=not no_noise, seed=seed)
    files.save_recording(recording, out)
    if clip is not None:
        from plants.quadrotor.picture import clip as film

        film(recording, clip)
    names = ", ".join(recording.views)
    click.echo(f"{out}: {len(recording.values)} samples, {len(recording.channels)} channels; views: {names}")
    return 0
