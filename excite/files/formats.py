"""The table of file formats: one line per format, and plug-ins of installed packages beside them."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.errors import ExciteError, did_you_mean
from excite.files.table import Table
from excite.registry import Registry
from excite.types.frozen import Frozen
from excite.types.signal import Signal

WANTS = ("channels", "units", "samples", "recipe")


@dataclass(frozen=True)
class Format:
    """One file format: its extensions, how it is read and written where it can be, and what it makes of a signal.

    A plug-in is one such object, under an entry point of the group ``excite.formats``.

    Parameters
    ----------
    summary : what it is, on one line.
    extensions : with their point, in lower case, the usual one first. Where formats share an extension, the first in the
        table answers for it, and plug-ins come last.
    read : path -> Table, None for a format that is only written.
    write : writes a Table to a path, None for a format that is only read.
    quantise : for formats that play a signal on hardware: signal -> the signal that will really be played, or
        ExciteError for one that the hardware cannot play. The certificate in the file is that of the result.
    one_channel : the file holds a single channel, so that several channels make several files.
    wants : in words, what a signal must be: its "channels", "units", "samples" (dt, length, range) and "recipe" (values
        of the generator). What is not named is free.
    """

    summary: str
    extensions: tuple[str, ...]
    read: Callable[[Path], Table] | None = None
    write: Callable[[Table, Path], None] | None = None
    quantise: Callable[[Signal], Signal] | None = None
    one_channel: bool = False
    wants: Mapping[str, str] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        object.__setattr__(self, "wants", Frozen(self.wants))
        if not self.extensions or any(e != Path(f"f{e}").suffix.lower() or len(e) < 2 for e in self.extensions):
            raise ExciteError(f"Format.extensions: {self.extensions!r}; give them as ('.csv',), in lower case")
        if self.read is None and self.write is None:
            raise ExciteError("Format: neither read nor write; give one of the two")
        for key in self.wants:
            if key not in WANTS:
                raise ExciteError(f"Format.wants: '{key}'; {did_you_mean(key, WANTS)}")


def _refused(entry: Any) -> str | None:
    """Return why a plug-in's object cannot be a format, or None."""
    if isinstance(entry, Format):
        return None
    return f"is a {type(entry).__name__}; an entry point of excite.formats names an excite.files.formats.Format"


# One line adds a format: name -> "module:attribute". The order says who answers for a shared extension.
FORMATS: Registry[Format] = Registry(
    "format",
    {
        "csv": "excite.files.text:CSV",
        "columns": "excite.files.text:COLUMNS",
        "npz": "excite.files.npz:NPZ",
        "mat": "excite.files.mat:MAT",
        "hdf5": "excite.files.hdf5:HDF5",
        "wav": "excite.files.wav:WAV",
        "c_header": "excite.files.c_header:C_HEADER",
        "keysight": "excite.files.awg:KEYSIGHT_FILE",
        "rigol": "excite.files.awg:RIGOL_FILE",
        "rigol_raf": "excite.files.awg:RAF_FILE",
        "siglent": "excite.files.awg:SIGLENT_FILE",
        "crazyflie": "excite.files.crazyflie:TABLE",
        "crazyflie_player": "excite.files.crazyflie:PLAYER",
        "ardupilot": "excite.files.autopilot:ARDUPILOT_FILE",
        "px4": "excite.files.autopilot:PX4_FILE",
    },
    accepts=_refused,
)


def describe_format(name: str) -> dict[str, Any]:
    """Return a description of a format in plain values.

    Keys: summary; extensions; reads, writes, plays (on hardware, so that the signal is quantised), one_channel (per file):
    true or false; wants: what a signal must be, in words; package: name and version of the plug-in it comes from, or None.
    """
    given, package = FORMATS[name], FORMATS.distribution(name)
    return {
        "summary": given.summary,
        "extensions": list(given.extensions),
        "reads": given.read is not None,
        "writes": given.write is not None,
        "plays": given.quantise is not None,
        "one_channel": given.one_channel,
        "wants": dict(given.wants),
        "package": None if package is None else " ".join(package),
    }


def named(extension: str) -> list[str]:
    """Return the names of the formats with an extension, the one that answers for it first."""
    return [name for name, given in _in_order() if extension in given.extensions]


def by_extension(path: str | os.PathLike) -> Format:
    """Return the format that a file's extension means."""
    extension = Path(path).suffix.lower()
    for _, given in _in_order():
        if extension in given.extensions:
            return given
    known = sorted({e for _, given in _in_order() for e in given.extensions})
    raise ExciteError(f"{path}: extension '{extension}' is not known; known: {', '.join(known)}")


def writable(path: str | os.PathLike) -> Format:
    """Return the format that a file's extension means, where it can be written."""
    given = by_extension(path)
    if given.write is None:
        ways = ", ".join(dict.fromkeys(e for _, other in _in_order() if other.write for e in other.extensions))
        extension = Path(path).suffix.lower()
        raise ExciteError(f"{path}: extension '{extension}': this format is only read; write one of {ways}")
    return given


def _in_order() -> Iterator[tuple[str, Format]]:
    """Yield name and format, loading one after the other: ours in the order of the table, then plug-ins by name."""
    for name in FORMATS.ours:
        yield name, FORMATS[name]
    for name in FORMATS:
        if name not in FORMATS.ours:
            yield name, FORMATS[name]
