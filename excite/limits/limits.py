"""What the hardware allows: limits of the command and of the predicted outputs, and the check of a signal against them."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np

from excite.arguments import positive, same_dt, whole
from excite.errors import ExciteError, did_you_mean, placed
from excite.files.toml import read_toml
from excite.models.state_space import StateSpaceModel
from excite.plain import plain
from excite.types.signal import Signal

Number = float | Sequence[float] | None
ROUNDING = 1e-9  # relative excess over a limit that is rounding of its own arithmetic
MODEL_KEYS = ("A", "B", "C", "D", "dt", "input_offset", "output_offset")


@dataclass(frozen=True, eq=False)
class OutputLimit:
    """Bounds on what a model predicts the command to cause, from trim on.

    model : from all channels of the signal to the limited outputs, open or closed loop, at the signal's dt; trim is the
    model's offsets with zero state. low, high : bounds in the outputs' units, one number, or one per output; None, or an
    infinite one, is free.
    """

    model: StateSpaceModel
    low: Number = None
    high: Number = None

    def __post_init__(self) -> None:
        low, high = self.bounds()
        trim = self.model.output_offset
        for i in np.flatnonzero((low >= trim) | (high <= trim)):
            raise ExciteError(
                f"OutputLimit: output '{self.model.outputs[i].name}': trim is {trim[i]:g}, not inside {low[i]:g} to "
                f"{high[i]:g}; no command keeps this limit and moves: widen it or trim elsewhere"
            )

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Low and high of every output, (ny,) each, infinite where free."""
        names = tuple(c.name for c in self.model.outputs)
        return per_channel(self.low, names, "OutputLimit.low", -np.inf), per_channel(
            self.high, names, "OutputLimit.high", np.inf
        )

    def to_dict(self) -> dict:
        """Plain values for JSON and TOML; None is left out."""
        m = self.model
        model = {k: np.asarray(getattr(m, k)).tolist() for k in MODEL_KEYS}
        model |= {"inputs": [str(c) for c in m.inputs], "outputs": [str(c) for c in m.outputs]}
        return {"model": model} | {
            k: plain(v, finite=False) for k in ("low", "high") if (v := getattr(self, k)) is not None
        }

    @classmethod
    def from_dict(cls, table: Mapping) -> "OutputLimit":
        """Build from `to_dict` or a TOML table."""
        _known(table, ("model", "low", "high"), "limits.outputs")
        if "model" not in table:
            raise ExciteError("limits.outputs: model missing; give A, B, C, D and dt")
        _known(table["model"], (*MODEL_KEYS, "inputs", "outputs"), "limits.outputs.model")
        missing = [k for k in MODEL_KEYS[:5] if k not in table["model"]]
        if missing:
            raise ExciteError(f"limits.outputs.model: {', '.join(missing)} missing; give A, B, C, D and dt")
        return cls(StateSpaceModel(**table["model"]), table.get("low"), table.get("high"))


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the hardware; None is no limit, one number holds for all channels, or give one per channel.

    amplitude : largest |u|, in the channel's unit; low, high : bounds that need not be symmetric;
    rate : largest |du/dt|, unit/s, counted between held values; move : largest change between held values, unit;
    bits : resolution of the converter, whose 2^bits levels run evenly from range[0] to range[1] (low to high when no
    range is given); hold : samples for which the hardware holds a value (sample-and-hold);
    bandwidth_hz : of the actuator, a first-order lag 1 / (1 + s / (2 pi bandwidth)), or actuator : its model from command
    to position at the signal's dt; lost_power : largest share of a channel's power (about its mean) that the actuator may
    take away; outputs : limits of predicted outputs.
    """

    amplitude: Number = None
    low: Number = None
    high: Number = None
    rate: Number = None
    move: Number = None
    bits: int | None = None
    range: tuple[float, float] | None = None
    hold: int = 1
    bandwidth_hz: Number = None
    actuator: StateSpaceModel | None = None
    lost_power: float = 0.5
    outputs: tuple[OutputLimit, ...] = ()

    def __post_init__(self) -> None:
        for key in ("amplitude", "rate", "move", "bandwidth_hz"):
            value = getattr(self, key)
            if value is not None:
                for v in np.atleast_1d(np.asarray(value, dtype=object)):
                    positive(v, f"limits: {key}")
        for key, least in (("bits", 1), ("hold", 1)):
            value = getattr(self, key)
            if not (key == "bits" and value is None):
                whole(value, f"limits: {key}", least)
        if self.bits is not None and self.bits > 32:
            raise ExciteError(f"limits: bits: {self.bits}; no converter has more than 32")
        if (
            self.bits is not None
            and self.range is None
            and self.amplitude is None
            and (self.low is None or self.high is None)
        ):
            raise ExciteError(
                f"limits: bits: {self.bits} without a range; give range = [from, to], amplitude, or low and high"
            )
        if self.range is not None and (len(self.range) != 2 or not self.range[0] < self.range[1]):
            raise ExciteError(f"limits: range: {self.range!r}; give [from, to] with from below to")
        if not 0 < self.lost_power < 1:
            raise ExciteError(f"limits: lost_power: {self.lost_power!r}; give a share between 0 and 1")
        if self.bandwidth_hz is not None and self.actuator is not None:
            raise ExciteError("limits: bandwidth_hz and actuator are both given; give one of the two")
        outputs = (self.outputs,) if isinstance(self.outputs, OutputLimit) else tuple(self.outputs)
        object.__setattr__(self, "outputs", outputs)

    def to_dict(self) -> dict:
        """Plain values for JSON and TOML; what sets no limit is left out."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        given = {k: v for k, v in given.items() if v is not None and not (k == "outputs" and not v)}
        if self.actuator is not None:
            given["actuator"] = OutputLimit(self.actuator).to_dict()["model"]
        if self.outputs:
            given["outputs"] = [o.to_dict() for o in self.outputs]
        return {k: v if k in ("actuator", "outputs") else plain(v, finite=False) for k, v in given.items()}

    @classmethod
    def from_dict(cls, table: Mapping) -> "Limits":
        """Build from `to_dict` or a TOML table; unknown keys are refused with the nearest known one."""
        _known(table, [f.name for f in fields(cls)], "limits")
        values = dict(table)
        if "actuator" in values:
            values["actuator"] = OutputLimit.from_dict({"model": values["actuator"]}).model
        values["outputs"] = tuple(OutputLimit.from_dict(o) for o in values.get("outputs", ()))
        return cls(**values)

    def bounds(self, signal: Signal) -> tuple[np.ndarray, np.ndarray]:
        """Low and high of every channel, (nu,) each, infinite where free."""
        names = tuple(c.name for c in signal.channels)
        amplitude = per_channel(self.amplitude, names, "limits: amplitude", np.inf)
        low = np.maximum(per_channel(self.low, names, "limits: low", -np.inf), -amplitude)
        high = np.minimum(per_channel(self.high, names, "limits: high", np.inf), amplitude)
        for i in np.flatnonzero(low > high):
            raise ExciteError(
                f"limits: channel '{names[i]}': low {low[i]:g} is above high {high[i]:g}; nothing can be played"
            )
        return low, high

    def largest_move(self, signal: Signal) -> np.ndarray:
        """Largest change of every channel between held values by move and rate together, (nu,)."""
        names = tuple(c.name for c in signal.channels)
        rate = per_channel(self.rate, names, "limits: rate", np.inf)
        return np.minimum(per_channel(self.move, names, "limits: move", np.inf), rate * signal.dt * self.hold)

    def levels(self, signal: Signal) -> tuple[np.ndarray, np.ndarray] | None:
        """Lowest level and step of the converter of every channel, (nu,) each, or None without one."""
        if self.bits is None:
            return None
        low, high = self.bounds(signal) if self.range is None else np.outer(self.range, np.ones(len(signal.channels)))
        if not np.isfinite([low, high]).all():
            raise ExciteError(f"limits: bits: {self.bits} over an infinite range; give range = [from, to]")
        return low, (high - low) / (2**self.bits - 1)

    def actuator_gain(self, signal: Signal, samples: int) -> np.ndarray | None:
        """Power gain |H|^2 of the actuator for every channel on the lines of `samples`, (samples // 2 + 1, nu), or None."""
        f_hz = np.fft.rfftfreq(samples, signal.dt)
        if self.actuator is not None:
            _fits(self.actuator, signal, "limits: actuator")
            return (np.abs(self.actuator.frf(f_hz)) ** 2).sum(1)
        if self.bandwidth_hz is None:
            return None
        corner = per_channel(self.bandwidth_hz, tuple(c.name for c in signal.channels), "limits: bandwidth_hz", np.inf)
        return 1 / (1 + (f_hz[:, None] / corner) ** 2)


