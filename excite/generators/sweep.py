"""Sine sweeps: linear, logarithmic, Schroeder-phased, and stepped."""

from collections.abc import Sequence

import numpy as np

from excite.generators.compose import in_turn
from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

check = Parameters("sweep")

_BAND = {"start_hz": ..., "stop_hz": ..., "duration_s": ...}
_CHIRP = {**_BAND, "dwell_cycles": 0, "fade_in_s": 0.0, "fade_out_s": 0.0}
# form -> the parameters it uses with their defaults (...: required)
FORMS: dict[str, dict[str, object]] = {
    "linear": _CHIRP,
    "log": _CHIRP,
    "schroeder": {**_BAND, "periods": 1},
    "stepped": {
        "start_hz": None,
        "stop_hz": None,
        "points": None,
        "frequencies_hz": None,
        "settle_periods": 2,
        "measure_periods": 4,
        "profile": None,
    },
}


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
      k = 1 … K, which sweep upwards once a period; scaled to the peak `amplitude` (`crest_factor`).
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
    amplitude : peak, in the channels' units; one number, or one a channel.
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
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    count = len(named)
    form = check.choice("form", form, FORMS)
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
    own = check.fill(form, FORMS[form], given)
    levels, offsets = check.amplitudes("amplitude", amplitude, count), check.offsets("offset", offset, count)

    period, decisions = None, {"segments": None, "lines_hz": None, "crest_factor": None}
    warnings: list[str] = []
    if form == "stepped":
        plan, warnings = _plan(own, dt)
        total = sum(step["settle"] + step["measure"] for step in plan)
        check.bounded(
            "settle_periods", own["settle_periods"], total * count, count, "measure fewer frequencies or periods"
        )
        wave = _stepped(plan)
        decisions["segments"] = [
            step | {"channel": c, "start": step["start"] + c * total, "amplitude": step["amplitude"] * levels[c]}
            for c in range(count)
            for step in plan
        ]
    else:
        for name in ("start_hz", "stop_hz"):
            own[name] = check.frequency(name, own[name], dt)
        samples = check.samples("duration_s", duration_s, dt)
        lowest = min(own["start_hz"], own["stop_hz"])
        if samples * dt * lowest < 1 - 1e-9:
            remedy = f"it holds no whole period of {lowest:g} Hz; play at least {1 / lowest:g} s"
            raise check.bad("duration_s", duration_s, remedy)
        own["duration_s"] = float(duration_s)
        repeats = check.whole("periods", own.get("periods", 1))
        check.bounded("duration_s", duration_s, samples * repeats * count, count, "shorten it, or play less often")
        if form == "schroeder":
            once, decided = _schroeder(own, samples, dt)
            wave, decisions = np.tile(once, repeats), decisions | decided
            period = samples if count == 1 else None
        else:
            wave = _chirp(form, own, samples, dt)
    recipe = Recipe.of(
        sweep,
        form=form,
        dt=dt,
        **(dict.fromkeys(given) | own),
        amplitude=levels,
        offset=offsets,
        channels=[str(c) for c in named],
        seed=seed,
        starts=[c * len(wave) for c in range(count)],
        **decisions,
        warnings=warnings,
    )
    return Signal(in_turn(wave, levels, offsets), dt, named, period, recipe)


def _chirp(form: str, own: dict, samples: int, dt: float) -> np.ndarray:
    f0, f1 = own["start_hz"], own["stop_hz"]
    if f0 == f1:
        raise check.bad("stop_hz", f1, 'it equals start_hz; give another, or use the form "stepped" for one frequency')
    own["dwell_cycles"] = check.whole("dwell_cycles", own["dwell_cycles"], 0)
    end, dwell = (samples - 1) * dt, own["dwell_cycles"] / f0
    T = end - dwell
    if T * min(f0, f1) < 1 - 1e-9 - dt * min(f0, f1):
        remedy = f"its {dwell:g} s leave {T:g} s to sweep, less than a period of {min(f0, f1):g} Hz; dwell less"
        raise check.bad("dwell_cycles", own["dwell_cycles"], remedy)
    fades = [
        check.number(key, own[key], "give a number of seconds, 0 for none", least=0)
        for key in ("fade_in_s", "fade_out_s")
    ]
    if sum(fades) > end:
        raise check.bad("fade_out_s", fades[1], f"with fade_in_s = {fades[0]:g} it exceeds the {end:g} s; shorten them")
    own["fade_in_s"], own["fade_out_s"] = fades

    time = np.arange(samples) * dt
    t = time - dwell
    if form == "linear":
        cycles = f0 * t + (f1 - f0) * t**2 / (2 * T)
    else:
        rate = np.log(f1 / f0) / T
        cycles = f0 / rate * np.expm1(rate * np.maximum(t, 0.0))
    wave = np.sin(2 * np.pi * np.where(t < 0, f0 * t, cycles))
    for fade, after in ((fades[0], time), (fades[1], time[-1] - time)):
        if fade:
            wave *= 0.5 - 0.5 * np.cos(np.pi * np.minimum(after, fade) / fade)
    return wave


def _schroeder(own: dict, samples: int, dt: float) -> tuple[np.ndarray, dict]:
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
    return wave, {"lines_hz": [float(first), float(last)], "crest_factor": float(1 / np.sqrt((wave**2).mean()))}


def _plan(own: dict, dt: float) -> tuple[list[dict], list[str]]:
    """Return the segments of one channel, and warnings; every measured window holds whole periods in whole samples."""
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
    return plan, _grid_warnings(plan)


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


def _stepped(plan: list[dict]) -> np.ndarray:
    parts, cycles = [], 0.0
    for step in plan:
        samples = step["settle"] + step["measure"]
        turns = np.arange(samples) * step["periods"] % step["measure"] / step["measure"]  # exact: whole numbers
        parts.append(step["amplitude"] * np.sin(2 * np.pi * (cycles + turns)))
        cycles = (cycles + samples * step["periods"] % step["measure"] / step["measure"]) % 1
    return np.concatenate(parts)
