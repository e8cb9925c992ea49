"""excite design: one subcommand a generator, its options read from the generator's signature."""

import inspect
from typing import Any

import click

from excite.errors import did_you_mean
from excite.files import save_signal
from excite.generators import GENERATORS
from excite.persistency import certify
from scenarios.cli.common import existing_parent, print_json, print_lines, toml_value


class Generators(click.Group):
    """Makes a command of each generator in the table."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all generators."""
        return sorted(GENERATORS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command that plays one generator."""
        if name not in GENERATORS:
            raise click.UsageError(f"no signal '{name}'; {did_you_mean(name, GENERATORS)}", ctx)
        generator = GENERATORS[name]
        options: list[click.Parameter] = [
            click.Option(["-o", "out"], required=True, metavar="FILE", help="File to write (.csv, .npz, .mat)."),
            click.Option(["--block-rows"], type=click.IntRange(1), default=20, show_default=True, help="Order to certify."),
            click.Option(["--json", "as_json"], is_flag=True, help="Print one strict JSON object."),
        ]
        for parameter in inspect.signature(generator).parameters.values():
            required = parameter.default is inspect.Parameter.empty
            note = "required" if required else f"default {parameter.default}"
            flag = f"--{parameter.name.replace('_', '-')}"
            options.append(click.Option([flag, parameter.name], required=required, metavar="VALUE", help=note))
        summary = (generator.__doc__ or "").strip().splitlines()[0]
        return click.Command(name, params=options, callback=_play(name), help=summary)


def _play(name: str) -> Any:
    def command(out: str, block_rows: int, as_json: bool, **given: str | None) -> int:
        from scenarios.report.tables import certificate_text

        existing_parent(out)
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


