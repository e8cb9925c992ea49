"""What commands write: JSON and lines on stdout, progress on stderr, figures and files at places checked beforehand."""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from excite.errors import ExciteError
from excite.plain import plain

if TYPE_CHECKING:
    from excite.figures.figure import Figure
    from excite.limits.limits import Limits
    from excite.limits.played import Played
    from excite.types.signal import Signal


def print_json(value: Any) -> None:
    """Print one strict JSON object on stdout."""
    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))


def print_lines(lines: list[str]) -> None:
    """Print lines on stdout."""
    click.echo("\n".join(lines))


def played_lines(played: "Played") -> list[str]:
    """Return what to tell of a signal on its way out: its certificate, and what shaping it cost."""
    from scenarios.report.tables import certificate_text

    return [*certificate_text(played.certificate), *played.changes()]


class ProgressLine:
    """A progress bar on stderr when it is a terminal, one line per stage otherwise."""

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


def as_path(path: str) -> Path:
    """Return the path of an output; what cannot be one (too long, with a null character) is refused."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ExciteError(f"-o {path[:60]!r}: cannot be a path ({reason}); choose another") from None
    return Path(path)


def new_file(path: str, *sources: str) -> Path:
    """Return an output file's path, checked before any work is done for it.

    There must be a folder to write it in, and it must be none of the `sources` that are read.
    """
    target = as_path(path)
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
    target = as_path(path)
    there = next(p for p in (target, *target.absolute().parents) if p.exists())
    if not path or not there.is_dir():
        raise ExciteError(f"-o '{path}': is no folder; name one that is there or can be made")
    if not os.access(there, os.W_OK):
        raise ExciteError(f"-o {path}: the folder {there} cannot be written; choose another")
    return target


def save_plot(figure: "Figure", path: str) -> None:
    """Write a figure; the extension says how."""
    from excite.figures.save import save_figure

    save_figure(figure, path)


def plot_later(path: str | None) -> Callable[["Signal", "Limits | None"], None]:
    """Check the path of a signal's figure now and return what draws it, so that a bad name costs no work."""
    if path is None:
        return lambda signal, limits: None
    new_file(path)
    from excite.figures.signal import signal_figure

    return lambda signal, limits: save_plot(signal_figure(signal, limits), path)