@dataclass(frozen=True)
class Check:
    """One limit of one channel: its value in the signal, the limit, whether it is kept, and where it is worst (s)."""

    limit: str
    channel: str
    value: float
    allowed: float
    ok: bool
    where_s: float | None = None

    def __str__(self) -> str:
        at = "" if self.where_s is None else f" at {self.where_s:g} s"
        kept = "kept" if self.ok else "exceeded"
        return f"{self.limit} of '{self.channel}' {kept}: {self.value:.6g} against {self.allowed:.6g}{at}"


@dataclass(frozen=True)
class LimitReport:
    """All checks of one signal; `ok` when every limit is kept."""

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every limit is kept."""
        return all(c.ok for c in self.checks)

    @property
    def exceeded(self) -> tuple[Check, ...]:
        """The limits that are not kept."""
        return tuple(c for c in self.checks if not c.ok)

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        return {"ok": self.ok, "checks": [asdict(c) for c in self.checks]}


def check(signal: Signal, limits: Limits) -> LimitReport:
    """Check every limit on every channel of a signal, as it is played from trim.

    Changes are counted between held values, and for a periodic signal also from its end to its start. Predicted outputs
    start from the model's trim. The actuator's share of lost power is 1 - sum |H|^2 P / sum P over the lines of the record.
    """
    u, dt = signal.u, signal.dt
    low, high = limits.bounds(signal)
    checks = _extremes("low", "high", u, low, high, signal.channels, dt)
    steps = np.abs(moves(signal, limits.hold))
    names = tuple(c.name for c in signal.channels)
    step_s = dt * limits.hold
    for name, value, unit in (("rate", limits.rate, step_s), ("move", limits.move, 1.0)):
        if value is not None:
            allowed = per_channel(value, names, f"limits: {name}", np.inf)
            for i, channel in enumerate(names):
                k = int(steps[:, i].argmax())
                checks.append(_below(name, channel, steps[k, i] / unit, allowed[i], (k + 1) * step_s))
    if limits.hold > 1:
        moved = np.abs(u - np.repeat(u[:: limits.hold], limits.hold, axis=0)[: len(u)])
        for i, channel in enumerate(names):
            k = int(moved[:, i].argmax())
            checks.append(Check("hold", channel, float(moved[k, i]), 0.0, bool(moved[k, i] == 0), k * dt))
    if (levels := limits.levels(signal)) is not None:
        off = np.abs((u - levels[0]) / levels[1] - np.round((u - levels[0]) / levels[1]))
        for i, channel in enumerate(names):
            k = int(off[:, i].argmax())
            checks.append(Check("quantisation", channel, float(off[k, i]), 0.0, bool(off[k, i] <= 1e-6), k * dt))
    if (gain := limits.actuator_gain(signal, len(u))) is not None:
        lost = lost_power(u, gain)
        checks += [_below("lost power", c, x, limits.lost_power) for c, x in zip(names, lost, strict=True)]
    for output in limits.outputs:
        _fits(output.model, signal, "limits: outputs")
        y = output.model.simulate(u)
        checks += _extremes("output low", "output high", y, *output.bounds(), output.model.outputs, dt)
    return LimitReport(tuple(checks))


def load_limits(path: str | os.PathLike) -> Limits:
    """Read a TOML file with the fields of `Limits`; errors name the file."""
    table = read_toml(path)
    with placed(str(path)):
        return Limits.from_dict(table)


def moves(signal: Signal, hold: int) -> np.ndarray:
    """Changes between held values, (values, nu); the last from the end to the start where whole periods repeat, else 0."""
    held = signal.u[::hold]
    repeats = signal.period is not None and len(signal.u) % signal.period == 0
    return np.diff(held, axis=0, append=held[:1] if repeats else held[-1:])


def lost_power(u: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Share of each channel's power about its mean that a power gain (lines, nu) takes away, (nu,)."""
    power = np.abs(np.fft.rfft(u, axis=0)) ** 2
    power[0] = 0.0
    total = power.sum(0)
    return np.where(total > 0, 1 - (power * gain).sum(0) / np.where(total > 0, total, 1.0), 0.0)


