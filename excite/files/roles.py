"""Which columns of a table are inputs, outputs, reference and time."""

import re
from collections.abc import Sequence

import numpy as np

from excite.arguments import positive, same_dt
from excite.errors import ExciteError, did_you_mean
from excite.files.native import damaged
from excite.files.table import TIME_NAMES, Table
from excite.types.channel import Channel

Columns = Sequence[str | int] | str | int
FLAGS = {"u": "inputs", "y": "outputs", "r": "reference"}
ROLE = re.compile(r"([uyrc]):(.*)")
BARE_ROLE = re.compile(r"([uyr])_?\d*")


def column(table: Table, key: str | int, place: str) -> int:
    """Return the column that a name (whole header, without its role, or without its unit) or a number from 0 means."""
    if isinstance(key, str):
        for forms in zip(*map(_forms, table.names), strict=True):
            found = [i for i, form in enumerate(forms) if form == key.strip() != ""]
            if len(found) > 1:
                raise ExciteError(f"{table.place}: {place}: several columns are called '{key}'; {table.listing()}")
            if found:
                return found[0]
        if not key.strip().isdecimal():
            known = [form for name in table.names if name for form in _forms(name)]
            remedy = did_you_mean(key, known) if known else "use numbers"
            raise ExciteError(f"{table.place}: {place}: no column '{key}'; {remedy}; {table.listing()}")
    if isinstance(key, bool) or not isinstance(key, (str, int, np.integer)) or not 0 <= int(key) < len(table.names):
        raise ExciteError(f"{table.place}: {place}: no column {key!r}; {table.listing()}")
    return int(key)


def choose(table: Table, role: str, given: Columns | None) -> list[int]:
    """Return the columns of one role: those given, else those whose header carries it (``u:flap``, ``u``, ``u2``)."""
    if given is None:
        return marked(table, role) or [i for i, name in enumerate(table.names) if _bare_role(name) == role]
    keys = [given] if isinstance(given, (str, int)) else list(given)
    chosen = [column(table, key, FLAGS[role]) for key in keys]
    if len({*chosen}) != len(chosen):
        raise ExciteError(f"{table.place}: {FLAGS[role]}: {keys} name a column twice; name each once")
    return chosen


def marked(table: Table, role: str) -> list[int]:
    """Return the columns whose header states the role, as excite writes them (``y:acceleration [m/s2]``)."""
    return [i for i, name in enumerate(table.names) if (match := ROLE.fullmatch(name)) and match[1] == role]


def require(table: Table, inputs: list[int] | None, outputs: list[int] | None = None) -> None:
    """Refuse roles without a column, and a column in both roles; None is a role that is not asked for."""
    missing = [role for role, chosen in (("inputs", inputs), ("outputs", outputs)) if chosen == []]
    if missing:
        flags = " and ".join(f"{role} (--{role})" for role in missing)
        alone = (
            ", or none as inputs where outputs alone were recorded"
            if missing == ["inputs"] and outputs is not None
            else ""
        )
        raise ExciteError(f"{table.place}: give {flags} by name or number from 0{alone}; {table.listing()}")
    shared = {*(inputs or [])} & {*(outputs or [])}
    if shared:
        raise ExciteError(f"{table.place}: column {min(shared)} is both input and output; {table.listing()}")


def channels(table: Table, columns: list[int]) -> list[Channel] | None:
    """Return the channels of some columns; None, for default names, where the file has no names at all."""
    if not any(table.names[i] for i in columns):
        return None
    return [_channel(table.names[i], i) for i in columns]


def sampling(
    table: Table, dt: float | None, time: str | int | None, used: list[int]
) -> tuple[np.ndarray | None, float | None]:
    """Return (time_s, dt) from a given dt, the file's own dt, and a time column, given or called one of `TIME_NAMES`.

    A time column is uniform when no sample is more than a thousandth of a step off the straight line; dt is None when
    it is not. A dt beside a time column must agree: a mean step within 0.1 %, no sample half a step off.
    """
    own = table.meta.get("dt")
    if own is not None:
        with damaged(table.place):
            own = positive(float(own), "dt")
    if dt is not None:
        dt = positive(dt, f"{table.place}: dt")
        if own is not None and not same_dt(dt, own):
            raise ExciteError(f"{table.place}: dt = {dt:g} s is given, but the file says {own:g} s; drop your dt")
    stated = own if dt is None else dt
    index = _time_column(table, time, used)
    if index is None:
        if stated is None:
            raise ExciteError(f"{table.place}: give dt in s (--dt) or the time column (--time); {table.listing()}")
        return None, stated
    times = table.values[:, index]
    if np.isnan(times).any():
        row = int(np.argmax(np.isnan(times)))
        raise ExciteError(f"{table.place}: column {index}: the time of sample {row} is missing; fill it in")
    if stated is None:
        return times, uniform_step(times)
    if dt is not None and len(times) > 1:
        step = (times[-1] - times[0]) / (len(times) - 1)
        off = np.abs(times - times[0] - dt * np.arange(len(times))).max() / dt
        if abs(step - dt) > 1e-3 * dt or off >= 0.5:
            raise ExciteError(
                f"{table.place}: dt = {dt:g} s is given, but column {index} steps by {step:.9g} s on average, up to "
                f"{off:.3g} steps off a grid of dt; drop one of the two"
            )
    return times, stated


def uniform_step(times: np.ndarray) -> float | None:
    """Return the step of uniform times (N,), s, or None; the simplest number that fits them."""
    if len(times) < 2:
        return None
    step = (times[-1] - times[0]) / (len(times) - 1)
    grid = np.arange(len(times))
    if not step > 0 or np.abs(times - times[0] - step * grid).max() > 1e-3 * step:
        return None
    rounding = 4 * np.finfo(float).eps * np.abs(times).max()
    for simple in (times[1] - times[0], float(f"{step:.12g}")):
        if np.abs(times - times[0] - simple * grid).max() <= rounding:
            return float(simple)
    return float(step)


def _time_column(table: Table, time: str | int | None, used: list[int]) -> int | None:
    if time is None:
        named = {_channel(name, i).name: i for i, name in enumerate(table.names) if _seconds(name)}
        return next((named[name] for name in TIME_NAMES if name in named and named[name] not in used), None)
    index = column(table, time, "time")
    if index in used:
        raise ExciteError(f"{table.place}: time: column {index} has another role too; {table.listing()}")
    if not _seconds(table.names[index]):
        raise ExciteError(f"{table.place}: time: column '{table.names[index]}' is not in seconds; convert it")
    return index


def _channel(name: str, number: int = 0) -> Channel:
    """Return the channel a header means, any text included."""
    bare = _without_role(name)
    return Channel.parse(bare) if bare and not bare.startswith("[") else Channel(bare or f"column {number}")


def _bare_role(name: str) -> str | None:
    match = BARE_ROLE.fullmatch(_channel(name).name)
    return match and match[1]


def _seconds(name: str) -> bool:
    return _channel(name).unit in ("", "s")


def _without_role(name: str) -> str:
    match = ROLE.fullmatch(name)
    return match[2].strip() if match else name.strip()


def _forms(name: str) -> tuple[str, str, str]:
    return name.strip(), _without_role(name), _channel(name).name if name else ""
