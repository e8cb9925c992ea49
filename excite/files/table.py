"""Table: what every data file is read into and written from, before any role is chosen."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from excite.errors import ExciteError
from excite.types.channel import Channel

TIME_NAMES = ("time_s", "t_s", "time", "t")
STEP_NAMES = ("dt", "Ts")
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


@dataclass(frozen=True, eq=False)
class Table:
    """Columns side by side, as one file holds them.

    names : c column headers, "" where the file has none; excite writes ``time_s`` and ``u:flap [deg]``, the role
    before the colon (u input, y output, r reference, c any other channel); values : (N, c) float64, NaN = missing;
    place : the file, for messages; meta : what else the file says (dt, period, recipe, …); skipped : variables that are
    no columns, and why.
    """

    names: tuple[str, ...]
    values: np.ndarray
    place: str = "table"
    meta: Mapping = field(default_factory=dict)
    skipped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(CONTROL.sub(" ", name) for name in self.names))

    def listing(self) -> str:
        """Return the columns and what was skipped, for messages."""
        columns = ", ".join(f"{i} '{name}'" if name else str(i) for i, name in enumerate(self.names))
        return f"columns: {columns}" + (f"; not columns: {', '.join(self.skipped)}" if self.skipped else "")

    def group(self, role: str) -> np.ndarray:
        """Return the columns with one role prefix, (N, k)."""
        return self.values[:, [name.startswith(f"{role}:") for name in self.names]]


def header(role: str, channel: Channel) -> str:
    """Return the column header ``role:name [unit]``, which `Channel.parse` reads back exactly.

    The role comes first, so that no header begins with a character that spreadsheets take for a formula.
    """
    for text in (str(channel), f"{channel.name} [{channel.unit}]"):
        with suppress(ExciteError):
            if not CONTROL.search(text) and Channel.parse(text) == channel:
                return f"{role}:{text}"
    raise ExciteError(f"channel {text!r}: this mix of brackets or control characters cannot be written; rename it")


def from_arrays(arrays: Mapping[str, np.ndarray], place: str, skipped: tuple[str, ...] = ()) -> Table:
    """Return the table that named arrays of a foreign file make.

    Real 1-D and 2-D arrays with one common length become columns called after the variable (`u`, or `u_1`, `u_2`, …);
    samples run along the longer side of `time`, `u` or `y`, else of the largest array. A scalar `dt` or `Ts` is the
    sampling time in seconds.
    """
    real = {}
    for name, array in arrays.items():
        if array.dtype.kind in "fiub" and array.ndim <= 2:
            real[name] = array
        else:
            skipped += (f"{name} ({array.dtype}, shape {array.shape})",)
    steps = [float(real.pop(name).item()) for name in STEP_NAMES if name in real and real[name].size == 1]
    leading = [name for name in (*TIME_NAMES, "u", "y") if name in real and real[name].size > 1][:1] or list(real)
    count = max((max(real[name].shape, default=1) for name in leading), default=0)
    names, columns = [], []
    for name, array in real.items():
        array = array[:, None] if array.ndim == 1 else np.atleast_2d(array)
        if len(array) != count and array.shape[1] == count:
            array = array.T
        if len(array) != count or array.size == 0:
            skipped += (f"{name} (shape {array.shape})",)
            continue
        width = array.shape[1]
        names += [name] if width == 1 else [f"{name}_{i + 1}" for i in range(width)]
        columns.append(array.astype(np.float64))
    if not columns:
        raise ExciteError(
            f"{place}: no real numeric array with samples; save u, y and dt (or time_s) as plain arrays"
            + (f"; found {', '.join(skipped)}" if skipped else "")
        )
    return Table(tuple(names), np.hstack(columns), place, {"dt": steps[0]} if steps else {}, skipped)
