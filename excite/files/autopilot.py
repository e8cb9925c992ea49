"""Parameter files with which an autopilot plays a sweep of ours by itself: ArduPilot's SystemID mode, PX4's autotune.

The autopilot computes the sweep on board, so only what its formula can make is exported: the file's own waveform must be
the signal, sample by sample. One channel per file, since one flight sweeps one axis.

Sources
-------
ArduPilot : ArduCopter/mode_systemid.cpp (parameters, ranges, SID_AXIS) and AP_Math/chirp.cpp (waveform: logarithmic, two
  cycles at the first frequency, cosine fades, all within SID_T_REC); lines NAME,VALUE as Mission Planner and MAVProxy load.
PX4 : modules/fw_autotune_attitude_control (FW_AT_SYSID_*, ranges) and lib/system_identification/signal_generator.hpp
  (waveform: linear or logarithmic, no dwell, no fades); fixed wings only: the multicopter's autotune plays no sweep. Its
  amplitude is PX4's own (FW_AT_SYSID_AMP, a factor on the rate set-point, in versions that have it), so none is written;
  FW_AT_APPLY = 0 keeps the gains as they are. Lines as QGroundControl loads: vehicle, component, name, value, type.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from excite.arguments import positive
from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import Format
from excite.files.native import damaged
from excite.files.sidecar import read_sidecar, written_with_sidecar
from excite.files.table import Table, header
from excite.types.channel import Channel
from excite.types.recipe import Recipe
from excite.types.signal import Signal

DEFAULT_DT_S = 0.0025  # of a file without a sidecar: 400 Hz, ArduCopter's main loop
TOLERANCE = 0.01  # of the amplitude: parameters are float32, which moves the phase at the end of a long sweep
MOST_SAMPLES = 10**8
SID_AXES = {
    1: Channel("roll", "deg"),
    2: Channel("pitch", "deg"),
    3: Channel("yaw", "deg"),
    7: Channel("roll", "deg/s"),
    8: Channel("pitch", "deg/s"),
    9: Channel("yaw", "deg/s"),
    10: Channel("roll"),
    11: Channel("pitch"),
    12: Channel("yaw"),
    13: Channel("thrust"),
}
FW_AXES = {1: Channel("roll", "deg/s"), 2: Channel("pitch", "deg/s"), 4: Channel("yaw", "deg/s")}
FW_TYPES = {"linear": 1, "log": 2}


@dataclass(frozen=True)
class Autopilot:
    """What one autopilot can play, and how its parameters are called and written.

    axes : number of an axis -> the channel it is; forms and dwell_cycles : the sweeps it knows; ranges : recipe key ->
    parameter with its documented range; extra : fixed parameters; axis : the parameter that chooses the axis.
    """

    name: str
    axes: Mapping[int, Channel]
    forms: tuple[str, ...]
    dwell_cycles: int
    ranges: Mapping[str, tuple[str, float, float]]
    axis: str
    line: Callable[[str, float], str]
    extra: Mapping[str, float]

    def quantise(self, signal: Signal) -> Signal:
        """Return the sweep that the autopilot will play, sampled as the signal is; refuse a signal it cannot play."""
        if len(signal.channels) != 1:
            raise ExciteError(
                f"{len(signal.channels)} channels, but {self.name} sweeps one axis per flight; export one channel"
            )
        try:
            recipe = signal.recipe or Recipe("none")
            parameters = self.parameters(recipe, signal.channels[0], (len(signal.u) - 1) * signal.dt)
            played = self.waveform(parameters, signal.time_s) * recipe["amplitude"][0]
        except (KeyError, TypeError, IndexError, ValueError) as error:
            raise ExciteError(
                f"the recipe of the sweep is incomplete ({type(error).__name__}: {error}); design it again"
            ) from error
        peak = np.abs(signal.u).max()
        if np.abs(played - signal.u[:, 0]).max() > TOLERANCE * peak:
            raise ExciteError(
                "the samples are not those of the recipe's sweep (shaped or cut since?); export the sweep itself"
            )
        return replace(signal, u=played)

    def parameters(self, recipe: Recipe, channel: Channel, end_s: float) -> dict[str, float]:
        """Return the parameters, rounded to float32, of a sweep recipe whose last sample is at `end_s`."""
        form, dwell = recipe.get("form"), recipe.get("dwell_cycles")
        wanted = f"a sweep of form {' or '.join(self.forms)} with dwell_cycles = {self.dwell_cycles} and without offset"
        if recipe.kind != "sweep" or form not in self.forms or dwell != self.dwell_cycles or any(recipe["offset"]):
            given = {"kind": recipe.kind} | {key: recipe.get(key) for key in ("form", "dwell_cycles", "offset")}
            raise ExciteError(f"{self.name} plays {wanted}; the signal's recipe says {given}")
        number = next((n for n, axis in self.axes.items() if _alike(axis, channel)), None)
        if number is None:
            known = ", ".join(map(str, self.axes.values()))
            raise ExciteError(
                f"channel '{channel}' is no axis that {self.name} sweeps; name the channel one of: {known}"
            )
        values = {self.axis: float(number)}
        for key, (name, low, high) in self.ranges.items():
            value = {"duration_s": end_s, "amplitude": recipe["amplitude"][0]}.get(key, recipe[key])
            if not low <= value <= high:
                raise ExciteError(f"{key} = {value:g}, but {name} of {self.name} takes {low:g} to {high:g}")
            values[name] = float(np.float32(value))
        if channel.unit in ("", "1") and recipe["amplitude"][0] > 1:
            raise ExciteError(f"amplitude {recipe['amplitude'][0]:g} of a mixer output; {self.name} takes 0 to 1")
        fades = [recipe[key] for key in ("fade_in_s", "fade_out_s") if key not in self.ranges]
        if any(fades):
            raise ExciteError(f"fades of {fades} s, but {self.name} plays none; design the sweep without")
        return values | dict(self.extra) | ({"FW_AT_SYSID_TYPE": FW_TYPES[form]} if self is PX4 else {})

    def waveform(self, parameters: Mapping[str, float], t: np.ndarray) -> np.ndarray:
        """Return the sweep that the parameters make, of amplitude 1, at times t (N,), s."""
        names = {key: name for key, (name, _, _) in self.ranges.items()}
        f0, f1, end = (parameters[names[key]] for key in ("start_hz", "stop_hz", "duration_s"))
        dwell = self.dwell_cycles / f0
        tau, T = t - dwell, end - dwell
        if parameters.get("FW_AT_SYSID_TYPE") == FW_TYPES["linear"]:
            cycles = f0 * tau + (f1 - f0) * tau**2 / (2 * T)
        else:
            rate = np.log(f1 / f0) / T
            cycles = f0 * np.where(tau < 0, tau, np.expm1(rate * np.maximum(tau, 0)) / rate)
        wave = np.sin(2 * np.pi * cycles)
        for key, after in (("fade_in_s", t), ("fade_out_s", end - t)):
            if key in names and parameters.get(names[key], 0) > 0:
                wave *= 0.5 - 0.5 * np.cos(np.pi * np.clip(after / parameters[names[key]], 0, 1))
        return wave

    def format(self, summary: str, extensions: tuple[str, ...]) -> Format:
        """Return the format of this autopilot's parameter files."""
        ranges = ", ".join(
            f"{key} {f'{low:g} to {high:g}' if np.isfinite(high) else f'from {low:g}'} ({name})"
            for key, (name, low, high) in self.ranges.items()
        )
        fades = "" if "fade_in_s" in self.ranges else ", without fades"
        wants = {
            "channels": f"one of {', '.join(map(str, self.axes.values()))}",
            "units": "as the channels say"
            + (
                "" if all(axis.unit for axis in self.axes.values()) else "; a channel without unit has amplitude 0 to 1"
            ),
            "samples": "the sweep itself, neither shaped nor cut",
            "recipe": f"sweep, form {' or '.join(self.forms)}, dwell_cycles {self.dwell_cycles}, no offset{fades}; {ranges}",
        }
        return Format(summary, extensions, self.read, self.write, self.quantise, wants=wants)

    def write(self, table: Table, path: Path) -> None:
        """Write the parameter file and its sidecar."""
        channel = Channel.parse(table.names[1][2:])
        recipe = Recipe.from_dict(table.meta["recipe"])
        parameters = self.parameters(recipe, channel, float(table.values[-1, 0]))
        lines = ["# Sweep designed with excite. Load, check every value, and set the axis back to 0 after the flight."]
        lines += [self.line(name, value) for name, value in parameters.items()]
        with written_with_sidecar(path, table, {"amplitude": recipe["amplitude"][0]}) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="ascii", newline="\n")

    def read(self, path: Path) -> Table:
        """Return the sweep that a parameter file makes, at the sidecar's dt, else at 400 Hz and of its own amplitude."""
        raw = readable(path).read_bytes()
        meta = {"dt": DEFAULT_DT_S, "columns": None, "amplitude": None} | read_sidecar(path, raw)
        names = [self.axis, *(name for name, _, _ in self.ranges.values()), *self.extra]
        parameters = {}
        for line in raw.decode("ascii", "replace").replace(",", " ").splitlines():
            for name, value in pairwise(line.split()):
                if name in (*names, "FW_AT_SYSID_TYPE") and not line.startswith("#"):
                    with damaged(str(path)):
                        parameters[name] = float(np.float32(value))
        missing = [name for name in names if name not in parameters]
        if missing:
            raise ExciteError(f"{path}: no {', '.join(missing)}; is this a parameter file of a sweep of {self.name}?")
        with damaged(str(path)):
            end, dt = parameters[self.ranges["duration_s"][0]], positive(meta["dt"], "dt")
            for key, (name, low, high) in self.ranges.items():
                if not low <= parameters[name] <= high:
                    raise ExciteError(f"{name} = {parameters[name]:g} ({key}) is outside {low:g} to {high:g}")
            amplitude = meta["amplitude"] or parameters.get(self.ranges.get("amplitude", ("",))[0], 1.0)
            if end / dt > MOST_SAMPLES:
                raise ExciteError(f"{end:g} s at dt = {dt:g} s are more than {MOST_SAMPLES} samples")
            time = np.arange(round(end / dt) + 1) * dt
            u = self.waveform(parameters, time) * float(amplitude)
            axis = self.axes.get(int(parameters[self.axis]), Channel("u1"))
        return Table(
            tuple(meta.pop("columns") or ("time_s", header("u", axis))), np.column_stack([time, u]), str(path), meta
        )


