"""excite design: one subcommand per generator, its options read from the generator's signature and documentation."""

import inspect
import re
from collections.abc import Callable
from contextlib import nullcontext

import click

from excite.errors import ExciteError, did_you_mean, placed
from excite.files import save_signal
from excite.files.toml import read_toml
from excite.generators import GENERATORS
from excite.limits.limits import Limits, load_limits
from excite.limits.played import Played, prepare
from excite.proposal.knowledge import Knowledge, knowledge_of
from excite.proposal.proposal import KINDS
from excite.proposal.proposal import propose as propose_design
from excite.types.signal import Signal
from scenarios.cli.common import json_option, limits_option, plot_option, toml_value
from scenarios.cli.output import new_file, played_lines, plot_later, print_json, print_lines
from scenarios.scenario.excitation import play, read_excitation
from scenarios.scenario.toml_table import TomlTable, at_least


class Generators(click.Group):
    """Makes a command of each generator in the table."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all generators."""
        return [*sorted(GENERATORS), *OTHERS]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command that plays one generator."""
        if name in OTHERS:
            return OTHERS[name]
        if name not in GENERATORS:
            raise click.UsageError(f"no signal '{name}'; {did_you_mean(name, [*GENERATORS, *OTHERS])}", ctx)
        command = click.Command(name, callback=_play(name), help=_summary(GENERATORS[name]))
        documented = documentation(GENERATORS[name])
        for parameter in inspect.signature(GENERATORS[name]).parameters.values():
            required = parameter.default is inspect.Parameter.empty
            default = "" if required or parameter.default is None else f"  [default: {parameter.default}]"
            flag, note = f"--{parameter.name.replace('_', '-')}", documented.get(parameter.name, "") + default
            command.params.append(click.Option([flag, parameter.name], metavar="VALUE", required=required, help=note))
        rows = click.option(
            "--block-rows", type=click.IntRange(1), default=20, show_default=True, help="Order to certify."
        )
        out = click.option("-o", "out", required=True, metavar="FILE", help="File to write (.csv, .npz, .mat).")
        return out(rows(limits_option(plot_option(json_option(command)))))


def documentation(function: Callable) -> dict[str, str]:
    """Return what a function's numpydoc says of each parameter."""
    section = re.search(r"\nParameters\n-+\n(.*?)(\n\n|$)", inspect.getdoc(function) or "", re.DOTALL)
    entries = re.split(r"\n(?=\S)", section[1]) if section else []
    pairs = (entry.partition(" : ") for entry in entries)
    return {name.strip(): " ".join(text.split()) for names, _, text in pairs for name in names.split(",")}


def _summary(function: Callable) -> str:
    """Return the first line of a function's documentation as a sentence about what it returns."""
    line = (inspect.getdoc(function) or "").partition("\n")[0].removeprefix("Return ").rstrip(":.")
    return f"{line[:1].upper()}{line[1:]}."


def _play(name: str) -> Callable:
    def command(
        out: str, block_rows: int, as_json: bool, limits: str | None, plot: str | None, **given: str | None
    ) -> int:
        new_file(out)
        draw = plot_later(plot)
        parameters = {key: toml_value(text) for key, text in given.items() if text is not None}
        bounds = None if limits is None else load_limits(limits)
        played = _prepared(GENERATORS[name](**parameters), limits, bounds, block_rows)
        _write(out, played, as_json, {}, [])
        draw(played.signal, bounds)
        return 0

    return command


def _prepared(signal: Signal, file: str | None, limits: Limits | None, block_rows: int) -> Played:
    with placed(file) if file else nullcontext():
        return prepare(signal, limits, block_rows)


def _write(out: str, played: Played, as_json: bool, more: dict, lines: list[str]) -> None:
    signal = played.signal
    save_signal(signal, out, certificate=played.certificate.to_dict())
    if as_json:
        print_json({"schema_version": 1, "file": out, **more, **played.to_dict()})
        return
    kind = "signal" if signal.recipe is None else signal.recipe.kind
    print_lines([f"{out}: {kind}, {len(signal.u)} samples of {signal.dt:g} s, {len(signal.channels)} channels"])
    print_lines([*lines, *played_lines(played)])


