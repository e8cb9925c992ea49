"""Crazyflie: a table of set-points {roll, pitch, yaw rate, thrust}, and a script that plays it with cflib.

Commander.send_setpoint of cflib 0.1.34 takes roll and pitch in deg, yaw rate in deg/s (float32 on the wire) and a whole
thrust, documented from 10001 to 60000. The firmware levels after 500 ms without a set-point and shuts down after 2 s, so
set-points are sent at 50 to 100 Hz (Bitcraze, "Commander framework").
"""

import hashlib
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

import excite.files.crazyflie_player as player
from excite.errors import ExciteError
from excite.files.atomic import written
from excite.files.formats import Format
from excite.files.table import Table
from excite.files.text import read as read_csv
from excite.files.text import write as write_csv
from excite.types.channel import Channel
from excite.types.signal import Signal

AXES = {"roll": "deg", "pitch": "deg", "yawrate": "deg/s", "thrust": "", "thrust_offset": ""}
KNOWN = (
    "roll [deg], pitch [deg], yawrate [deg/s], and thrust (10001 to 60000) or thrust_offset (about the hover thrust)"
)
PLAN = re.compile(r"# --- plan.*?\n.*?# --- end of plan\n", re.DOTALL)


def setpoints(signal: Signal) -> Signal:
    """Return the set-points really sent: float32 angles, whole thrust, held samples at 50 to 100 Hz, within the caps.

    A sample longer than 20 ms is sent several times; a sampling finer than 10 ms is only taken where whole blocks of
    10 to 20 ms hold their value. Nothing is interpolated, nothing is clipped.
    """
    names = [_axis(channel) for channel in signal.channels]
    if len({*names}) < len(names) or {"thrust", "thrust_offset"} <= {*names}:
        raise ExciteError(f"channels {', '.join(names)} name an axis twice; a Crazyflie takes {KNOWN}")
    if signal.duration_s > player.MOST_SECONDS:
        raise ExciteError(f"{signal.duration_s:g} s, but a flight plays at most {player.MOST_SECONDS:g} s; export less")
    u = np.array(signal.u)
    for column, name in enumerate(names):
        low, high = u[:, column].min(), u[:, column].max()
        most = player.MOST.get(name, player.MOST_THRUST)
        least = {"thrust": player.LEAST_THRUST}.get(name, -most)
        if low < least or high > most:
            raise ExciteError(f"channel {name}: {low:g} to {high:g}, but the Crazyflie's cap is {least:g} to {most:g}")
        u[:, column] = np.rint(u[:, column]) if name.startswith("thrust") else u[:, column].astype(np.float32)
    return _at_send_rate(replace(signal, u=u, channels=tuple(Channel(name, AXES[name]) for name in names)))


def write_table(table: Table, path: Path) -> None:
    """Write CSV with time_s, roll, pitch, yawrate and thrust, and its sidecar; axes the signal leaves out are zero."""
    axes = _axes(table)
    if "thrust" not in axes:
        raise ExciteError(
            f"{path}: the table needs an absolute thrust; add a channel thrust ({player.LEAST_THRUST} to "
            f"{player.MOST_THRUST}), or export crazyflie_player, which takes the hover thrust when it is run"
        )
    names = ["time_s"]
    for axis in ("roll", "pitch", "yawrate", "thrust"):
        names.append(f"{'u' if axis in axes else 'c'}:{Channel(axis, AXES[axis])}")
    write_csv(replace(table, names=tuple(names), values=np.column_stack([table.values[:, 0], _rows(axes)])), path)


def write_player(table: Table, path: Path) -> None:
    """Write the self-contained player script with the set-points inside; see `crazyflie_player` for what it does."""
    axes = _axes(table)
    rows = _rows(axes)
    lines = [f"    [{r!r}, {p!r}, {y!r}, {round(t)}],\n" for r, p, y, t in rows.tolist()]
    plan = {
        "name": path.stem,
        "sha256": hashlib.sha256(rows.tobytes()).hexdigest(),
        "dt_s": table.meta["dt"],
        "thrust": "absolute" if "thrust" in axes else "offset",
    }
    head = ", ".join(f"{key!r}: {value!a}" for key, value in plan.items())
    block = "# --- plan\nPLAN = {" + head + ", 'rows': [\n" + "".join(lines) + "]}\n# --- end of plan\n"
    source = Path(player.__file__).read_text(encoding="utf-8")
    with written(path) as temporary:
        temporary.write_text(PLAN.sub(lambda _: block, source, count=1), encoding="utf-8", newline="\n")


def _axis(channel: Channel) -> str:
    name = re.sub(r"[ _-]", "", channel.name.lower())
    axis = {axis.replace("_", ""): axis for axis in AXES}.get(name)
    if axis is None or channel.unit not in (AXES[axis], ""):
        raise ExciteError(f"channel '{channel}' is no set-point of a Crazyflie; it takes {KNOWN}")
    return axis


def _axes(table: Table) -> dict[str, np.ndarray]:
    """Return the samples (N,) of each axis in a table of set-points."""
    return {Channel.parse(name[2:]).name: table.values[:, i] for i, name in enumerate(table.names) if name[:2] == "u:"}


def _rows(axes: dict[str, np.ndarray]) -> np.ndarray:
    """Return (N, 4) roll, pitch, yaw rate, thrust; zeros where an axis is not given."""
    zero = np.zeros(len(next(iter(axes.values()))))
    thrust = axes.get("thrust", axes.get("thrust_offset", zero))
    return np.column_stack([*(axes.get(axis, zero) for axis in ("roll", "pitch", "yawrate")), thrust])


def _at_send_rate(signal: Signal) -> Signal:
    low, high = player.LEAST_DT_S, player.MOST_DT_S
    if signal.dt > high * (1 + 1e-9):
        return signal.sampled(signal.dt / math.ceil(signal.dt / high - 1e-9))
    if signal.dt >= low * (1 - 1e-9):
        return signal
    for block in range(math.floor(high / signal.dt + 1e-9), math.ceil(low / signal.dt - 1e-9) - 1, -1):
        if len(signal.u) % block == 0:
            blocks = signal.u.reshape(-1, block, signal.u.shape[1])
            if (blocks == blocks[:, :1]).all():
                return signal.sampled(signal.dt * block)
    raise ExciteError(
        f"dt = {signal.dt:g} s is finer than the {low:g} s of the radio, and no whole blocks of {low:g} to {high:g} s hold "
        "their value; design the signal with a dt of 0.01 to 0.02 s, or held that long"
    )


WANTS = {
    "channels": KNOWN,
    "units": "as the channels say, or none",
    "samples": f"at most {player.MOST_SECONDS:g} s; dt of {player.LEAST_DT_S:g} to {player.MOST_DT_S:g} s, longer, or a "
    "finer one held that long; roll and pitch within "
    f"{player.MOST['roll']:g} deg, yaw rate within {player.MOST['yawrate']:g} deg/s",
}
TABLE = Format(
    "set-points of a Crazyflie, CSV that any client plays; needs an absolute thrust",
    (".csv",),
    read_csv,
    write_table,
    setpoints,
    wants=WANTS,
)
PLAYER = Format(
    "script that plays set-points on a Crazyflie by cflib, with caps, arming and a way down",
    (".py",),
    None,
    write_player,
    setpoints,
    wants=WANTS,
)
