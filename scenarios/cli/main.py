"""`excite`: the command group, and the one place where errors become exit codes."""

import os
import sys
import traceback
from importlib import import_module
from importlib.metadata import entry_points
from types import TracebackType
from typing import Any

import click

from excite.errors import ExciteError, did_you_mean
from scenarios.cli.loading import loading

NAMES = (
    "run",
    "design",
    "check",
    "export",
    "simulate",
    "identify",
    "score",
    "orders",
    "compare",
    "plants",
    "methods",
    "scenarios",
    "metrics",
    "formats",
    "guide",
    "doctor",
)
# Each command is in the file of its name: name -> "module:command". Modules load when their command is called.
COMMANDS: dict[str, str] = {name: f"scenarios.cli.{name}:{name}" for name in NAMES}
BUG, INTERRUPTED = 70, 130


class Commands(click.Group):
    """Loads commands by name and names the nearest one for a misspelling."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command, or refuse with the nearest known name."""
        if name not in COMMANDS:
            raise click.UsageError(f"no command '{name}'; {did_you_mean(name, COMMANDS)}", ctx)
        module, attribute = COMMANDS[name].split(":")
        with loading():
            return getattr(import_module(module), attribute)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="excite-sysid", prog_name="excite")
def cli() -> None:
    """Design an identification experiment, play it, identify models and score them.

    \b
    Exit codes: 0 fine; 1 an expectation of a scenario missed;
    2 bad input or usage; 3 design refused; 70 a bug; 130 interrupted.
    """


def status(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    try:
        with cli.make_context("excite", list(sys.argv[1:] if argv is None else argv)) as context:
            code: Any = cli.invoke(context)
        if sys.stdout is not None:
            sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except click.ClickException as error:
        error.show(sys.stderr)
        return error.exit_code
    except ExciteError as error:
        click.echo(f"excite: {error}", err=True)
        return error.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("excite: interrupted", err=True)
        return INTERRUPTED
    except OSError as error:
        if error.filename is not None:  # a path, not the open stream of the output: that should have been met earlier
            return _bug()
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            return 0
        click.echo(f"excite: the output cannot be written ({error.strerror}); send it elsewhere", err=True)
        return ExciteError.exit_code
    except Exception:
        return _bug()


def _bug() -> int:
    traceback.print_exc()
    guest = _plug_in(sys.exc_info()[2])
    whose = f"this is a bug of the plug-in package '{guest}'" if guest else "this is a bug"
    click.echo(f"excite: {whose}; please report it with the lines above", err=True)
    return BUG


def _plug_in(trace: TracebackType | None) -> str | None:
    """Return the module of a plug-in that an error passed through, or None."""
    guests = {
        point.module.split(".")[0]
        for group in entry_points().groups
        if group.startswith("excite.")
        for point in entry_points(group=group)
    }
    modules = (str(frame.f_globals.get("__name__")).split(".")[0] for frame, _ in traceback.walk_tb(trace))
    return next((module for module in modules if module in guests), None)
