"""Data files: one table of formats; the extension chooses, `export` may name one."""

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from excite.errors import ExciteError, did_you_mean, placed
from excite.files import autopilot, awg, c_header, crazyflie, hdf5, mat, npz, text, wav
from excite.files.atomic import readable
from excite.files.native import damaged, to_level, to_loop, to_recording, to_table
from excite.files.roles import Columns, channels, choose, marked, require, sampling
from excite.files.table import Table
from excite.persistency.certificate import certify
from excite.plain import plain
from excite.types.experiment import Experiment
from excite.types.recipe import Recipe
from excite.types.recording import Recording
from excite.types.signal import Signal


@dataclass(frozen=True)
class Format:
    """One file format: its extensions, how it is read and written where it can be, and what it makes of a signal.

    Where formats share an extension, the first in the table answers for it.
    quantise : for formats that play a signal on hardware, the signal that will really be played; the certificate is
    that signal's. one_channel : the file holds a single channel, so that several channels make several files.
    """

    extensions: tuple[str, ...]
    read: Callable[[Path], Table] | None
    write: Callable[[Table, Path], None] | None = None
    quantise: Callable[[Signal], Signal] | None = None
    one_channel: bool = False


FORMATS: dict[str, Format] = {
    "csv": Format((".csv",), text.read, text.write),
    "columns": Format((".dat", ".txt"), text.read),
    "npz": Format((".npz",), npz.read, npz.write),
    "mat": Format((".mat",), mat.read, mat.write),
    "hdf5": Format((".h5", ".hdf5", ".mat"), hdf5.read, hdf5.write),
    "wav": Format((".wav",), wav.read, wav.write, wav.quantise),
    "c_header": Format((".h",), c_header.read, c_header.write, c_header.quantise),
    "keysight": Format((".arb",), awg.read_arb, awg.write_keysight, awg.quantise_keysight, one_channel=True),
    "rigol": Format((".arb",), awg.RIGOL.read, awg.RIGOL.write, awg.RIGOL.quantise, one_channel=True),
    "rigol_raf": Format((".raf",), awg.RIGOL_RAF.read, awg.RIGOL_RAF.write, awg.RIGOL_RAF.quantise, one_channel=True),
    "siglent": Format((".bin",), awg.SIGLENT.read, awg.SIGLENT.write, awg.SIGLENT.quantise, one_channel=True),
    "crazyflie": Format((".csv",), text.read, crazyflie.write_table, crazyflie.setpoints),
    "crazyflie_player": Format((".py",), None, crazyflie.write_player, crazyflie.setpoints),
    "ardupilot": Format(
        (".parm", ".param"), autopilot.ARDUPILOT.read, autopilot.ARDUPILOT.write, autopilot.ARDUPILOT.quantise
    ),
    "px4": Format((".params",), autopilot.PX4.read, autopilot.PX4.write, autopilot.PX4.quantise),
}

__all__ = [
    "FORMATS",
    "Format",
    "Table",
    "export",
    "load_experiment",
    "load_recording",
    "load_signal",
    "read_table",
    "save_experiment",
    "save_recording",
    "save_signal",
]


def read_table(path: str | os.PathLike) -> Table:
    """Return the columns of a file of any known format, before roles are chosen."""
    given = _by_extension(readable(path))
    if given.read is None:
        raise ExciteError(f"{path}: this format is only written; load the signal it was made from")
    return given.read(Path(path))


def load_experiment(
    path: str | os.PathLike,
    inputs: Columns | None = None,
    outputs: Columns | None = None,
    reference: Columns | None = None,
    dt: float | None = None,
    time: str | int | None = None,
    view: str | None = None,
) -> Experiment:
    """Return the experiment in a data file.

    Own files need nothing but the path; a recording gives its default view, or the `view` named. Elsewhere `inputs`,
    `outputs` and `reference` choose columns by name or by number from 0; without them, headers such as ``u:flap``, u,
    u1, y2 and r count. No inputs, given as an empty list or in an own file without any, leaves outputs alone. `dt` in s,
    or `time`, the time column in s (one called time_s, t_s, time or t is found). NaN and empty fields are missing
    samples. Chosen roles keep the period and the loop that an own file states.

    Raises ExciteError naming the file, the place in it, and the remedy.
    """
    table = read_table(path)
    flags = (inputs, outputs, reference, dt, time)
    if table.meta.get("kind") == "recording" and all(flag is None for flag in flags):
        recording = to_recording(table)
        with damaged(table.place):
            return recording.experiment(view)
    if view is not None:
        raise ExciteError(f"{path}: view '{view}' needs a recording, without roles or dt given; drop it")
    u, y, r = choose(table, "u", inputs), choose(table, "y", outputs), choose(table, "r", reference)
    outputs_alone = not u and (inputs is not None or marked(table, "y"))
    require(table, None if outputs_alone else u, y)
    time_s, dt = sampling(table, dt, time, u + y + r)
    with damaged(table.place):
        return Experiment(
            table.values[:, u],
            table.values[:, y],
            dt=dt,
            time_s=time_s,
            reference=table.values[:, r] if r else None,
            inputs=channels(table, u) if u else None,
            outputs=channels(table, y),
            references=channels(table, r) if r else None,
            period=table.meta.get("period"),
            loop=to_loop(table.meta.get("loop")),
            level=to_level(table.meta.get("level")),
            name=table.meta.get("name") or Path(path).stem,
        )


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
        recipe = table.meta.get("recipe") if inputs is None else None
        recipe = None if recipe is None else Recipe.from_dict(recipe)
        return Signal(table.values[:, u], dt, channels(table, u), table.meta.get("period"), recipe)


