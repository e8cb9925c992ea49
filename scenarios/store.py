"""A run's folder: pieces written atomically, one run at a time, resumed where it was left."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomli_w
from filelock import FileLock, Timeout

from excite.errors import ExciteError
from excite.files.atomic import written
from identify.model_json import plain

RESOLVED = "scenario.toml"


@contextmanager
def open_folder(folder: Path, source: Mapping[str, Any]) -> Iterator[Path]:
    """Hold a run's folder for one resolved scenario; the lock dies with the process.

    A folder of another scenario, one in use, and one that cannot be written are refused.
    """
    if folder.exists() and not folder.is_dir():
        raise ExciteError(f"{folder}: is a file; name a folder with -o")
    resolved = tomli_w.dumps(dict(source))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock")
        lock.acquire(blocking=False)
    except Timeout:
        raise ExciteError(f"{folder}: another run is working in this folder; wait for it, or choose another with -o") from None
    except OSError as error:
        raise ExciteError(f"{folder}: cannot be written ({error.strerror}); choose another folder with -o") from None
    try:
        marker = folder / RESOLVED
        if marker.exists():
            if marker.read_text(encoding="utf-8") != resolved:
                raise ExciteError(
                    f"{folder}: holds a run of another scenario or of other options (its {RESOLVED} differs); "
                    "choose another folder with -o, or remove this one"
                )
        elif any(p.name != ".lock" for p in folder.iterdir()):
            raise ExciteError(f"{folder}: holds other files and no run; choose an empty or new folder with -o")
        else:
            write_text(marker, resolved)
        yield folder
    finally:
        lock.release()


def write_text(path: Path, text: str) -> None:
    """Write text atomically, making the folders above."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write strict JSON atomically, non-finite numbers as null."""
    write_text(path, json.dumps(plain(value), indent=1, allow_nan=False) + os.linesep)


def read_json(path: Path) -> Any:
    """Read what `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))
