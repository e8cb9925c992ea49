"""NumPy archives: files of excite bit for bit, others as named arrays. Never pickled objects."""

import json
import zipfile
import zlib
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import MAX_BYTES, readable, written
from excite.files.formats import Format
from excite.files.table import Table, from_arrays

GROUPS = {"u": "u", "y": "y", "r": "r", "c": "other"}


def write(table: Table, path: Path) -> None:
    """Write time_s, u, y, r, other (N, columns), dt when uniform, and the JSON texts `columns` and `meta`."""
    arrays = {variable: table.group(role) for role, variable in GROUPS.items()}
    arrays = {variable: values for variable, values in arrays.items() if values.size}
    if table.meta.get("dt") is not None:
        arrays["dt"] = np.array(table.meta["dt"], np.float64)
    with written(path) as temporary, open(temporary, "wb") as stream:
        np.savez(
            stream,
            allow_pickle=False,
            time_s=table.values[:, 0],
            **arrays,
            columns=np.array(json.dumps(table.names)),
            meta=np.array(json.dumps(dict(table.meta), allow_nan=False)),
        )


def read(path: Path) -> Table:
    """Return the table in an .npz file: one of excite exactly, another.s arrays by name."""
    try:
        if not zipfile.is_zipfile(readable(path)):
            raise ExciteError(f"{path}: is not an .npz archive; write it with numpy.savez")
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > MAX_BYTES:
            raise ExciteError(f"{path}: unpacks to {size} bytes, more than the limit of {MAX_BYTES}; split the file")
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        hint = "; object arrays are never loaded, save plain numeric arrays" if "allow_pickle" in str(error) else ""
        raise ExciteError(f"{path}: cannot be read as .npz ({error}){hint or '; write it again'}") from error
    arrays = {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}
    own = {"columns", "meta", "time_s"} <= arrays.keys()
    return restored(arrays, str(path)) if own else from_arrays(arrays, str(path))


def restored(arrays: dict[str, np.ndarray], place: str) -> Table:
    """Return the table that `write` took apart here or in mat, where `u` may have the time before its own columns."""
    try:
        names, meta = (json.loads(arrays[key].item()) for key in ("columns", "meta"))
        roles = [name.partition(":")[0] for name in names]
        last = {role: iter(arrays[GROUPS[role]].T[-roles.count(role) :]) for role in {*roles} - {"time_s"}}
        columns = [arrays["time_s"].ravel() if role == "time_s" else next(last[role]) for role in roles]
        values = np.column_stack(columns).astype(np.float64, casting="same_kind")
        return Table(tuple(names), values, place, dict(meta))
    except (TypeError, ValueError, KeyError, AttributeError, StopIteration, RecursionError) as error:
        raise ExciteError(f"{place}: its column list does not fit its arrays ({error}); write it again") from error


NPZ = Format("NumPy archive, the natural form of a recording: everything, bit for bit", (".npz",), read, write)
