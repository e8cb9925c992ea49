"""A run's folder: finished pieces under readable names, an index of what they were made from, one run at a time."""

import json
import os
import re
import secrets
import tomllib
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import tomli_w
from filelock import FileLock, Timeout

from excite.digest import file_digest
from excite.errors import ExciteError
from excite.files import load_recording, load_signal, save_recording, save_signal
from excite.files.atomic import written
from excite.plain import plain
from excite.types.recording import Recording
from excite.types.signal import Signal
from identify.compare import Trial
from identify.trial_json import trial_from_dict, trial_to_dict

RESOLVED, LOCK, INDEX = "scenario.toml", ".lock", "index"
TEMPORARY = ".*.tmp*"  # what a killed run was writing
SIDECAR = ".json"
# Parts of a scenario that may change between two runs in one folder: they ask for other pieces of the same data.
MAY_CHANGE = ("method", "score", "expect", "description")


class Store:
    """Finished pieces of a folder: the only place that knows paths.

    A piece is used again only if it is what this run would make: its entry in the index has the same key (a digest of
    all that it is made from) and the same code, and its bytes are those that were written. `remade` counts the pieces of
    which the code has changed since.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, name: str) -> Path:
        """Return where a piece lies."""
        return self.folder / name

    def has(self, name: str, key: str, code: str) -> bool:
        """Whether a finished piece of this key is there; raises ExciteError where its file is not what was written."""
        entry = self._entry(name)
        if entry is None or not self.path(name).exists() or (entry["key"], entry["code"]) != (key, code):
            return False
        if file_digest(self.path(name)) != entry["sha256"]:
            raise _damaged(self.path(name), "it is not what was written")
        return True

    def outdated(self, name: str, code: str) -> bool:
        """Whether a piece is there that other code made."""
        entry = self._entry(name)
        return entry is not None and self.path(name).exists() and entry["code"] != code

    def names(self) -> set[str]:
        """Names of all pieces in the index that are there."""
        index = self.folder / INDEX
        found = {path.relative_to(index).as_posix().removesuffix(SIDECAR) for path in index.rglob(f"*{SIDECAR}")}
        return {name for name in found if self.path(name).exists()}

    def signal(self, name: str) -> Signal:
        """Return a signal."""
        with intact(self.path(name)):
            return load_signal(self.path(name))

    def recording(self, name: str) -> Recording:
        """Return a recording."""
        with intact(self.path(name)):
            return load_recording(self.path(name))

    def trial(self, name: str) -> Trial:
        """Return a trial."""
        with intact(self.path(name)):
            return trial_from_dict(json.loads(self.path(name).read_text(encoding="utf-8")))

    def save_signal(self, name: str, key: str, code: str, signal: Signal, certificate: Mapping | None) -> None:
        """Keep a signal, as CSV with its sidecar."""
        make_folder(self.path(name).parent)
        save_signal(signal, self.path(name), certificate=certificate)
        self._enter(name, key, code, file_digest(self.path(name)))

    def save_recording(self, name: str, key: str, code: str, recording: Recording) -> None:
        """Keep a recording."""
        path = self.path(name)
        make_folder(path.parent)
        temporary = path.with_name(f".{path.stem}.{secrets.token_hex(6)}.tmp{path.suffix}")
        try:
            save_recording(recording, temporary)
            self._enter(name, key, code, file_digest(temporary))
            os.replace(temporary, path)
        finally:
            with suppress(OSError):
                temporary.unlink()

    def save_trial(self, name: str, key: str, code: str, trial: Trial) -> None:
        """Keep a trial."""
        make_folder(self.path(name).parent)
        with written(self.path(name)) as temporary:
            temporary.write_text(_json(trial_to_dict(trial)), encoding="utf-8")
            self._enter(name, key, code, file_digest(temporary))

    def write_json(self, name: str, value: Any) -> None:
        """Write a result as strict JSON."""
        write_json(self.path(name), value)

    def _entry(self, name: str) -> dict[str, str] | None:
        try:
            entry = json.loads((self.folder / INDEX / f"{name}{SIDECAR}").read_text(encoding="utf-8"))
            return entry if {"key", "code", "sha256"} <= entry.keys() else None
        except (OSError, ValueError, AttributeError):
            return None

    def _enter(self, name: str, key: str, code: str, sha256: str) -> None:
        """Enter a piece before it takes its place: a run that is killed between the two makes it again."""
        write_json(self.folder / INDEX / f"{name}{SIDECAR}", {"key": key, "code": code, "sha256": sha256})


class Shelf(MutableMapping[str, Trial]):
    """Trials of a store by their keys, for `identify.compare.run_trials`; names : key -> name of the piece."""

    def __init__(self, store: Store, names: Mapping[str, str], code: str) -> None:
        self.store, self.names_of, self.code = store, dict(names), code

    def __getitem__(self, key: str) -> Trial:
        name = self.names_of[key]
        if not self.store.has(name, key, self.code):
            raise KeyError(key)
        return self.store.trial(name)

    def __setitem__(self, key: str, trial: Trial) -> None:
        self.store.save_trial(self.names_of[key], key, self.code, trial)

    def __delitem__(self, key: str) -> None:
        raise KeyError(f"{key}: trials are kept")

    def __iter__(self) -> Iterator[str]:
        return (key for key, name in self.names_of.items() if self.store.has(name, key, self.code))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def file_safe(label: str) -> str:
    """Return a label in letters that every file system takes."""
    return re.sub(r"[^A-Za-z0-9_.=-]+", "_", label).strip("._")[:80] or "method"


@contextmanager
def open_folder(folder: Path, source: Mapping[str, Any]) -> Iterator[Store]:
    """Hold a run's folder for one resolved scenario; the lock dies with the process.

    Refused are a folder of other data, one of before there was an index, one in use, one that cannot be written. Methods,
    scores, expectations and the number of estimation runs may change: pieces that stay the same serve again.
    """
    make_folder(folder)
    marker = folder / RESOLVED
    if not marker.exists() and any(not _ours(path) for path in folder.iterdir()):
        raise ExciteError(f"{folder}: holds other files and no run; choose an empty or new folder with -o")
    with hold(folder):
        before = marker.read_text(encoding="utf-8", errors="replace") if marker.exists() else None
        if before is not None and not (folder / INDEX).is_dir():
            raise ExciteError(
                f"{folder}: holds a run of an earlier version, whose pieces nothing vouches for; choose another folder with "
                "-o, or remove this one"
            )
        if before is not None and not _same_data(before, source):
            raise ExciteError(
                f"{folder}: holds a run of another scenario (its {RESOLVED} differs); choose another folder with -o, or "
                "remove this one"
            )
        make_folder(folder / INDEX)
        text = tomli_w.dumps(dict(source))
        if before != text:
            write_text(marker, text)
        yield Store(folder)


@contextmanager
def hold(folder: Path) -> Iterator[None]:
    """Hold a folder against other processes, and sweep what a killed one left."""
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
        yield
    finally:
        lock.release()


def _ours(path: Path) -> bool:
    return path.name in (LOCK, INDEX) or path.match(TEMPORARY)


def _same_data(resolved: str, source: Mapping[str, Any]) -> bool:
    """Whether two scenarios make the same data."""

    def essence(scenario: Mapping[str, Any]) -> dict[str, Any]:
        data = {k: v for k, v in scenario.get("data", {}).items() if k != "estimation_runs"}
        return {k: v for k, v in scenario.items() if k not in MAY_CHANGE} | {"data": data}

    try:
        return essence(tomllib.loads(resolved)) == essence(source)
    except (tomllib.TOMLDecodeError, AttributeError):
        return False


@contextmanager
def intact(path: Path) -> Iterator[None]:
    """Turn what a damaged piece raises while it is read into an error that names it and the remedy."""
    try:
        yield
    except (ExciteError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = str(error) if isinstance(error, ExciteError) else f"{type(error).__name__}: {error}"
        raise _damaged(path, reason) from error


def _damaged(path: Path, reason: str) -> ExciteError:
    return ExciteError(f"{path}: is damaged ({reason}); delete it, and the same command makes it again")


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
    write_text(path, _json(value))


def _json(value: Any) -> str:
    return json.dumps(plain(value), indent=1, allow_nan=False) + "\n"
