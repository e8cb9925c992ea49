"""Data files: one table of formats; the extension chooses, `export` may name one."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from excite.errors import ExciteError, did_you_mean
from excite.files import mat, npz, text
from excite.files.own import damaged, to_loop, to_recording, to_table
from excite.files.roles import Columns, channels, choose, require, sampling
from excite.files.table import Table
from excite.types.experiment import Experiment
from excite.types.recording import Recording
from excite.types.signal import Signal


@dataclass(frozen=True)
class Format:
    """One file format: its extensions, how it is read, and how it is written where it can be."""

    extensions: tuple[str, ...]
    read: Callable[[Path], Table]
    write: Callable[[Table, Path], None] | None = None


FORMATS: dict[str, Format] = {
    "csv": Format((".csv",), text.read, text.write),
    "columns": Format((".dat", ".txt"), text.read),
    "npz": Format((".npz",), npz.read, npz.write),
    "mat": Format((".mat",), mat.read, mat.write),
}

__all__ = [
    "FORMATS", "Format", "Table", "export", "load_experiment", "load_recording", "load_signal", "read_table",
    "save_experiment", "save_recording", "save_signal",
]  # fmt: skip


def read_table(path: str | os.PathLike) -> Table:
    """Return the columns of a file of any known format, before roles are chosen."""
    return _by_extension(path).read(Path(path))


def load_experiment(
    path: str | os.PathLike,
    inputs: Columns | None = None,
    outputs: Columns | None = None,
    reference: Columns | None = None,
    dt: float | None = None,
    time: str | int | None = None,
    setting: str | None = None,
) -> Experiment:
    """Return the experiment in a data file.

    Own files need nothing but the path; a recording gives its default view, or the `setting` named. Elsewhere `inputs`,
    `outputs` and `reference` choose columns by name or by number from 0; without them, headers such as ``u:flap``, u,
    u1, y2 and r count. `dt` in s, or `time`, the time column in s (one called time_s, t_s, time or t is found). NaN and
    empty fields are missing samples. Chosen roles keep the period and the loop that an own file states.

    Raises ExciteError naming the file, the place in it, and the remedy.
    """
    table = read_table(path)
    flags = (inputs, outputs, reference, dt, time)
    if table.meta.get("kind") == "recording" and all(flag is None for flag in flags):
        recording = to_recording(table)
        with damaged(table.place):
            return recording.experiment(setting)
    if setting is not None:
        raise ExciteError(f"{path}: setting '{setting}' needs a recording, without roles or dt given; drop it")
    u, y, r = choose(table, "u", inputs), choose(table, "y", outputs), choose(table, "r", reference)
    require(table, u, y)
    time_s, dt = sampling(table, dt, time, u + y + r)
    with damaged(table.place):
        return Experiment(
            table.values[:, u], table.values[:, y], dt=dt, time_s=time_s,
            reference=table.values[:, r] if r else None, inputs=channels(table, u), outputs=channels(table, y),
            references=channels(table, r) if r else None, period=table.meta.get("period"),
            loop=to_loop(table.meta.get("loop")), name=table.meta.get("name") or Path(path).stem,
        )  # fmt: skip


def load_signal(
    path: str | os.PathLike, inputs: Columns | None = None, dt: float | None = None, time: str | int | None = None
) -> Signal:
    """Return the signal in a data file: its input columns, chosen as in `load_experiment`.

    Recipe and period come back from own files (from CSV, while the sidecar belongs to exactly this file).
    """
    table = read_table(path)
    u = choose(table, "u", inputs)
    require(table, u)
    time_s, dt = sampling(table, dt, time, u)
    if dt is None:
        span = f"{time_s[0]:g} to {time_s[-1]:g} s"
        raise ExciteError(f"{path}: its {len(time_s)} times from {span} are not uniform; resample it, or give dt")
    with damaged(table.place):
        recipe = table.meta.get("recipe", {}) if inputs is None else {}
        return Signal(table.values[:, u], dt, channels(table, u), table.meta.get("period"), recipe)


def load_recording(path: str | os.PathLike) -> Recording:
    """Return the recording that `save_recording` wrote."""
    table = read_table(path)
    if table.meta.get("kind") != "recording":
        raise ExciteError(f"{path}: is not a recording of excite; load it as an experiment, with roles")
    return to_recording(table)


def save_signal(signal: Signal, path: str | os.PathLike, certificate: Mapping | None = None) -> None:
    """Write a signal, its recipe and its certificate; the extension chooses the format."""
    _writable(path)(to_table(signal, certificate), Path(path))


def save_experiment(experiment: Experiment, path: str | os.PathLike) -> None:
    """Write an experiment with its roles, units, period and loop; the extension chooses the format."""
    _writable(path)(to_table(experiment), Path(path))


def save_recording(recording: Recording, path: str | os.PathLike) -> None:
    """Write everything a recording holds; the extension chooses the format, .npz the natural one."""
    _writable(path)(to_table(recording), Path(path))


def export(
    data: Signal | Experiment | Recording, fmt: str, path: str | os.PathLike, certificate: Mapping | None = None
) -> None:
    """Write `data` in a named format, whatever the extension of `path`."""
    known = {name for name, given in FORMATS.items() if given.write}
    if fmt not in known:
        raise ExciteError(f"export: format '{fmt}'; {did_you_mean(str(fmt), known)}")
    FORMATS[fmt].write(to_table(data, certificate), Path(path))


def _by_extension(path: str | os.PathLike) -> Format:
    extension = Path(path).suffix.lower()
    known = {e: given for given in FORMATS.values() for e in given.extensions}
    if extension not in known:
        raise ExciteError(f"{path}: extension '{extension}' is not known; known: {', '.join(sorted(known))}")
    return known[extension]


def _writable(path: str | os.PathLike) -> Callable[[Table, Path], None]:
    given = _by_extension(path)
    if given.write is None:
        ways = ", ".join(e for other in FORMATS.values() if other.write for e in other.extensions)
        raise ExciteError(f"{path}: this format is only read; write one of {ways}")
    return given.write