def _extremes(
    below: str, above: str, values: np.ndarray, low: np.ndarray, high: np.ndarray, channels: Sequence, dt: float
) -> list[Check]:
    """Checks of the least and the greatest value of every column with a finite bound."""
    checks = []
    for i, channel in enumerate(channels):
        slack = ROUNDING * max((abs(b) for b in (low[i], high[i]) if np.isfinite(b)), default=0.0)
        least, most = int(values[:, i].argmin()), int(values[:, i].argmax())
        if np.isfinite(low[i]):
            v = float(values[least, i])
            checks.append(Check(below, channel.name, v, float(low[i]), bool(v >= low[i] - slack), least * dt))
        if np.isfinite(high[i]):
            v = float(values[most, i])
            checks.append(Check(above, channel.name, v, float(high[i]), bool(v <= high[i] + slack), most * dt))
    return checks


def _below(name: str, channel: str, value: float, allowed: float, where_s: float | None = None) -> Check:
    return Check(name, channel, float(value), float(allowed), bool(value <= allowed * (1 + ROUNDING)), where_s)


def per_channel(value: Number, names: Sequence[str], place: str, default: float) -> np.ndarray:
    """Return one number per channel, (nu,); `default` where there is no limit, which infinity says too."""
    if value is None:
        return np.full(len(names), default)
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.shape not in ((), (len(names),)) or np.isnan(array).any():
        raise ExciteError(f"{place}: {value!r}; give one number, or one for each of {', '.join(names)}")
    return np.broadcast_to(array, (len(names),)).copy()


def _fits(model: StateSpaceModel, signal: Signal, place: str) -> None:
    if model.D.shape[1] != len(signal.channels):
        raise ExciteError(
            f"{place}: the model has {model.D.shape[1]} inputs, the signal {len(signal.channels)} channels; give all of them"
        )
    if not same_dt(model.dt, signal.dt):
        raise ExciteError(
            f"{place}: the model's dt is {model.dt:g} s, the signal's {signal.dt:g} s; sample the signal at the model's dt"
        )


def _known(table: Mapping, known: Sequence[str], place: str) -> None:
    for key in table:
        if key not in known:
            raise ExciteError(f"{place}: no key '{key}'; {did_you_mean(str(key), known)}")
