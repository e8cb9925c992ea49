"""Pseudo-random binary sequences of maximum length."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import excite.generators.lfsr as lfsr
from excite.arguments import is_whole
from excite.generators.decorrelation import APART, Decorrelation, check
from excite.generators.lfsr import TAPS
from excite.generators.parameters import Channels
from excite.types.channel import Channel
from excite.types.recipe import Recipe
from excite.types.signal import Signal

CLOCK = 2.5  # chips per period of the highest frequency of interest: there the hold costs 2.3 dB


def prbs(
    order: int | None = None,
    *,
    dt: float,
    hold: int | None = None,
    highest_hz: float | None = None,
    taps: Sequence[int] | Sequence[Sequence[int]] | None = None,
    inverse_repeat: bool = False,
    decorrelate: str = "shift",
    amplitude: float | Sequence[float] = 1.0,
    offset: float | Sequence[float] = 0.0,
    band_limit_hz: float | None = None,
    channels: Channels = 1,
    periods: int | None = None,
    duration_s: float | None = None,
    seed: int = 0,
) -> Signal:
    """Return a maximum-length binary sequence, decorrelated between the channels.

    A shift register with primitive feedback polynomial of degree n runs through all M = 2^n - 1 non-zero states, so its
    bits, mapped to s = +1 and -1, have the circular autocorrelation

        (1/M) sum_k s(k) s(k + l) = 1 for l = 0 mod M, -1/M otherwise,

    hence the mean +1/M or -1/M and M - 1 other lines of one size, |S(f)| / M = sqrt(M + 1) / M. The sequence is
    persistently exciting of order M. Holding each chip for `hold` samples multiplies the spectrum by
    |sin(pi f / f_clock) / (hold sin(pi f dt))| with f_clock = 1 / (hold dt): -2.3 dB at 0.4 f_clock, so clock at about
    2.5 times the highest frequency of interest, which `highest_hz` does.

    Channel c plays u_c(k) = offset_c + amplitude_c sign_c s_c(k + shift_c) w_c(k), with w_c of period K in chips (K = 1
    unless said otherwise) and the period K M. Several channels are told apart (`decorrelate`) by

    - shift: one sequence, multiples of one spacing apart. Two channels correlate with 1/M, except at the lag that
      aligns them; so impulse responses up to the spacing separate. The product of two channels is itself a shift of the
      sequence (shift and add), so a product nonlinearity of the plant looks like a delayed linear response; with the
      spacing M/3 of three channels it even is the third channel. The spacing, at most M / channels, is therefore the one
      that puts the aligned product of any two channels farthest behind every channel (`product_lag_chips`).
    - hadamard: one sequence, its chips multiplied by rows w_c of a Hadamard matrix of order K, a power of two. At lag 0
      the channels are exactly orthogonal, at other lags below M they correlate with at most 1/M, and up to
      log2(K) + 1 of them not at all (unless inverse-repeat); responses up to M separate, for a period K times as long.
    - sequences: a different primitive polynomial each, chosen for small correlation. Responses up to M separate in the
      period M, but with a floor at any lag: near 2^(n/2 + 1) / M, exactly `cross_correlation`.

    Inverse-repeat (w changes its sign from each chip to the next; K doubles): u(k + K M / 2) = -u(k), so the even lines
    are exactly zero, the offset apart, and even-order nonlinearities of the plant leave the odd lines alone.

    Parameters
    ----------
    order : degree n, 2 to 32. None: the largest whose period fits into `duration_s`.
    dt : sampling time, s.
    hold : samples per chip, at least 1, the default.
    highest_hz : highest frequency of interest, Hz, instead of `hold`: the slowest clock of at least 2.5 times that.
    taps : t of the recursion s(k + n) = s(k) + sum_t s(k + t) mod 2, with `order`; one list per channel for "sequences".
        Refused unless primitive. None: from the table.
    inverse_repeat : whether the second half of each period is the negative of the first.
    decorrelate : "shift", "hadamard" or "sequences", see above.
    amplitude, offset : levels are offset - amplitude and offset + amplitude, in the channels' units; one number, or one per
        channel.
    band_limit_hz : removes every line above, without changing the phase of those below. The signal then has many levels;
        `amplitude` becomes its peak, and the recipe's `rms` says what is left.
    channels : their count, or their names with units such as ``["roll_ref [deg]", "pitch_ref [deg]"]``.
    periods : whole periods to play, default 1.
    duration_s : length in s, instead of `periods`; the signal is cut there, and when that is not a whole number of
        periods a `warnings` entry says what is lost.
    seed : whole number from 0. It draws the start state, which channel gets which shift, and the sign of each channel:
        a fresh realisation with the same autocorrelation, for "shift" one of M c! 2^c for c channels. One channel's
        realisations are circular shifts of one sequence and of its negative.

    Returns
    -------
    Signal with u (N, channels), period = K M hold samples (None when less than one period is played), and the recipe:
    the parameters above and the decisions kind, state, shifts, signs, modulation (the rows w), clock_hz, rms (about the
    offset), period_samples, usable_response_chips, usable_response_s, cross_correlation (largest within the usable
    response, relative to 1; None when unknown or for one channel), product_lag_chips, warnings. All of it is JSON;
    `regenerate(recipe)` returns the same bits.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Golomb, Shift Register Sequences, 1967 (properties); Söderström and Stoica, System Identification, 1989, chapter 5
    (autocorrelation, persistency of excitation); Godfrey (editor), Perturbation Signals for System Identification, 1993
    (inverse-repeat, several inputs); Gold, IEEE Trans. Inf. Theory 13, 1967 (different polynomials).
    """
    plan = _checked(
        order,
        dt,
        hold,
        highest_hz,
        taps,
        inverse_repeat,
        decorrelate,
        amplitude,
        offset,
        band_limit_hz,
        channels,
        periods,
        duration_s,
        seed,
    )
    apart = APART[decorrelate]
    decisions = _design(plan, apart)
    u, rms = _play(plan, decisions)
    tap_lists = [list(tap_set) for tap_set in plan.tap_sets]
    recipe = Recipe.of(
        prbs,
        order=plan.order,
        dt=plan.dt,
        hold=plan.hold,
        highest_hz=highest_hz and float(highest_hz),
        taps=tap_lists if apart.different else tap_lists[0],
        inverse_repeat=plan.inverse_repeat,
        decorrelate=decorrelate,
        amplitude=plan.levels,
        offset=plan.offsets,
        band_limit_hz=plan.band_limit_hz,
        channels=[str(c) for c in plan.channels],
        periods=plan.periods,
        duration_s=None if duration_s is None else float(duration_s),
        seed=plan.seed,
        **decisions,
        rms=rms,
        warnings=_clock_warning(highest_hz, plan.dt) + _cut_warning(plan.samples, plan.period, plan.dt),
    )
    return Signal(u, plan.dt, plan.channels, plan.period if plan.samples >= plan.period else None, recipe)


@dataclass(frozen=True)
class _Plan:
    """What is asked for, checked.

    repeats : K, sequences in one period; period, samples : of one period, and of all that is played; levels, offsets,
    tap_sets : as in the recipe, tap_sets one for all channels or one per channel.
    """

    order: int
    dt: float
    hold: int
    tap_sets: list[tuple[int, ...]]
    inverse_repeat: bool
    repeats: int
    levels: list[float]
    offsets: list[float]
    band_limit_hz: float | None
    channels: tuple[Channel, ...]
    periods: int | None
    period: int
    samples: int
    seed: int


def _checked(
    order: int | None,
    dt: float,
    hold: int | None,
    highest_hz: float | None,
    taps: Sequence | None,
    inverse_repeat: bool,
    decorrelate: str,
    amplitude: float | Sequence[float],
    offset: float | Sequence[float],
    band_limit_hz: float | None,
    channels: Channels,
    periods: int | None,
    duration_s: float | None,
    seed: int,
) -> _Plan:
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    count = len(named)
    hold = _hold(hold, highest_hz, dt)
    inverse_repeat = check.flag("inverse_repeat", inverse_repeat)
    apart = APART[check.choice("decorrelate", decorrelate, APART)]
    repeats = apart.rows(count) * (2 if inverse_repeat else 1)
    if periods is not None and duration_s is not None:
        raise check.bad("periods", periods, f"duration_s = {duration_s!r} is given too; give one of the two")
    samples = None if duration_s is None else check.samples("duration_s", duration_s, dt)
    order = _order(order, taps, duration_s, samples, hold * repeats, dt)
    if remedy := apart.refusal(order, count):
        raise check.bad("channels", count, remedy)
    period = (2**order - 1) * repeats * hold
    if samples is None:
        periods = check.whole("periods", 1 if periods is None else periods)
        samples = periods * period
    remedy = "lower order, hold, periods or channels, or cut with duration_s"
    check.bounded("order", order, samples, count, remedy)
    levels, offsets = check.amplitudes("amplitude", amplitude, count), check.offsets("offset", offset, count)
    limit = _band_limit(band_limit_hz, order, period, count, dt)
    tap_sets = _tap_sets(order, taps, count, decorrelate)
    return _Plan(
        order,
        dt,
        hold,
        tap_sets,
        inverse_repeat,
        repeats,
        levels,
        offsets,
        limit,
        named,
        periods,
        period,
        samples,
        seed,
    )


def _design(plan: _Plan, apart: Decorrelation) -> dict[str, Any]:
    """Draw start state, shifts and signs, and say what follows for the sequence as a whole."""
    count = len(plan.channels)
    spacing, product_lag = apart.spacing(plan.order, plan.tap_sets[0], count)
    state, shifts, signs = _draw(plan.seed, 2**plan.order - 1, count, spacing if apart.shifted else 0)
    rows = lfsr.modulation(count, apart.modulated, plan.inverse_repeat)
    return {
        "state": state,
        "shifts": shifts,
        "signs": signs,
        "modulation": rows.tolist(),
        "clock_hz": 1 / (plan.hold * plan.dt),
        "period_samples": plan.period,
        "usable_response_chips": spacing,
        "usable_response_s": spacing * plan.hold * plan.dt,
        "cross_correlation": apart.correlation(plan.order, plan.tap_sets, rows) if count > 1 else None,
        "product_lag_chips": None if plan.repeats > 1 else product_lag,
    }


def _play(plan: _Plan, decisions: Mapping[str, Any]) -> tuple[np.ndarray, list[float]]:
    """Return u (N, channels), and the rms of each channel about its offset."""
    length, wanted, rows = 2**plan.order - 1, plan.samples, np.array(decisions["modulation"])
    state, shifts, signs = (decisions[name] for name in ("state", "shifts", "signs"))
    needed = min(wanted, plan.period) if plan.band_limit_hz is None else plan.period
    chips = -(-needed // plan.hold)
    u, rms = np.empty((wanted, len(plan.channels))), list(plan.levels)
    for c, (level, offset) in enumerate(zip(plan.levels, plan.offsets, strict=True)):
        taps = plan.tap_sets[c % len(plan.tap_sets)]
        bits = lfsr.sequence(plan.order, taps, lfsr.advance(plan.order, taps, state, shifts[c]), min(length, chips))
        bits = _repeated(bits, chips) ^ _repeated(rows[c] * signs[c] < 0, chips)
        bits = np.repeat(bits, min(plan.hold, needed))
        if plan.band_limit_hz is None:
            u[:, c] = np.where(_repeated(bits, wanted), offset + level, offset - level)
        else:
            wave = _band_limited(bits, plan.band_limit_hz * plan.dt, plan.inverse_repeat)
            u[:, c] = offset + level * _repeated(wave, wanted)
            rms[c] = level * float(np.sqrt((wave**2).mean()))
    return u, rms


def _hold(hold: object, highest_hz: object, dt: float) -> int:
    given = None if hold is None else check.whole("hold", hold)
    if highest_hz is None:
        return given or 1
    chosen = max(1, int((1 + 1e-12) / (CLOCK * check.frequency("highest_hz", highest_hz, dt) * dt)))
    if given not in (None, chosen):
        raise check.bad("hold", hold, f"highest_hz = {highest_hz!r} asks for {chosen}; give one of the two")
    return chosen


def _order(order: object, taps: object, duration_s: object, wanted: int | None, chip: int, dt: float) -> int:
    """Return the order, checked, or the largest whose period of (2^n - 1) `chip` samples fits into those wanted."""
    if order is None:
        if taps is not None:
            raise check.bad("order", order, "taps belong to one order; give it too")
        if wanted is None:
            raise check.bad("order", order, "give a whole number from 2 to 32, or duration_s to have it chosen")
        fitting = [n for n in TAPS if (2**n - 1) * chip <= wanted]
        if not fitting:
            raise check.bad("duration_s", duration_s, f"the shortest period takes {3 * chip * dt:g} s; play longer")
        order = fitting[-1]
    order = check.whole("order", order, 2)
    if order not in TAPS:
        raise check.bad("order", order, f"orders from 2 to {max(TAPS)} are known")
    return order


def _band_limit(band_limit_hz: object, order: int, period: int, count: int, dt: float) -> float | None:
    if band_limit_hz is None:
        return None
    limit = check.frequency("band_limit_hz", band_limit_hz, dt)
    check.bounded("order", order, period, count, "band_limit_hz filters whole periods: lower order, hold or channels")
    if limit * period * dt < 1:
        raise check.bad("band_limit_hz", limit, f"the lowest line is at {1 / (period * dt):g} Hz; raise it")
    return limit


def _tap_sets(order: int, taps: object, count: int, decorrelate: str) -> list[tuple[int, ...]]:
    """Return the primitive tap sets: one per channel for different sequences, else one."""
    apart = APART[decorrelate]
    if taps is None:
        return apart.tap_sets(order, count)
    needed = count if apart.different else 1
    taps = check.items("taps", taps, f"give a list of whole numbers from 1 to {order - 1}")
    sets = [_primitive(order, each) for each in (taps if isinstance(taps[0], Sequence) else [taps])]
    if len({frozenset(each) for each in sets}) != needed or len(sets) != needed:
        remedy = f"give {needed} different lists" if needed > 1 else "give one list"
        raise check.bad("taps", taps, f"{remedy} for {count} channels decorrelated by {decorrelate}")
    return sets


def _primitive(order: int, taps: Any) -> tuple[int, ...]:
    whole = isinstance(taps, Sequence) and all(map(is_whole, taps))
    if not (whole and taps and len(set(taps)) == len(taps) and all(0 < t < order for t in taps)):
        raise check.bad("taps", taps, f"give different whole numbers from 1 to {order - 1} for order {order}")
    if not lfsr.is_primitive(order, taps):
        terms = " + ".join(f"x^{t}" for t in sorted((order, *taps), reverse=True))
        found = f"{terms} + 1 is not primitive: the sequence repeats after at most {lfsr.period(order, taps)} chips"
        raise check.bad("taps", taps, f"{found} instead of {2**order - 1}; choose others, or leave taps out")
    return tuple(int(t) for t in taps)


def _draw(seed: int, length: int, count: int, spacing: int) -> tuple[int, list[int], list[int]]:
    """Return start state, shift and sign of each channel; raw SeedSequence words, whose stream NumPy keeps fixed."""
    words = np.random.SeedSequence(seed).generate_state(1 + 2 * count, np.uint64)
    order = np.argsort(words[1 : 1 + count], kind="stable")
    shifts = [int(k) * spacing for k in order]
    return 1 + int(words[0]) % length, shifts, [1 if word & np.uint64(1) else -1 for word in words[1 + count :]]


def _repeated(values: np.ndarray, length: int) -> np.ndarray:
    return np.tile(values, -(-length // len(values)))[:length]


def _band_limited(bits: np.ndarray, highest: float, inverse_repeat: bool) -> np.ndarray:
    """Return one period without the lines above `highest` (cycles per sample), scaled to peak 1."""
    lines = np.fft.rfft(2.0 * bits - 1.0)
    lines[int(highest * len(bits) * (1 + 1e-12)) + 1 :] = 0.0
    if inverse_repeat:
        lines[::2] = 0.0
    wave = np.fft.irfft(lines, len(bits))
    return wave / np.abs(wave).max()


def _clock_warning(highest_hz: float | None, dt: float) -> list[str]:
    if highest_hz is None or CLOCK * highest_hz * dt <= 1 + 1e-12:
        return []
    ratio = 1 / (highest_hz * dt)
    return [
        f"the clock, {1 / dt:g} Hz at one sample per chip, is only {ratio:.3g} x highest_hz; sample faster to reach {CLOCK}"
    ]


def _cut_warning(samples: int, period: int, dt: float) -> list[str]:
    whole, rest = divmod(samples, period)
    if not rest:
        return []
    played = f"{samples} samples ({samples * dt:g} s) are {samples / period:.4g} periods of {period} samples"
    lost = f"beyond {whole} whole, {rest} samples are left over" if whole else "not one is complete"
    return [f"{played}: {lost}, so the flat lines and the -1/M correlation hold only approximately"]
