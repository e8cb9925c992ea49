"""Files on disk: written beside their target and renamed into place, checked before they are read."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from excite.errors import ExciteError

MAX_BYTES = 4 * 2**30


@contextmanager
def written(path: str | os.PathLike) -> Iterator[Path]:
    """Yield an empty temporary file beside `path`; on success it is synced and takes the place of `path`.

    An error inside removes the temporary file and leaves what `path` held before. A folder that is missing or closed to
    writing, a full disk: ExciteError naming the path.
    """
    target = Path(os.path.realpath(_named(path)))
    if target.is_dir():
        raise ExciteError(f"{path}: is a folder; name a file in it")
    if not target.parent.is_dir():
        raise ExciteError(f"{path}: there is no folder {target.parent}; create it first")
    temporary = target.with_name(f".{target.name[:40]}.{secrets.token_hex(6)}.tmp")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield temporary
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, target)
        _sync_folder(target.parent)
    except OSError as error:
        raise ExciteError(f"{path}: cannot be written ({error.strerror or error}); choose another place") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _sync_folder(folder: Path) -> None:
    """Make the rename itself durable, where the system lets a folder be synced."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _named(path: str | os.PathLike) -> Path:
    if "\0" in os.fspath(path):
        raise ExciteError(f"{os.fspath(path)!r}: a path cannot hold a null character; check it")
    return Path(path)


def readable(path: str | os.PathLike) -> Path:
    """Return `path` when it is a file that can be read, not empty and of bearable size; otherwise ExciteError."""
    path = _named(path)
    if path.is_dir():
        raise ExciteError(f"{path}: is a folder; name a file in it")
    if not path.exists():
        raise ExciteError(f"{path}: no such file; check the path")
    if not path.is_file():
        raise ExciteError(f"{path}: is not a regular file; copy the data into one")
    size = path.stat().st_size
    if size == 0:
        raise ExciteError(f"{path}: is empty; it must hold at least one sample")
    if size > MAX_BYTES:
        raise ExciteError(f"{path}: {size} bytes exceed the limit of {MAX_BYTES}; split the file")
    try:
        with open(path, "rb"):
            return path
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
