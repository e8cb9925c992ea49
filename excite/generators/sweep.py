"""Sine sweeps: linear, logarithmic, Schroeder-phased, and stepped."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from excite.generators.compose import in_turn
from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

check = Parameters("sweep")


def sweep(
    *,
    form: str = "log",
    dt: float,
    start_hz: float | None = None,
    stop_hz: float | None = None,
    duration_s: float | None = None,
    dwell_cycles: int | None = None,
    fade_in_s: float | None = None,
    fade_out_s: float | None = None,
    periods: int | None = None,
    frequencies_hz: Sequence[float] | None = None,
    points: int | None = None,
    settle_periods: float | None = None,
    measure_periods: int | None = None,
    profile: Sequence[float] | None = None,
    amplitude: float | Sequence[float] = 1.0,
    offset: float | Sequence[float] = 0.0,
    channels: Channels = 1,
    seed: int = 0,
) -> Signal:
    """Return a sine whose frequency moves through a band; several channels are swept one after the other.

    With T the time from the first to the last sample, less the dwell, and t counted from the end of the dwell, the phase
    is the exact integral of the frequency:

    - linear: f(t) = f0 + (f1 - f0) t / T, phase 2 pi (f0 t + (f1 - f0) t^2 / (2 T)): equal time per Hz.
    - log: f(t) = f0 (f1 / f0)^(t / T), phase 2 pi f0 T / ln(f1 / f0) ((f1 / f0)^(t / T) - 1): equal time per octave.
    - schroeder: periodic; all K lines k / duration_s of the band at one amplitude, with the phases -pi k (k - 1) / K,
      k = 1 … K, which sweep upwards once per period; scaled to the peak `amplitude` (`crest_factor`).
    - stepped: one frequency after the other with continuous phase, each held for `settle_periods` and then measured for
      `measure_periods`. Frequencies move to the nearest one whose measured periods fill whole samples (`segments`), so
      that a DFT over the measured samples has no leakage.

    Parameters
    ----------
    form : "linear", "log", "schroeder" or "stepped".
    dt : sampling time, s.
    start_hz, stop_hz : first and last frequency, Hz, up to Nyquist; downwards is allowed except for "schroeder".
    duration_s : length of one channel's turn, s, dwell and fades included; of one period of "schroeder".
    dwell_cycles : whole cycles at start_hz before a linear or log sweep begins; default 0.
    fade_in_s, fade_out_s : the amplitude rises from 0 at the first sample, and falls to 0 at the last, as
        (1 - cos(pi t / fade)) / 2; s, default 0.
    periods : of "schroeder", default 1.
    frequencies_hz : of "stepped", Hz, in this order, instead of start_hz, stop_hz and points.
    points : of "stepped": log-spaced frequencies from start_hz to stop_hz, default 30.
    settle_periods : periods to leave out of the analysis, from 0, at each frequency of "stepped"; default 2.
    measure_periods : whole periods to measure; default 4.
    profile : amplitude at each frequency of "stepped" as a fraction of `amplitude`; default 1.
    amplitude : peak, in the channels' units; one number, or one per channel.
    offset : level about which it swings and at which the other channels rest, likewise.
    channels : their count, or their names with units.
    seed : taken for uniformity; the signal is deterministic.

    Returns
    -------
    Signal, with the period of a Schroeder sweep on one channel, and the recipe: the parameters above, and kind, starts
    (first sample of each channel's turn), segments (of "stepped": channel, asked_hz, f_hz, start, settle and measure in
    samples, amplitude; the measured samples are start + settle to start + settle + measure), lines_hz and crest_factor
    (of "schroeder"), warnings.

    An ArduPilot system-identification sweep is ``sweep(dt=0.0025, start_hz=0.5, stop_hz=40, duration_s=70,
    fade_in_s=15, fade_out_s=2, dwell_cycles=2)``.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Schroeder, IEEE Trans. Inf. Theory 16, 1970; Tischler and Remple, Aircraft and Rotorcraft System Identification, 2012,
    chapter 5 (flight-test sweeps, fades and dwell); ArduPilot, AP_Math/chirp.cpp.
    """
    given = {
        "start_hz": start_hz,
        "stop_hz": stop_hz,
        "duration_s": duration_s,
        "dwell_cycles": dwell_cycles,
        "fade_in_s": fade_in_s,
        "fade_out_s": fade_out_s,
        "periods": periods,
        "frequencies_hz": frequencies_hz,
        "points": points,
        "settle_periods": settle_periods,
        "measure_periods": measure_periods,
        "profile": profile,
    }
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    form = check.choice("form", form, FORMS)
    own = check.fill(form, FORMS[form].uses, given)
    levels, offsets = check.amplitudes("amplitude", amplitude, len(named)), check.offsets("offset", offset, len(named))
    turn = FORMS[form].design(own, dt, levels)
    recipe = Recipe.of(
        sweep,
        form=form,
        dt=dt,
        **(dict.fromkeys(given) | turn.own),
        amplitude=levels,
        offset=offsets,
        channels=[str(c) for c in named],
        seed=seed,
        starts=[c * len(turn.wave) for c in range(len(named))],
        **(dict.fromkeys(("segments", "lines_hz", "crest_factor")) | turn.decisions),
        warnings=turn.warnings,
    )
    period = turn.period if len(named) == 1 else None
    return Signal(in_turn(turn.wave, levels, offsets), dt, named, period, recipe)


@dataclass(frozen=True, eq=False)
class _Turn:
    """What one channel plays in its turn, at amplitude 1; own : the form's parameters, checked; period in samples."""

    wave: np.ndarray
    own: dict[str, Any]
    decisions: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    period: int | None = None


