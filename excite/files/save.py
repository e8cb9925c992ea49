"""Writing data files: signals, experiments and recordings, in the format that the extension or the caller names."""

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from excite.errors import ExciteError, did_you_mean, placed
from excite.files.formats import FORMATS, Format, writable
from excite.files.native import to_table
from excite.persistency.certificate import certify
from excite.plain import plain
from excite.types.experiment import Experiment
from excite.types.recording import Recording
from excite.types.signal import Signal


def save_signal(signal: Signal, path: str | os.PathLike, certificate: Mapping | None = None) -> None:
    """Write a signal, its recipe and its certificate; the extension chooses the format."""
    _write(signal, writable(path), Path(path), certificate)


def save_experiment(experiment: Experiment, path: str | os.PathLike) -> None:
    """Write an experiment with its roles, units, period and loop; the extension chooses the format."""
    _write(experiment, writable(path), Path(path))


def save_recording(recording: Recording, path: str | os.PathLike) -> None:
    """Write everything a recording holds; the extension chooses the format, .npz the natural one."""
    _write(recording, writable(path), Path(path))


def export(
    data: Signal | Experiment | Recording, fmt: str, path: str | os.PathLike, certificate: Mapping | None = None
) -> tuple[Path, ...]:
    """Write `data` in a named format, whatever the extension of `path`; return the files written, sidecars apart.

    A signal's file holds its certificate: the given one, else it is computed here (20 block rows); and always computed
    for formats that play it on hardware, from the quantised samples that will really be played. A format of one channel
    per file writes several channels to several files, called after them: ``out_roll.arb``, ``out_pitch.arb``, each with
    its own certificate and the one of all channels together.
    """
    if fmt not in FORMATS or FORMATS[fmt].write is None:
        known = [name for name in FORMATS if FORMATS[name].write]
        raise ExciteError(f"export: format '{fmt}'; {did_you_mean(str(fmt), known)}")
    if isinstance(data, Signal) and certificate is None and FORMATS[fmt].quantise is None:
        certificate = certify(data).to_dict()
    return _write(data, FORMATS[fmt], Path(path), certificate)


def _write(
    data: Signal | Experiment | Recording, given: Format, path: Path, certificate: Mapping | None = None
) -> tuple[Path, ...]:
    """Write one or, where a file holds one channel, several files; return their paths."""
    assert given.write is not None  # `export` has refused formats that are only read
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
        given.write(replace(table, meta=plain({**table.meta, **together}, "meta")), file)
    return paths


def _channel_paths(path: Path, signal: Signal) -> tuple[Path, ...]:
    """Return one path per channel: its name in plain letters behind the stem, or its number where names would collide."""
    names = [re.sub(r"[^A-Za-z0-9]+", "_", channel.name).strip("_")[:40] for channel in signal.channels]
    if len({name.lower() for name in names} - {""}) < len(names):
        names = [str(i + 1) for i in range(len(names))]
    return tuple(path.with_name(f"{path.stem}_{name}{path.suffix}") for name in names)
