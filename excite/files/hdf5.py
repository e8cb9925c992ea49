"""HDF5 in the form of MATLAB's version 7.3: read by MATLAB's load and h5read, and back here bit for bit.

A 7.3 file is HDF5 behind a 512-byte user block that holds the MAT header (MATLAB, "MAT-File Format", Level 5 header:
116 bytes of text, 8 of subsystem offset, version 0x0200, endian mark "IM"). Its arrays are stored transposed, because
MATLAB's first index runs fastest, each with the attribute MATLAB_class; text is uint16 with MATLAB_int_decode = 2.
A checksum (Fletcher's, a filter of HDF5 itself) finds damaged samples.

Only plain numeric data sets of the root group are ever read: no external or soft links, no external or virtual storage,
no references, no compound or variable-length types.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import MAX_BYTES, readable, written
from excite.files.formats import Format
from excite.files.npz import GROUPS, restored
from excite.files.table import Table, from_arrays

if TYPE_CHECKING:
    import h5py

USER_BLOCK = 512
MAT_HEADER = b"MATLAB 7.3 MAT-file, written by excite, HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM"
OWN = ("columns", "meta")


def write(table: Table, path: Path) -> None:
    """Write time_s, dt, names and the arrays u, y, r, other (N, columns), with the JSON texts `columns` and `meta`.

    In a signal's file the first column of `u` is the time, the array form of Simulink's From Workspace block.
    """
    import h5py  # here, because only those who open such a file need it

    time = table.values[:, :1]
    arrays = {variable: table.group(role) for role, variable in GROUPS.items()}
    if table.meta.get("kind") == "signal":
        arrays["u"] = np.hstack([time, arrays["u"]])
    arrays["time_s"] = time
    if table.meta.get("dt") is not None:
        arrays["dt"] = np.array([[table.meta["dt"]]])
    width = max(len(_utf16(name)) for name in table.names)
    texts = {
        "names": np.stack(
            [np.pad(_utf16(name), (0, width - len(_utf16(name))), constant_values=32) for name in table.names]
        ),
        "columns": _utf16(json.dumps(table.names))[None],
        "meta": _utf16(json.dumps(dict(table.meta), allow_nan=False))[None],
    }
    with written(path) as temporary:
        with h5py.File(temporary, "w", userblock_size=USER_BLOCK) as file:
            for name, array in arrays.items():
                if array.size:
                    data = file.create_dataset(name, data=array.T, fletcher32=True)
                    data.attrs["MATLAB_class"] = np.bytes_(b"double")
            for name, text in texts.items():
                attributes = file.create_dataset(name, data=text.T, fletcher32=True).attrs
                attributes["MATLAB_class"], attributes["MATLAB_int_decode"] = np.bytes_(b"char"), np.int32(2)
        with open(temporary, "rb+") as stream:
            stream.write(MAT_HEADER)


def read(path: Path) -> Table:
    """Return the table in an HDF5 or MAT 7.3 file: one of excite exactly, another.s numeric arrays by name."""
    import h5py

    try:
        with h5py.File(readable(path), "r") as file:
            found = {name: _plain(file, name) for name in file}
            skipped = tuple(f"{name} ({given})" for name, given in found.items() if isinstance(given, str))
            kept = {name: given for name, given in found.items() if not isinstance(given, str)}
            size = sum(8 * given.size for given in kept.values())
            if size > MAX_BYTES:
                raise ExciteError(f"{path}: its arrays take {size} bytes, more than {MAX_BYTES}; split the file")
            arrays = {name: _array(given, name in OWN) for name, given in kept.items()}
    except ExciteError:
        raise
    except Exception as error:  # the parser of this binary format raises almost anything on damaged bytes
        raise ExciteError(f"{path}: cannot be read as HDF5 ({error}); write it again") from error
    if {*OWN, "time_s"} <= arrays.keys():
        return restored(arrays, str(path))
    return from_arrays(arrays, str(path), skipped)


def _plain(file: "h5py.File", name: str) -> "h5py.Dataset | str":
    """Return the data set of a name when it is plain numbers within this file, else why it is not."""
    import h5py

    link = file.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        return type(link).__name__
    given = file[name]
    if not isinstance(given, h5py.Dataset):
        return "group"
    if given.shape is None or given.attrs.get("MATLAB_empty", 0):
        return "empty"
    if given.is_virtual or given.external:
        return "stored outside the file"
    kind = _matlab_class(given)
    if given.dtype.kind not in "fiub" or (kind == "char" and name not in OWN) or kind in ("cell", "function_handle"):
        return kind or str(given.dtype)
    return given


def _array(given: "h5py.Dataset", text: bool) -> np.ndarray:
    array = given[()]
    kind = _matlab_class(given)
    if kind:
        array = array.T
    if text and kind == "char":
        return np.array(array.astype("<u2").tobytes().decode("utf-16-le"))
    return array


def _matlab_class(given: "h5py.Dataset") -> str:
    kind = given.attrs.get("MATLAB_class", b"")
    return kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)


def _utf16(text: str) -> np.ndarray:
    return np.frombuffer(text.encode("utf-16-le"), "<u2")


HDF5 = Format("HDF5, in the form of MATLAB's version 7.3: large records", (".h5", ".hdf5", ".mat"), read, write)