def _linear(own: dict, dt: float, levels: list[float]) -> _Turn:
    def cycles(t: np.ndarray, T: float, f0: float, f1: float) -> np.ndarray:
        return f0 * t + (f1 - f0) * t**2 / (2 * T)

    return _chirp(own, dt, levels, cycles)


def _log(own: dict, dt: float, levels: list[float]) -> _Turn:
    def cycles(t: np.ndarray, T: float, f0: float, f1: float) -> np.ndarray:
        rate = np.log(f1 / f0) / T
        return f0 / rate * np.expm1(rate * np.maximum(t, 0.0))

    return _chirp(own, dt, levels, cycles)


def _chirp(own: dict, dt: float, levels: list[float], cycles: Callable[..., np.ndarray]) -> _Turn:
    """Return a sweep whose phase in cycles, from the end of the dwell on, is cycles(t, T, f0, f1)."""
    own, samples = _band(own, dt, levels)
    f0, f1 = own["start_hz"], own["stop_hz"]
    if f0 == f1:
        raise check.bad("stop_hz", f1, 'it equals start_hz; give another, or use the form "stepped" for one frequency')
    own["dwell_cycles"] = check.whole("dwell_cycles", own["dwell_cycles"], 0)
    end, dwell = (samples - 1) * dt, own["dwell_cycles"] / f0
    T = end - dwell
    if T * min(f0, f1) < 1 - 1e-9 - dt * min(f0, f1):
        remedy = f"its {dwell:g} s leave {T:g} s to sweep, less than a period of {min(f0, f1):g} Hz; dwell less"
        raise check.bad("dwell_cycles", own["dwell_cycles"], remedy)
    fades = own["fade_in_s"], own["fade_out_s"] = _fades(own, end)

    time = np.arange(samples) * dt
    t = time - dwell
    wave = np.sin(2 * np.pi * np.where(t < 0, f0 * t, cycles(t, T, f0, f1)))
    for fade, after in zip(fades, (time, time[-1] - time), strict=True):
        if fade:
            wave *= 0.5 - 0.5 * np.cos(np.pi * np.minimum(after, fade) / fade)
    return _Turn(wave, own)


