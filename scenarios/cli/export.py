"""excite export."""

from contextlib import nullcontext
from typing import Any

import click

from excite.errors import ExciteError, placed
from excite.files import export as write
from excite.files.formats import FORMATS, named
from excite.limits.limits import load_limits
from excite.limits.played import prepare, refuse_rounded_excess
from scenarios.cli.common import json_option, limits_option, plot_option
from scenarios.cli.output import new_file, played_lines, plot_later, print_json, print_lines
from scenarios.cli.reading import read_signal, signal_options


@click.command()
@click.argument("file", type=click.Path())
@click.option("--to", "fmt", required=True, metavar="FORMAT", help="Format to write; `excite formats` lists them.")
@click.option(
    "-o", "out", required=True, type=click.Path(), help="File to write; one per channel where the format holds one."
)
@signal_options
@limits_option
@plot_option
@json_option
def export(file: str, fmt: str, out: str, limits: str | None, plot: str | None, as_json: bool, **reading: Any) -> int:
    """Write the signal in FILE for hardware or in another format.

    It is certified as what will be played.
    """
    extension = new_file(out, file).suffix.lower()
    owners = [name for name in named(extension) if FORMATS[name].write]
    if owners and fmt in FORMATS and fmt not in owners:
        raise ExciteError(f"-o {out}: extension '{extension}' says {owners[0]}, but --to says {fmt}; make them agree")
    draw = plot_later(plot)
    bounds, signal = None if limits is None else load_limits(limits), read_signal(file, **reading)
    with placed(limits) if limits else nullcontext():
        played = prepare(signal, bounds)
        refuse_rounded_excess(played.signal, bounds, fmt)
    paths = write(played.signal, fmt, out, certificate=played.certificate.to_dict())
    draw(played.signal, bounds)
    if as_json:
        print_json({"schema_version": 1, "files": [str(p) for p in paths], "format": fmt, **played.to_dict()})
        return 0
    for path in paths:
        click.echo(
            f"{path}: {len(played.signal.u)} samples of {played.signal.dt:g} s, {len(played.signal.channels)} channels"
        )
    if played.shaped is not None:
        print_lines(played_lines(played))
    return 0