@click.command()
@click.argument("kind", metavar="|".join(KINDS))
@click.option("--bandwidth-hz", type=float, help="Highest frequency of interest, Hz.")
@click.option("--settling-s", type=float, help="Time in which responses die out, s.")
@click.option("--limit", type=float, required=True, help="Peak that the input may reach.")
@click.option("--noise", type=float, default=0.0, help="Rms of the output noise.")
@click.option("--gain", type=float, default=1.0, show_default=True, help="Output units per unit of input.")
@click.option("--model", type=click.Path(), help="Model of the last experiment (JSON), instead of the four above.")
@click.option("--dt", type=float, help="Sampling time when it is given, s; checked against aliasing.")
@click.option("--channels", type=click.IntRange(1), default=1, show_default=True, help="Number of inputs.")
@click.option("-o", "out", required=True, metavar="FILE", help="File to write (.csv, .npz, .mat).")
@json_option
def propose(
    kind: str,
    bandwidth_hz: float | None,
    settling_s: float | None,
    limit: float,
    noise: float,
    gain: float,
    model: str | None,
    dt: float | None,
    channels: int,
    out: str,
    as_json: bool,
) -> int:
    """Choose all parameters of a signal, and say why.

    They follow from what is known of the plant, or from the model of the last experiment.
    """
    new_file(out)
    if model is not None:
        from identify.estimate_json import load_estimate

        estimate = load_estimate(model)
        with placed(model):
            known = knowledge_of(estimate.model, limit)
    elif bandwidth_hz is None or settling_s is None:
        raise ExciteError("propose: give --bandwidth-hz and --settling-s, or --model from the last experiment")
    else:
        known = Knowledge(bandwidth_hz, settling_s, limit, noise, gain)
    proposal = propose_design(kind, known, dt, channels)
    reasons = [
        f"{name} = {_short(value)}: {proposal.reasons[name]}"
        for name, value in proposal.parameters.items()
        if name in proposal.reasons
    ]
    lines = [*reasons, *(f"warning: {warning}" for warning in proposal.warnings)]
    more = {"kind": kind, "parameters": proposal.parameters, "reasons": proposal.reasons, "warnings": proposal.warnings}
    _write(out, prepare(GENERATORS[kind](**proposal.parameters)), as_json, {"proposal": more}, lines)
    return 0


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "out", required=True, metavar="FILE", help="File to write (.csv, .npz, .mat).")
@click.option(
    "--block-rows",
    type=click.IntRange(1),
    default=20,
    show_default=True,
    help="Block rows to certify: the largest order that can be shown.",
)
@limits_option
@plot_option
@json_option
def parts(file: str, out: str, block_rows: int, limits: str | None, plot: str | None, as_json: bool) -> int:
    """Play the [[excitation]] parts of a TOML file in turn.

    Each part is followed by its rest (rest_s).
    """
    new_file(out, file)
    draw = plot_later(plot)
    top = TomlTable(read_toml(file), f"{file}: ")
    channels, seed = top.take("channels", (int, list), 1), top.take("seed", int, 0, at_least(0))
    chosen = read_excitation(top)
    top.done()
    with placed(file):
        signal = play(chosen, channels, seed)
    bounds = None if limits is None else load_limits(limits)
    played = _prepared(signal, limits, bounds, block_rows)
    _write(out, played, as_json, {}, [])
    draw(played.signal, bounds)
    return 0


OTHERS = {"parts": parts, "propose": propose}


def _short(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]" if len(value) < 4 else f"{len(value)} points"
    return f"{value:g}" if isinstance(value, float) else str(value)


@click.group(cls=Generators)
def design() -> None:
    """Design a signal, certify it and write both.

    `excite design SIGNAL --help` lists the options of a signal.
    """
