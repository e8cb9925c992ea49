"""excite design: one subcommand a generator, its options read from the generator's signature and documentation."""

import inspect
import re
from collections.abc import Callable

import click

from excite.errors import did_you_mean
from excite.files import save_signal
from excite.generators import GENERATORS
from excite.persistency import certify
from scenarios.cli.common import json_option, new_file, print_json, print_lines, toml_value


class Generators(click.Group):
    """Makes a command of each generator in the table."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all generators."""
        return sorted(GENERATORS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command that plays one generator."""
        if name not in GENERATORS:
            raise click.UsageError(f"no signal '{name}'; {did_you_mean(name, GENERATORS)}", ctx)
        command = click.Command(name, callback=_play(name), help=inspect.getdoc(GENERATORS[name]).splitlines()[0])
        documented = documentation(GENERATORS[name])
        for parameter in inspect.signature(GENERATORS[name]).parameters.values():
            required = parameter.default is inspect.Parameter.empty
            default = "" if required or parameter.default is None else f"  [default: {parameter.default}]"
            flag, note = f"--{parameter.name.replace('_', '-')}", documented.get(parameter.name, "") + default
            command.params.append(click.Option([flag, parameter.name], metavar="VALUE", required=required, help=note))
        rows = click.option("--block-rows", type=click.IntRange(1), default=20, show_default=True, help="Order to certify.")
        out = click.option("-o", "out", required=True, metavar="FILE", help="File to write (.csv, .npz, .mat).")
        return out(rows(json_option(command)))


def documentation(function: Callable) -> dict[str, str]:
    """Return what a function's numpydoc says of each parameter."""
    section = re.search(r"\nParameters\n-+\n(.*?)(\n\n|$)", inspect.getdoc(function) or "", re.DOTALL)
    entries = re.split(r"\n(?=\S)", section[1]) if section else []
    pairs = (entry.partition(" : ") for entry in entries)
    return {name.strip(): " ".join(text.split()) for names, _, text in pairs for name in names.split(",")}


def _play(name: str) -> Callable:
    def command(out: str, block_rows: int, as_json: bool, **given: str | None) -> int:
        from scenarios.report.tables import certificate_text

        new_file(out)
        signal = GENERATORS[name](**{key: toml_value(text) for key, text in given.items() if text is not None})
        certificate = certify(signal, block_rows=block_rows)
        save_signal(signal, out, certificate=certificate.to_dict())
        if as_json:
            print_json({
                "schema_version": 1, "file": out, "recipe": dict(signal.recipe), "certificate": certificate.to_dict()
            })  # fmt: skip
        else:
            print_lines([f"{out}: {name}, {len(signal.u)} samples of {signal.dt:g} s, {len(signal.channels)} channels"])
            print_lines(certificate_text(certificate))
        return 0

    return command


@click.group(cls=Generators)
def design() -> None:
    """Design a signal, certify it and write both; `excite design SIGNAL --help` lists its options."""
