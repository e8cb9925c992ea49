"""excite check, export, simulate."""

import click

from excite import files
from excite.errors import ExciteError, did_you_mean
from excite.persistency import certify
from scenarios.cli.common import (
    assignments,
    columns,
    json_option,
    new_file,
    one_column,
    print_json,
    print_lines,
)

WRITABLE = {name: given.extensions for name, given in files.FORMATS.items() if given.write}


@click.command()
@click.argument("file", type=click.Path())
@click.option("--order", type=click.IntRange(1), help="Order that is needed; exit code 3 when it is not reached.")
@click.option("--inputs", metavar="COLUMNS", help="Input columns: names or numbers from 0.")
@click.option("--dt", type=float, metavar="SECONDS", help="Sampling time of a file without a time column.")
@click.option("--time", metavar="COLUMN", help="Time column, in seconds.")
@json_option
def check(file: str, order: int | None, inputs: str | None, dt: float | None, time: str | None, as_json: bool) -> int:
    """Certify the persistency of excitation of the inputs in FILE."""
    from scenarios.report.tables import certificate_text

    signal = files.load_signal(file, columns(inputs), dt=dt, time=one_column(time))
    certificate = certify(signal, block_rows=order or 20)
    if as_json:
        print_json({"schema_version": 1, "file": file, **certificate.to_dict()})
    else:
        print_lines(certificate_text(certificate))
    return 3 if order and not certificate.reached else 0


@click.command()
@click.argument("file", type=click.Path())
@click.option("--to", "fmt", required=True, metavar="FORMAT", help=f"One of {', '.join(WRITABLE)}.")
@click.option("-o", "out", required=True, type=click.Path(), help="File to write.")
@click.option("--inputs", metavar="COLUMNS", help="Input columns: names or numbers from 0.")
@click.option("--dt", type=float, metavar="SECONDS", help="Sampling time of a file without a time column.")
@click.option("--time", metavar="COLUMN", help="Time column, in seconds.")
def export(file: str, fmt: str, out: str, inputs: str | None, dt: float | None, time: str | None) -> int:
    """Write the signal in FILE in another format, with the certificate of what will be played."""
    extension = new_file(out, file).suffix.lower()
    owners = [name for name, extensions in WRITABLE.items() if extension in extensions]
    if owners and fmt in WRITABLE and fmt not in owners:
        raise ExciteError(f"-o {out}: extension '{extension}' says {owners[0]}, but --to says {fmt}; make them agree")
    signal = files.load_signal(file, columns(inputs), dt=dt, time=one_column(time))
    files.export(signal, fmt, out, certificate=certify(signal).to_dict())
    click.echo(f"{out}: {len(signal.u)} samples of {signal.dt:g} s, {len(signal.channels)} channels")
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
def simulate(
    plant: str, file: str, inject: str | None, seed: int, no_noise: bool, preset: str | None,
    parameters: tuple[str, ...], out: str,
) -> int:  # fmt: skip
    """Play a signal file on a simulated PLANT and record it."""
    from plants.plant import load_plant

    extension, known = new_file(out, file).suffix.lower(), [e for each in WRITABLE.values() for e in each]
    if extension not in known:
        raise ExciteError(f"-o {out}: extension '{extension}' cannot be written; {did_you_mean(extension, known)}")
    chosen = load_plant(plant, preset=preset, parameters=assignments(parameters, "--set"))
    recording = chosen.run(files.load_signal(file), inject=inject, noise=not no_noise, seed=seed)
    files.save_recording(recording, out)
    names = ", ".join(recording.settings)
    click.echo(f"{out}: {len(recording.values)} samples, {len(recording.channels)} channels; settings: {names}")
    return 0