def _band(own: dict, dt: float, levels: list[float]) -> tuple[dict, int]:
    """Return the parameters that all sweeps through a band share, checked, and the samples of `duration_s`."""
    own = own | {name: check.frequency(name, own[name], dt) for name in ("start_hz", "stop_hz")}
    samples = check.samples("duration_s", own["duration_s"], dt)
    lowest = min(own["start_hz"], own["stop_hz"])
    if samples * dt * lowest < 1 - 1e-9:
        remedy = f"it holds no whole period of {lowest:g} Hz; play at least {1 / lowest:g} s"
        raise check.bad("duration_s", own["duration_s"], remedy)
    repeats = check.whole("periods", own.get("periods", 1))
    remedy = "shorten it, or play less often"
    check.bounded("duration_s", own["duration_s"], samples * repeats * len(levels), len(levels), remedy)
    return own | {"duration_s": float(own["duration_s"])}, samples


def _fades(own: dict, end: float) -> tuple[float, float]:
    """Return the times of fading in and out, s, which together fit into `end` seconds."""
    remedy = "give a number of seconds, 0 for none"
    into, out = (check.number(name, own[name], remedy, least=0) for name in ("fade_in_s", "fade_out_s"))
    if into + out > end:
        raise check.bad("fade_out_s", out, f"with fade_in_s = {into:g} it exceeds the {end:g} s; shorten them")
    return into, out