ARDUPILOT = Autopilot(
    "ArduPilot",
    SID_AXES,
    ("log",),
    2,
    {
        "amplitude": ("SID_MAGNITUDE", 0, np.inf),
        "start_hz": ("SID_F_START_HZ", 0.01, 100),
        "stop_hz": ("SID_F_STOP_HZ", 0.01, 100),
        "fade_in_s": ("SID_T_FADE_IN", 0, 20),
        "duration_s": ("SID_T_REC", 0, 255),
        "fade_out_s": ("SID_T_FADE_OUT", 0, 5),
    },
    "SID_AXIS",
    lambda name, value: f"{name},{value:.9g}",
    {},
)
PX4 = Autopilot(
    "PX4",
    FW_AXES,
    ("linear", "log"),
    0,
    {
        "start_hz": ("FW_AT_SYSID_F0", 0.1, 30),
        "stop_hz": ("FW_AT_SYSID_F1", 0.1, 30),
        "duration_s": ("FW_AT_SYSID_TIME", 5, 120),
    },
    "FW_AT_AXES",
    lambda name, value: f"1\t1\t{name}\t" + (f"{value:.18f}\t9" if name in PX4_FLOATS else f"{value:.0f}\t6"),
    {"FW_AT_APPLY": 0},
)
PX4_FLOATS: set[str] = {name for name, _, _ in PX4.ranges.values()}  # MAV_PARAM_TYPE 9 is REAL32, 6 is INT32


def _alike(axis: Channel, channel: Channel) -> bool:
    """Whether a channel means an axis: the same unit and the same name, apart from a trailing ``rate``."""
    name = channel.name.lower().replace("throttle", "thrust").replace(" ", "_").removesuffix("rate").rstrip("_")
    return name == axis.name and channel.unit in ((axis.unit, "1") if not axis.unit else (axis.unit,))


ARDUPILOT_FILE = ARDUPILOT.format("parameters with which ArduPilot's SystemID mode plays a sweep", (".parm", ".param"))
PX4_FILE = PX4.format("parameters with which PX4's autotune of fixed wings plays a sweep", (".params",))
