"""The options that say how to read data files, the same in every command that does."""

from collections.abc import Callable

import click

from excite.errors import ExciteError
from excite.files import load_experiment, load_signal
from excite.types.experiment import Experiment
from excite.types.level import STATES as LEVELS
from excite.types.loop import STATES as LOOPS
from excite.types.signal import Signal

inputs_option = click.option(
    "--inputs", metavar="COLUMNS", help="Input columns: names or numbers from 0, as 0,1 or flap,aileron; or none."
)
dt_option = click.option("--dt", type=float, metavar="SECONDS", help="Sampling time of a file without a time column.")
time_option = click.option("--time", metavar="COLUMN", help="Time column, in seconds.")

SIGNAL_OPTIONS = (inputs_option, dt_option, time_option)
DATA_OPTIONS = (
    inputs_option,
    click.option("--outputs", metavar="COLUMNS", help="Output columns."),
    click.option("--reference", metavar="COLUMNS", help="Reference columns."),
    dt_option,
    time_option,
    click.option("--view", metavar="NAME", help="Which view of a recording."),
    click.option("--setting", hidden=True, expose_value=False, callback=lambda _, __, value: _renamed(value)),
    click.option(
        "--loop",
        type=click.Choice(LOOPS),
        help="Whether the inputs depended on the outputs through feedback. Files of excite say it; any other counts as open "
        "when nothing is given.",
    ),
    click.option(
        "--level",
        type=click.Choice([state for state in LEVELS if state != "known"]),
        help="What the numbers are measured from: the operating point (zero), or unknown. Files of excite say it; any other "
        "counts as zero when nothing is given.",
    ),
    click.option(
        "--decimate", type=click.IntRange(1), default=1, show_default=True, help="Keep each N-th sample (no filter)."
    ),
)


def _renamed(value: str | None) -> None:
    if value is not None:
        raise ExciteError(f"--setting {value}: is called --view now; write --view {value}")


def data_options(command: Callable) -> Callable:
    """Add the options that say how to read the experiment in a data file."""
    for option in reversed(DATA_OPTIONS):
        command = option(command)
    return command


def signal_options(command: Callable) -> Callable:
    """Add the options that say how to read the signal in a data file."""
    for option in reversed(SIGNAL_OPTIONS):
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
    loop: str | None,
    level: str | None,
    decimate: int,
) -> Experiment:
    """Load one experiment with the values of `data_options`."""
    experiment = load_experiment(
        path,
        columns(inputs),
        columns(outputs),
        columns(reference),
        dt=dt,
        time=one_column(time),
        view=view,
        loop=loop,
        level=level,
    )
    return experiment.decimate(decimate)


def read_signal(path: str, inputs: str | None, dt: float | None, time: str | None) -> Signal:
    """Load one signal with the values of `signal_options`."""
    return load_signal(path, columns(inputs), dt=dt, time=one_column(time))
