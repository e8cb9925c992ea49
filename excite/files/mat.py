"""MATLAB files, written in version 5: plain numeric arrays only, never objects."""

import json
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import MAX_BYTES, readable, written
from excite.files.formats import Format
from excite.files.hdf5 import read as read_hdf5
from excite.files.npz import GROUPS, restored
from excite.files.table import Table, from_arrays

NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
OWN = ("columns", "meta")


def write(table: Table, path: Path) -> None:
    """Write time_s, dt, names and the arrays u, y, r, other (N, columns), with the JSON texts `columns` and `meta`.

    In a signal's file the first column of `u` is the time, the array form of Simulink's From Workspace block.
    """
    import scipy.io  # here, because only those who open such a file need it

    time = table.values[:, :1]
    arrays = {variable: table.group(role) for role, variable in GROUPS.items()}
    arrays = {variable: values for variable, values in arrays.items() if values.size}
    if table.meta.get("kind") == "signal":
        arrays["u"] = np.hstack([time, table.group("u")])
    if table.meta.get("dt") is not None:
        arrays["dt"] = np.array([[table.meta["dt"]]])
    held: dict[str, object] = {
        **arrays,
        "time_s": time,
        "names": np.array(table.names, dtype=object)[:, None],
        "columns": json.dumps(table.names),
        "meta": json.dumps(dict(table.meta), allow_nan=False),
    }
    with written(path) as temporary, open(temporary, "wb") as stream:
        try:
            scipy.io.savemat(stream, held, do_compression=True)
        except scipy.io.matlab.MatWriteError as error:
            raise ExciteError(f"{path}: too large for MAT version 5 ({error}); write .npz or .h5") from error


def read(path: Path) -> Table:
    """Return the table in a .mat file of version 4, 5 or 7.3: one of excite exactly, another.s numeric arrays by name."""
    import scipy.io

    try:
        kinds = scipy.io.whosmat(readable(path), appendmat=False)
        wanted = [name for name, _, kind in kinds if kind in NUMERIC or (name in OWN and kind == "char")]
        size = 8 * sum(int(np.prod(shape, dtype=float)) for name, shape, _ in kinds if name in wanted)
        if size > MAX_BYTES:
            raise ExciteError(f"{path}: its arrays take {size} bytes, more than {MAX_BYTES}; split the file")
        loaded = scipy.io.loadmat(path, appendmat=False, variable_names=wanted) if wanted else {}
    except NotImplementedError:  # version 7.3 is HDF5
        return read_hdf5(path)
    except ExciteError:
        raise
    except Exception as error:  # the parser of this binary format raises almost anything on damaged bytes
        raise ExciteError(f"{path}: cannot be read as a MAT file ({error}); save it again with '-v7'") from error
    arrays = {name: loaded[name] for name in wanted if name in loaded}
    if {*OWN, "time_s"} <= arrays.keys():
        return restored(arrays, str(path))
    return from_arrays(arrays, str(path), tuple(f"{name} ({kind})" for name, _, kind in kinds if name not in wanted))


MAT = Format(
    "MATLAB file of version 5 (read up to 7.3); a signal as Simulink's From Workspace takes it", (".mat",), read, write
)
