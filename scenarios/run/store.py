"""A run's folder: pieces written atomically, one run at a time, resumed where it was left."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomli_w
from filelock import FileLock, Timeout

from excite.errors import ExciteError
from excite.files.atomic import written
from identify.estimate_json import plain

RESOLVED, LOCK = "scenario.toml", ".lock"
TEMPORARY = ".*.tmp"  # what a killed run was writing


@contextmanager
def open_folder(folder: Path, source: Mapping[str, Any]) -> Iterator[Path]:
    """Hold a run's folder for one resolved scenario; the lock dies with the process.

    A folder of another scenario, one in use, and one that cannot be written are refused. The number of estimation runs
    may change: what was made for fewer serves more.
    """
    marker = folder / RESOLVED
    make_folder(folder)
    if not marker.exists() and any(p.name != LOCK and not p.match(TEMPORARY) for p in folder.iterdir()):
        raise ExciteError(f"{folder}: holds other files and no run; choose an empty or new folder with -o")
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise ExciteError(
            f"{folder}: another run is working in this folder; wait for it, or choose another with -o"
        ) from None
    except OSError as error:
        raise ExciteError(f"{folder}: cannot be written ({error.strerror}); choose another folder with -o") from None
    try:
        for leftover in folder.rglob(TEMPORARY):
            leftover.unlink()
        text = tomli_w.dumps(dict(source))
        before = marker.read_text(encoding="utf-8", errors="replace") if marker.exists() else None
        if before is not None and not _same_pieces(before, source):
            raise ExciteError(
                f"{folder}: holds a run of another scenario (its {RESOLVED} differs); choose another folder with -o, or "
                "remove this one"
            )
        if before != text:
            write_text(marker, text)
        yield folder
    finally:
        lock.release()


def _same_pieces(resolved: str, source: Mapping[str, Any]) -> bool:
    """Whether two scenarios make the same pieces: whether they agree in all but the number of estimation runs."""

    def essence(scenario: Mapping[str, Any]) -> dict[str, Any]:
        return {**scenario, "data": {k: v for k, v in scenario.get("data", {}).items() if k != "estimation_runs"}}

    try:
        return essence(tomllib.loads(resolved)) == essence(source)
    except (tomllib.TOMLDecodeError, AttributeError):
        return False


@contextmanager
def intact(path: Path) -> Iterator[None]:
    """Turn whatever a damaged piece raises while it is read into an error that names it and the remedy."""
    try:
        yield
    except (ExciteError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = str(error) if isinstance(error, ExciteError) else f"{type(error).__name__}: {error}"
        raise ExciteError(f"{path}: is damaged ({reason}); delete it, and the same command makes it again") from error


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ExciteError(f"{folder}: a file is in the way; name another folder with -o") from None
    except OSError as error:
        raise ExciteError(f"{folder}: cannot be written ({error.strerror}); choose another folder with -o") from None


def write_text(path: Path, text: str) -> None:
    """Write text atomically, making the folders above."""
    make_folder(path.parent)
    with written(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write strict JSON atomically, non-finite numbers as null."""
    write_text(path, json.dumps(plain(value), indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read what `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))
