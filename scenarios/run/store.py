"""A run's folder: finished pieces under readable names, an index of what they were made from, one run at a time."""

import json
import os
import re
import secrets
import tomllib
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
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
TEMPORARY = re.compile(r"\..*\.[0-9a-f]{12}\.tmp(\.\w+)?")  # what a killed run was writing
ROOMS = (INDEX, "recordings", "models", "trials", "figures")  # folders in which we write
SIDECAR = ".json"
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)  # what Windows takes for devices
# Parts of a scenario that may change between two runs in one folder: they ask for other pieces of the same data.
MAY_CHANGE = ("method", "score", "expect", "description")


@dataclass(frozen=True)
class Slot:
    """Where a trial lies: name of the piece, the code that makes it, the label that it stands under."""

    name: str
    code: str
    label: str


class Store:
    """Finished pieces of a folder: the only place that knows paths.

    A piece is used again only if it is what this run would make: its entry in the index has the same key (a digest of
    all that it is made from) and the same code, and its bytes are those that were written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, name: str) -> Path:
        """Return where a piece lies."""
        return self.folder / name

    def has(self, name: str, key: str, code: str) -> bool:
        """Whether a finished piece of this key is there; raises ExciteError where its file is not what was written."""
        entry = self._entry(name)
        if entry is None or (entry["key"], entry["code"]) != (key, code):
            return False
        with intact(self.path(name)):
            if file_digest(self.path(name)) != entry["sha256"]:
                raise ExciteError("it is not what was written")
        return True

    def adopt(self, slots: Mapping[str, Slot]) -> None:
        """Bring trials that lie under the name of an earlier label to the names they have now: key -> slot."""
        found = {name: entry for name in self.names() if (entry := self._entry(name)) is not None}
        places = {(entry["key"], entry["code"]): name for name, entry in found.items()}
        moves = {}
        for key, slot in slots.items():
            source, there = places.get((key, slot.code)), found.get(slot.name, {})
            mine = {"key": key, "code": slot.code, "label": slot.label}
            if source is None or mine.items() <= there.items():
                continue
            with suppress(OSError):  # what cannot be read is made again
                if file_digest(self.path(source)) == found[source]["sha256"]:
                    moves[key] = source, json.loads(self.path(source).read_text(encoding="utf-8"))
        for key, (_, trial) in moves.items():
            self._keep(slots[key], key, _json({**trial, "label": slots[key].label}))
        for source in {source for source, _ in moves.values()} - {slot.name for slot in slots.values()}:
            self.remove(source)

    def remove(self, name: str) -> None:
        """Take a piece out of the folder, and the folders that it leaves empty."""
        for path in (self.path(name), self.folder / INDEX / f"{name}{SIDECAR}"):
            clear(path)
            with suppress(OSError):  # one that is not empty
                path.parent.rmdir()

    def outdated(self, made_by: Mapping[str, str]) -> tuple[str, ...]:
        """Return which pieces other code made than that which makes them now (name -> code), in one line if any."""
        entries = ((self._entry(name), code) for name, code in made_by.items())
        count = sum(entry is not None and entry["code"] != code for entry, code in entries)
        pieces = f"{count} piece{'s were' if count > 1 else ' was'}"
        return (f"{pieces} made by another version of the code or of a plug-in, and made again",) if count else ()

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
        clear(self.path(name))
        save_signal(signal, self.path(name), certificate=certificate)
        self._enter(name, file_digest(self.path(name)), key=key, code=code)

    def save_recording(self, name: str, key: str, code: str, recording: Recording) -> None:
        """Keep a recording."""
        path = self.path(name)
        make_folder(path.parent)
        temporary = self.folder / f".{path.stem}.{secrets.token_hex(6)}.tmp{path.suffix}"  # not among the finished ones
        try:
            save_recording(recording, temporary)
            clear(path)
            self._enter(name, file_digest(temporary), key=key, code=code)
            os.replace(temporary, path)
        finally:
            with suppress(OSError):
                temporary.unlink()

    def save_trial(self, slot: Slot, key: str, trial: Trial) -> None:
        """Keep a trial."""
        self._keep(slot, key, _json(trial_to_dict(trial)))

    def _keep(self, slot: Slot, key: str, text: str) -> None:
        path = self.path(slot.name)
        make_folder(path.parent)
        clear(path)
        with written(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
            self._enter(slot.name, file_digest(temporary), key=key, code=slot.code, label=slot.label)

    def write_json(self, name: str, value: Any) -> None:
        """Write a result as strict JSON."""
        write_json(self.path(name), value)

    def _entry(self, name: str) -> dict[str, str] | None:
        try:
            entry = json.loads((self.folder / INDEX / f"{name}{SIDECAR}").read_text(encoding="utf-8"))
            whole = all(isinstance(entry[key], str) for key in ("key", "code", "sha256"))
            return entry if whole and self.path(name).exists() else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def _enter(self, name: str, sha256: str, **made_of: str) -> None:
        """Enter a piece before it takes its place, which is free: a run that is killed between the two makes it again."""
        write_json(self.folder / INDEX / f"{name}{SIDECAR}", {**made_of, "sha256": sha256})


class Shelf(MutableMapping[str, Trial]):
    """Trials of a store by their keys, for `identify.compare.run_trials`."""

    def __init__(self, store: Store, slots: Mapping[str, Slot]) -> None:
        self.store, self.slots = store, slots

    def __getitem__(self, key: str) -> Trial:
        slot = self.slots[key]
        if not self.store.has(slot.name, key, slot.code):
            raise KeyError(key)
        return self.store.trial(slot.name)

    def __setitem__(self, key: str, trial: Trial) -> None:
        self.store.save_trial(self.slots[key], key, trial)

    def __delitem__(self, key: str) -> None:
        raise KeyError(f"{key}: trials are kept")

    def __iter__(self) -> Iterator[str]:
        return (key for key, slot in self.slots.items() if self.store.has(slot.name, key, slot.code))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def file_safe(label: str) -> str:
    """Return a label in letters that every file system takes."""
    name = re.sub(r"[^A-Za-z0-9_.=-]+", "_", label).strip("._")[:80].strip("._") or "method"
    return f"{name}_" if RESERVED.fullmatch(name) else name


@contextmanager
def open_folder(folder: Path, source: Mapping[str, Any]) -> Iterator[Store]:
    """Hold a run's folder for one resolved scenario; the lock dies with the process.

    Refused are a folder of other data, one of before there was an index, one in use, one that cannot be written. Methods,
    scores, expectations and the number of estimation runs may change: pieces that stay the same serve again.
    """
    make_folder(folder)
    _check_run(folder, source)  # before anything in the folder is touched
    with hold(folder):
        before, text = _check_run(folder, source), tomli_w.dumps(dict(source))
        make_folder(folder / INDEX)
        if before != text:
            write_text(folder / RESOLVED, text)
        yield Store(folder)


def _check_run(folder: Path, source: Mapping[str, Any]) -> str | None:
    """Return the resolved scenario that a folder holds, or None; refuse a folder that this one cannot go on in."""
    marker = folder / RESOLVED
    with writing(folder):
        there, others = marker.exists(), any(not _ours(path) for path in folder.iterdir())
    if not there and others:
        raise ExciteError(f"{folder}: holds other files and no run; choose an empty or new folder with -o")
    if not there:
        return None
    if not (folder / INDEX).is_dir():
        raise ExciteError(
            f"{folder}: holds a run of an earlier version, whose pieces nothing vouches for; choose another folder with -o, "
            "or remove this one"
        )
    with intact(marker):
        before = marker.read_text(encoding="utf-8", errors="replace")
    if not _same_data(before, source):
        raise ExciteError(
            f"{folder}: holds a run of another scenario (its {RESOLVED} differs); choose another folder with -o, or remove "
            "this one"
        )
    return before


def check_comparison(folder: Path, result: str) -> None:
    """Refuse a folder that holds a run, or a comparison (its file `result`) of before there was an index."""
    with writing(folder):
        run, before = (folder / RESOLVED).exists(), (folder / result).exists() and not (folder / INDEX).is_dir()
    if run:
        raise ExciteError(f"{folder}: holds a run of a scenario; choose another folder for the comparison with -o")
    if before:
        raise ExciteError(
            f"{folder}: holds a comparison of an earlier version, whose models nothing vouches for; choose another folder "
            "with -o, or remove this one"
        )


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
        raise _unwritable(folder, error) from error
    try:
        _sweep(folder)
        yield
    finally:
        lock.release()


def _sweep(folder: Path) -> None:
    """Remove what a killed run was writing, from where we write and nowhere else."""
    with suppress(OSError):
        for path in (*folder.iterdir(), *(path for room in ROOMS for path in (folder / room).rglob("*"))):
            if TEMPORARY.fullmatch(path.name):
                path.unlink()


def _ours(path: Path) -> bool:
    return path.name in (LOCK, INDEX) or TEMPORARY.fullmatch(path.name) is not None


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
    except (FileExistsError, NotADirectoryError) as error:
        raise ExciteError(f"{folder}: a file is in the way; name another folder with -o") from error
    except OSError as error:
        raise _unwritable(folder, error) from error


def clear(path: Path) -> None:
    """Remove a file that is to be written again, or that nothing asks for, where it is there."""
    with writing(path):
        path.unlink(missing_ok=True)


@contextmanager
def writing(place: Path) -> Iterator[None]:
    """Turn what the file system refuses inside into an error that names the place and the remedy."""
    try:
        yield
    except OSError as error:
        raise _unwritable(place, error) from error


def _unwritable(place: Path, error: OSError) -> ExciteError:
    return ExciteError(f"{place}: cannot be written ({error.strerror or error}); choose another folder with -o")


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
