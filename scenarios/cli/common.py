"""What several commands share: options for data files, printing JSON, progress."""

import json
import os
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from excite.errors import ExciteError
from excite.files import load_experiment
from excite.types.experiment import Experiment
from identify.estimate_json import plain

MOST_ORDERS = 1000
json_option = click.option("--json", "as_json", is_flag=True, help="Print one strict JSON object instead of text.")

DATA_OPTIONS = (
    click.option(
        "--inputs", metavar="COLUMNS", help="Input columns: names or numbers from 0, as 0,1 or flap,aileron; or none."
    ),
    click.option("--outputs", metavar="COLUMNS", help="Output columns."),
    click.option("--reference", metavar="COLUMNS", help="Reference columns."),
    click.option("--dt", type=float, metavar="SECONDS", help="Sampling time of a file without a time column."),
    click.option("--time", metavar="COLUMN", help="Time column, in seconds."),
    click.option("--view", metavar="NAME", help="Which view of one of our own recordings."),
    click.option("--setting", hidden=True, expose_value=False, callback=lambda _, __, value: _renamed(value)),
    click.option(
        "--decimate", type=click.IntRange(1), default=1, show_default=True, help="Keep each N-th sample (no filter)."
    ),
)


def _renamed(value: str | None) -> None:
    if value is not None:
        raise ExciteError(f"--setting {value}: is called --view now; write --view {value}")


def data_options(command: Callable) -> Callable:
    """Add the options that say how to read foreign data files."""
    for option in reversed(DATA_OPTIONS):
        command = option(command)
    return command


def columns(text: str | None) -> list[str | int] | None:
    """Parse 0,1 or flap,aileron; digits are column numbers, and "none" is no column at all."""
    if text is None:
        return None
    if text.strip() == "none":
        return []
    parts = [part.strip() for part in text.split(",")]
    if not any(parts):
        raise ExciteError(f"columns {text!r}: give names or numbers from 0, separated by commas, or none")
    return [int(part) if part.isdigit() else part for part in parts if part]


def one_column(text: str | None) -> str | int | None:
    """Parse one column name or number."""
    chosen = columns(text)
    return chosen[0] if chosen else None


def read_experiment(
    path: str,
    inputs: str | None,
    outputs: str | None,
    reference: str | None,
    dt: float | None,
    time: str | None,
    view: str | None,
    decimate: int,
) -> Experiment:
    """Load one experiment with the values of `data_options`."""
    experiment = load_experiment(
        path, columns(inputs), columns(outputs), columns(reference), dt=dt, time=one_column(time), view=view
    )
    return experiment.decimate(decimate)


def toml_value(text: str) -> Any:
    """Read a TOML value (20, 1.5, true, [1, 2], "a"); anything else is text, and 1,2,3 a list."""
    for candidate in (text, f"[{text}]"):
        try:
            return tomllib.loads(f"v = {candidate}")["v"]
        except tomllib.TOMLDecodeError:
            continue
    try:
        return float(text)  # .5 and 1., which TOML does not know
    except ValueError:
        return [part.strip() for part in text.split(",")] if "," in text else text


def assignments(pairs: tuple[str, ...], option: str) -> dict[str, Any]:
    """Parse key=TOML-value pairs."""
    values = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.strip() or not text.strip():
            raise ExciteError(f"{option} {pair}: give key=value, for example block_rows=20")
        values[key.strip()] = toml_value(text.strip())
    return values


def parse_orders(text: str) -> list[int]:
    """Parse 4, 2,4,8 or 2:10 (both ends included)."""
    try:
        if ":" in text:
            first, last = (int(part) for part in text.split(":"))
            orders = range(first, last + 1)
        else:
            orders = [int(part) for part in text.split(",")]
    except ValueError:
        orders = []
    if len(orders) > MOST_ORDERS:
        raise ExciteError(f"--orders {text}: {len(orders)} orders; give at most {MOST_ORDERS}")
    if not orders or min(orders) < 1:
        raise ExciteError(f"--orders {text}: give positive whole numbers as 4, or 2,4,8, or 2:10")
    return sorted(set(orders))


def print_json(value: Any) -> None:
    """Print one strict JSON object on stdout."""
    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))


def print_lines(lines: list[str]) -> None:
    """Print lines on stdout."""
    click.echo("\n".join(lines))


class ProgressLine:
    """A progress bar on stderr when it is a terminal, one line a stage otherwise."""

    def __init__(self) -> None:
        self.stage = ""
        self.terminal = sys.stderr.isatty()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show that `done` of `total` pieces are finished."""
        if self.terminal:
            filled = 30 * done // total
            bar = "#" * filled + "-" * (30 - filled)
            click.echo(f"\r{stage:<12} [{bar}] {done}/{total}", err=True, nl=done == total)
        elif stage != self.stage or done == total:
            click.echo(f"{stage}: {done} of {total} pieces", err=True)
        self.stage = stage


def new_file(path: str, *sources: str) -> Path:
    """Return an output file's path, checked before any work is done for it: a folder to write in, none of the sources."""
    target = Path(path)
    if not path or target.is_dir():
        raise ExciteError(f"-o '{path}': is a folder; name a file in it")
    if not target.parent.is_dir():
        raise ExciteError(f"-o {path}: there is no folder {target.parent}; create it first")
    if not os.access(target.parent, os.W_OK):
        raise ExciteError(f"-o {path}: the folder {target.parent} cannot be written; choose another")
    for source in sources:
        if target.exists() and Path(source).exists() and target.samefile(source):
            raise ExciteError(f"-o {path}: would overwrite what is read; choose another name")
    return target


def new_folder(path: str) -> Path:
    """Return an output folder's path, checked before any work is done for it."""
    target = Path(path)
    there = next(p for p in (target, *target.absolute().parents) if p.exists())
    if not path or not there.is_dir():
        raise ExciteError(f"-o '{path}': is no folder; name one that is there or can be made")
    if not os.access(there, os.W_OK):
        raise ExciteError(f"-o {path}: the folder {there} cannot be written; choose another")
    return target