def _schroeder(own: dict, dt: float, levels: list[float]) -> _Turn:
    own, samples = _band(own, dt, levels)
    low, high = own["start_hz"] * samples * dt, own["stop_hz"] * samples * dt
    lines = np.arange(int(np.ceil(low * (1 - 1e-12))), min(int(high * (1 + 1e-12)), (samples - 1) // 2) + 1)
    if not len(lines):
        spacing = f"no multiple of {1 / (samples * dt):g} Hz lies between start_hz and stop_hz, below Nyquist"
        raise check.bad("stop_hz", own["stop_hz"], f"{spacing}; widen the band, upwards, or raise duration_s")
    k = np.arange(1, len(lines) + 1)
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(-1j * np.pi * (k * (k - 1) % (2 * len(k))) / len(k))
    wave = np.fft.irfft(spectrum, samples)
    wave /= np.abs(wave).max()
    first, last = lines[[0, -1]] / (samples * dt)
    figures = {"lines_hz": [float(first), float(last)], "crest_factor": float(1 / np.sqrt((wave**2).mean()))}
    return _Turn(np.tile(wave, own["periods"]), own, figures, period=samples)


def _stepped(own: dict, dt: float, levels: list[float]) -> _Turn:
    own = dict(own)
    plan = _plan(own, dt)
    total = sum(step["settle"] + step["measure"] for step in plan)
    remedy = "measure fewer frequencies or periods"
    check.bounded("settle_periods", own["settle_periods"], total * len(levels), len(levels), remedy)
    segments = [
        step | {"channel": c, "start": step["start"] + c * total, "amplitude": step["amplitude"] * level}
        for c, level in enumerate(levels)
        for step in plan
    ]
    return _Turn(_tones(plan), own, {"segments": segments}, _grid_warnings(plan))


def _plan(own: dict, dt: float) -> list[dict]:
    """Return the segments of one channel; every measured window holds whole periods in whole samples.

    Puts the parameters into `own` as they are used.
    """
    asked = _frequencies(own, dt)
    measure = own["measure_periods"] = check.whole("measure_periods", own["measure_periods"])
    settle = own["settle_periods"] = check.number(
        "settle_periods", own["settle_periods"], "give a number from 0", least=0
    )
    if own["profile"] is not None:
        own["profile"] = check.amplitudes("profile", own["profile"], len(asked), "frequencies")
    longest = (settle + measure) / (min(asked) * dt)
    check.bounded("settle_periods", settle, int(min(longest, 1e18)), 1, "settle and measure for fewer periods")
    plan, start = [], 0
    for f_hz, level in zip(asked, own["profile"] or [1.0] * len(asked), strict=True):
        window = max(round(measure / (f_hz * dt)), 2 * measure + 1)  # strictly below Nyquist
        found = measure / (window * dt)
        lead = int(np.ceil(settle / (found * dt) - 1e-9))
        plan.append(
            {
                "asked_hz": f_hz,
                "f_hz": found,
                "start": start,
                "settle": lead,
                "measure": window,
                "periods": measure,
                "amplitude": level,
            }
        )
        start += lead + window
    return plan


def _grid_warnings(plan: list[dict]) -> list[str]:
    """Say when whole samples move a frequency by more than 1 %, or two frequencies onto one."""
    warnings, remedy = [], "raise measure_periods, or sample faster"
    worst = max(plan, key=lambda step: abs(step["f_hz"] / step["asked_hz"] - 1))
    if abs(worst["f_hz"] / worst["asked_hz"] - 1) > 0.01:
        warnings.append(f"the sample grid moves {worst['asked_hz']:g} Hz to {worst['f_hz']:g} Hz; {remedy}")
    if len({step["measure"] for step in plan}) < len({step["asked_hz"] for step in plan}):
        warnings.append(f"neighbouring frequencies fall together on the sample grid; {remedy}")
    return warnings


def _frequencies(own: dict, dt: float) -> list[float]:
    listed, band = own["frequencies_hz"], (own["start_hz"], own["stop_hz"])
    if listed is None:
        for name in ("start_hz", "stop_hz"):
            if own[name] is None:
                raise check.bad(name, None, "the form 'stepped' needs start_hz and stop_hz, or frequencies_hz")
            own[name] = check.frequency(name, own[name], dt)
        points = own["points"] = check.whole("points", 30 if own["points"] is None else own["points"], 2)
        check.bounded("points", points, points, 1, "give fewer")
        return np.geomspace(own["start_hz"], own["stop_hz"], points).tolist()
    if band != (None, None) or own["points"] is not None:
        raise check.bad("frequencies_hz", listed, "start_hz, stop_hz or points is given too; give one of the two ways")
    listed = check.items("frequencies_hz", listed, "give a list of frequencies in Hz")
    own["frequencies_hz"] = [check.frequency(f"frequencies_hz[{i}]", f_hz, dt) for i, f_hz in enumerate(listed)]
    return own["frequencies_hz"]


def _tones(plan: list[dict]) -> np.ndarray:
    """Return the tones of a plan one after the other, with continuous phase."""
    parts, cycles = [], 0.0
    for step in plan:
        samples = step["settle"] + step["measure"]
        turns = np.arange(samples) * step["periods"] % step["measure"] / step["measure"]  # exact: whole numbers
        parts.append(step["amplitude"] * np.sin(2 * np.pi * (cycles + turns)))
        cycles = (cycles + samples * step["periods"] % step["measure"] / step["measure"]) % 1
    return np.concatenate(parts)


@dataclass(frozen=True)
class Form:
    """One form of sweep: which parameters it uses, with their defaults (...: required), and what it plays.

    design(own parameters, dt, amplitude of each channel) -> one channel's turn.
    """

    uses: Mapping[str, Any]
    design: Callable[[dict, float, list[float]], _Turn]


_THROUGH = {"start_hz": ..., "stop_hz": ..., "duration_s": ...}
_ONCE = {**_THROUGH, "dwell_cycles": 0, "fade_in_s": 0.0, "fade_out_s": 0.0}
_STEPS = {
    "start_hz": None,
    "stop_hz": None,
    "points": None,
    "frequencies_hz": None,
    "settle_periods": 2,
    "measure_periods": 4,
    "profile": None,
}
FORMS: dict[str, Form] = {
    "linear": Form(_ONCE, _linear),
    "log": Form(_ONCE, _log),
    "schroeder": Form({**_THROUGH, "periods": 1}, _schroeder),
    "stepped": Form(_STEPS, _stepped),
}