def load_recording(path: str | os.PathLike) -> Recording:
    """Return the recording that `save_recording` wrote."""
    table = read_table(path)
    if table.meta.get("kind") != "recording":
        raise ExciteError(f"{path}: is not a recording of excite; load it as an experiment, with roles")
    return to_recording(table)


def save_signal(signal: Signal, path: str | os.PathLike, certificate: Mapping | None = None) -> None:
    """Write a signal, its recipe and its certificate; the extension chooses the format."""
    _write(signal, _writable(path), Path(path), certificate)


def save_experiment(experiment: Experiment, path: str | os.PathLike) -> None:
    """Write an experiment with its roles, units, period and loop; the extension chooses the format."""
    _write(experiment, _writable(path), Path(path))


def save_recording(recording: Recording, path: str | os.PathLike) -> None:
    """Write everything a recording holds; the extension chooses the format, .npz the natural one."""
    _write(recording, _writable(path), Path(path))


def export(
    data: Signal | Experiment | Recording, fmt: str, path: str | os.PathLike, certificate: Mapping | None = None
) -> tuple[Path, ...]:
    """Write `data` in a named format, whatever the extension of `path`; return the files written, sidecars apart.

    A signal's file holds its certificate: the given one, else it is computed here (20 block rows); and always computed
    for formats that play it on hardware, from the quantised samples that will really be played. A format of one channel
    a file writes several channels to several files, called after them: ``out_roll.arb``, ``out_pitch.arb``, each with its
    own certificate and the one of all channels together.
    """
    known = {name for name, given in FORMATS.items() if given.write}
    if fmt not in known:
        raise ExciteError(f"export: format '{fmt}'; {did_you_mean(str(fmt), known)}")
    if isinstance(data, Signal) and certificate is None and FORMATS[fmt].quantise is None:
        certificate = certify(data).to_dict()
    return _write(data, FORMATS[fmt], Path(path), certificate)


def _write(
    data: Signal | Experiment | Recording, given: Format, path: Path, certificate: Mapping | None = None
) -> tuple[Path, ...]:
    """Write one or, where a file holds one channel, several files; return their paths."""
    if given.quantise is None:
        given.write(to_table(data, certificate), path)
        return (path,)
    if not isinstance(data, Signal):
        raise ExciteError(
            f"{path}: this format plays a signal, not {type(data).__name__.lower()}s; load it as a signal first"
        )
    with placed(str(path)):
        played = given.quantise(data)
    block_rows = (certificate or {}).get("block_rows", 20)
    certificate = certify(played, block_rows).to_dict()
    if not given.one_channel or len(played.channels) == 1:
        given.write(to_table(played, certificate), path)
        return (path,)
    paths = _channel_paths(path, played)
    together = {"together": {"files": [file.name for file in paths], "certificate": certificate}}
    for i, file in enumerate(paths):
        part = replace(played, u=played.u[:, [i]], channels=(played.channels[i],))
        table = to_table(part, certify(part, block_rows).to_dict())
        given.write(replace(table, meta=plain(table.meta | together, "meta")), file)
    return paths


def _channel_paths(path: Path, signal: Signal) -> tuple[Path, ...]:
    """Return one path a channel: its name in plain letters behind the stem, or its number where names would collide."""
    names = [re.sub(r"[^A-Za-z0-9]+", "_", channel.name).strip("_")[:40] for channel in signal.channels]
    if len({name.lower() for name in names} - {""}) < len(names):
        names = [str(i + 1) for i in range(len(names))]
    return tuple(path.with_name(f"{path.stem}_{name}{path.suffix}") for name in names)


def _by_extension(path: str | os.PathLike) -> Format:
    extension = Path(path).suffix.lower()
    known = {e: given for given in reversed(FORMATS.values()) for e in given.extensions}
    if extension not in known:
        raise ExciteError(f"{path}: extension '{extension}' is not known; known: {', '.join(sorted(known))}")
    return known[extension]


def _writable(path: str | os.PathLike) -> Format:
    given = _by_extension(path)
    if given.write is None:
        ways = ", ".join(dict.fromkeys(e for other in FORMATS.values() if other.write for e in other.extensions))
        raise ExciteError(f"{path}: this format is only read; write one of {ways}")
    return given
