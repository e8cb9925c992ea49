"""Composition: signals side by side, one after the other, with rests between them and ramps from and to trim."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import lcm

import numpy as np

from excite.arguments import same_dt
from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

Trim = float | Sequence[float]


def side_by_side(
    signals: Sequence[Signal], *, pad: bool = False, trim: Trim = 0.0, channels: Channels | None = None
) -> Signal:
    """Return one signal with the channels of all signals, in order.

    Parameters
    ----------
    signals : with one dt, and of one length unless `pad`.
    pad : whether shorter signals rest at `trim` until the longest ends; `padded_samples` and a warning say so.
    trim : value of the padding, one number, or one per channel.
    channels : new names; needed where the signals' own names meet twice.

    The period is the least common multiple of the signals' periods when all have one, nothing is padded and it fits into
    the record. `regenerate` needs signals that come from generators.

    Raises
    ------
    ExciteError naming the signal that does not fit, its value and the remedy.
    """
    check = Parameters("side_by_side")
    signals = _signals(check, signals)
    lengths = [len(s.u) for s in signals]
    longest, count = max(lengths), sum(len(s.channels) for s in signals)
    pad = check.flag("pad", pad)
    short = [i for i, length in enumerate(lengths) if length < longest]
    if short and not pad:
        found = f"the longest has {longest} samples; give them one length, or pad = true to rest at trim"
        raise check.bad(f"signals[{short[0]}]", lengths[short[0]], found)
    trims = check.offsets("trim", trim, count)
    if channels is None:
        own = [c for s in signals for c in s.channels]
        channels, names = own, [c.name for c in own]
        if len(set(names)) < count:
            raise check.bad("channels", names, "some names meet twice; give channels, a name for each, or their count")
    named = check.channels(channels)
    if len(named) != count:
        raise check.bad(
            "channels", [str(c) for c in named], f"the signals have {count} channels; give one name for each"
        )
    check.bounded("signals", len(signals), longest, count, "shorten them, or give fewer")
    u, column = np.tile(trims, (longest, 1)), 0
    for s in signals:
        u[: len(s.u), column : column + s.u.shape[1]] = s.u
        column += s.u.shape[1]
    periods = [s.period for s in signals if s.period is not None]
    period = None if short or len(periods) < len(signals) else lcm(*periods)
    warnings = [
        f"signals[{i}] ends after {lengths[i]} samples and rests at trim for {longest - lengths[i]}" for i in short
    ]
    recipe = Recipe.of(
        side_by_side,
        signals=[s.recipe for s in signals],
        pad=pad,
        trim=trims,
        channels=[str(c) for c in named],
        padded_samples=[longest - length for length in lengths],
        warnings=warnings + _warnings(signals),
    )
    return Signal(u, signals[0].dt, named, period if period and period <= longest else None, recipe)


def in_sequence(signals: Sequence[Signal], *, rest_s: float = 0.0, trim: Trim = 0.0) -> Signal:
    """Return the signals one after the other, at rest at `trim` for `rest_s` seconds between them.

    Parameters
    ----------
    signals : with one dt and the same channels.
    rest_s : s, 0 for none; use `rest` for rests of different lengths.
    trim : value at rest, one number, or one per channel.

    The recipe's `starts` are the first samples of the signals. Only a single signal keeps its period.

    Raises
    ------
    ExciteError naming the signal that does not fit, its value and the remedy.
    """
    check = Parameters("in_sequence")
    signals = _signals(check, signals)
    first = signals[0]
    for i, s in enumerate(signals):
        if s.channels != first.channels:
            names, wanted = (", ".join(map(str, each.channels)) for each in (s, first))
            raise check.bad(f"signals[{i}]", names, f"signals[0] has the channels {wanted}; give all the same")
    trims = check.offsets("trim", trim, len(first.channels))
    pause = check.pause("rest_s", rest_s, first.dt)
    lengths = [len(s.u) + pause for s in signals]
    samples = sum(lengths) - pause
    check.bounded("signals", len(signals), samples, len(trims), "shorten them or rest_s, or give fewer")
    starts = np.cumsum([0, *lengths[:-1]]).tolist()
    u = np.tile(trims, (samples, 1))
    for start, s in zip(starts, signals, strict=True):
        u[start : start + len(s.u)] = s.u
    recipe = Recipe.of(
        in_sequence,
        signals=[s.recipe for s in signals],
        rest_s=float(rest_s),
        trim=trims,
        starts=starts,
        warnings=_warnings(signals),
    )
    return Signal(u, first.dt, first.channels, first.period if len(signals) == 1 else None, recipe)


def rest(*, dt: float, duration_s: float, trim: Trim = 0.0, channels: Channels = 1, seed: int = 0) -> Signal:
    """Return a signal that stays at `trim`, one number, or one per channel; `seed` changes nothing.

    Raises ExciteError naming the parameter, its value and the remedy.
    """
    check = Parameters("rest")
    dt, named = check.seconds("dt", dt), check.channels(channels)
    trims = check.offsets("trim", trim, len(named))
    samples = check.samples("duration_s", duration_s, dt)
    check.bounded("duration_s", duration_s, samples, len(named), "shorten it")
    recipe = Recipe.of(
        rest,
        dt=dt,
        duration_s=float(duration_s),
        trim=trims,
        channels=[str(c) for c in named],
        seed=check.seed(seed),
        warnings=[],
    )
    return Signal(np.tile(trims, (samples, 1)), dt, named, None, recipe)


def with_ramps(signal: Signal, *, up_s: float, down_s: float | None = None, trim: Trim = 0.0) -> Signal:
    """Return the signal with a straight ramp from trim to its first sample before it, and one from its last to trim after.

    Parameters
    ----------
    signal : stays as it is; the recipe's `core_start` and `core_samples` say where it lies.
    up_s, down_s : length of the ramps, s, 0 for none; down_s defaults to up_s. The ramp up starts at trim, the ramp down
        ends there.
    trim : one number, or one per channel.

    The result has no period; the recipe's `core_period` is the signal's own.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.
    """
    check = Parameters("with_ramps")
    (signal,) = _signals(check, [signal])
    trims = check.offsets("trim", trim, len(signal.channels))
    down_s = up_s if down_s is None else down_s
    up, down = check.pause("up_s", up_s, signal.dt), check.pause("down_s", down_s, signal.dt)
    samples = up + len(signal.u) + down
    check.bounded("up_s", up_s, samples, len(trims), "shorten the ramps or the signal")
    u = np.vstack(
        [np.linspace(trims, signal.u[0], up, endpoint=False), signal.u, np.linspace(signal.u[-1], trims, down + 1)[1:]]
    )
    recipe = Recipe.of(
        with_ramps,
        signal=signal.recipe,
        up_s=float(up_s),
        down_s=float(down_s),
        trim=trims,
        core_start=up,
        core_samples=len(signal.u),
        core_period=signal.period,
        warnings=_warnings([signal]),
    )
    return replace(signal, u=u, period=signal.period if samples == len(signal.u) else None, recipe=recipe)


def in_turn(wave: np.ndarray, levels: Sequence[float], offsets: Sequence[float]) -> np.ndarray:
    """Return (n c, c): each of c channels plays `wave` (n,) times its level in turn, while the others stay at their offset."""
    u = np.tile(np.asarray(offsets, dtype=float), (len(levels) * len(wave), 1))
    for c, level in enumerate(levels):
        u[c * len(wave) : (c + 1) * len(wave), c] += level * wave
    return u


def _signals(check: Parameters, signals: object) -> list[Signal]:
    """Return the signals, at least one, all with one dt."""
    if not isinstance(signals, Sequence) or not signals or not all(isinstance(s, Signal) for s in signals):
        kinds = [type(s).__name__ for s in signals] if isinstance(signals, Sequence) else type(signals).__name__
        raise check.bad("signals", kinds, "give at least one Signal, in a list")
    for i, s in enumerate(signals):
        if not same_dt(s.dt, signals[0].dt):
            remedy = f"signals[0] has dt = {signals[0].dt:g} s; bring both to one dt with Signal.sampled"
            raise check.bad(f"signals[{i}].dt", s.dt, remedy)
    return list(signals)


def _warnings(signals: Sequence[Signal]) -> list[str]:
    return [f"signals[{i}]: {text}" for i, s in enumerate(signals) for text in s.warnings]


COMPOSITIONS: dict[str, Callable[..., Signal]] = {f.__name__: f for f in (side_by_side, in_sequence, rest, with_ramps)}
