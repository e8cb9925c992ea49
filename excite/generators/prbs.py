"""Pseudo-random binary sequences of maximum length."""

from collections.abc import Sequence

import numpy as np

from excite.generators import lfsr
from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

# Order n -> taps t of s(k+n) = s(k) + sum s(k+t) mod 2: the table of scipy.signal.max_len_seq, which names New Wave
# Instruments' list of m-sequence feedback taps (first entry of each length) as its source. The tests prove every
# polynomial primitive. Other lists, such as Xilinx XAPP052, differ for some orders and serve equally.
TAPS: dict[int, tuple[int, ...]] = {
    2: (1,),
    3: (2,),
    4: (3,),
    5: (3,),
    6: (5,),
    7: (6,),
    8: (7, 6, 1),
    9: (5,),
    10: (7,),
    11: (9,),
    12: (11, 10, 4),
    13: (12, 11, 8),
    14: (13, 12, 2),
    15: (14,),
    16: (15, 13, 4),
    17: (14,),
    18: (11,),
    19: (18, 17, 14),
    20: (17,),
    21: (19,),
    22: (21,),
    23: (18,),
    24: (23, 22, 17),
    25: (22,),
    26: (25, 24, 20),
    27: (26, 25, 22),
    28: (25,),
    29: (27,),
    30: (29, 28, 7),
    31: (28,),
    32: (31, 30, 10),
}
CLOCK = 2.5  # chips per period of the highest frequency of interest: there the hold costs 2.3 dB
DECORRELATE = ("shift", "hadamard", "sequences")

check = Parameters("prbs")


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
    taps : t of the recursion s(k + n) = s(k) + sum_t s(k + t) mod 2, with `order`; one list a channel for "sequences".
        Refused unless primitive. None: from the table.
    inverse_repeat : whether the second half of each period is the negative of the first.
    decorrelate : "shift", "hadamard" or "sequences", see above.
    amplitude, offset : levels are offset - amplitude and offset + amplitude, in the channels' units; one number, or one a
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
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    count = len(named)
    hold = _hold(hold, highest_hz, dt)
    inverse_repeat = check.flag("inverse_repeat", inverse_repeat)
    decorrelate = check.choice("decorrelate", decorrelate, DECORRELATE)
    factor = (2 if inverse_repeat else 1) << ((count - 1).bit_length() if decorrelate == "hadamard" else 0)  # K

    if periods is not None and duration_s is not None:
        raise check.bad("periods", periods, f"duration_s = {duration_s!r} is given too; give one of the two")
    wanted = None if duration_s is None else check.samples("duration_s", duration_s, dt)
    order = _order(order, taps, duration_s, wanted, hold * factor, dt)
    length = 2**order - 1
    if decorrelate == "shift" and count > length:
        raise check.bad("channels", count, f"order {order} has only {length} distinct shifts; raise the order")
    period = length * factor * hold
    if wanted is None:
        periods = check.whole("periods", 1 if periods is None else periods)
        wanted = periods * period
    remedy = "lower order, hold, periods or channels, or cut with duration_s"
    check.bounded("order", order, wanted, count, remedy)
    levels, offsets = check.amplitudes("amplitude", amplitude, count), check.offsets("offset", offset, count)
    if band_limit_hz is not None:
        band_limit_hz = check.frequency("band_limit_hz", band_limit_hz, dt)
        check.bounded(
            "order", order, period, count, "band_limit_hz filters whole periods: lower order, hold or channels"
        )
        if band_limit_hz * period * dt < 1:
            raise check.bad("band_limit_hz", band_limit_hz, f"the lowest line is at {1 / (period * dt):g} Hz; raise it")

    polynomials = _taps(order, taps, count, decorrelate)
    spacing, product_lag = lfsr.spacing(order, polynomials[0], count) if decorrelate == "shift" else (length, None)
    state, shifts, signs = _draw(seed, length, count, spacing if decorrelate == "shift" else 0)
    rows = lfsr.modulation(count, decorrelate == "hadamard", inverse_repeat)
    needed = min(wanted, period) if band_limit_hz is None else period
    chips = -(-needed // hold)
    u, rms = np.empty((wanted, count)), list(levels)
    for c in range(count):
        tap_set = polynomials[c % len(polynomials)]
        bits = lfsr.sequence(order, tap_set, lfsr.advance(order, tap_set, state, shifts[c]), min(length, chips))
        bits = _repeated(bits, chips) ^ _repeated(rows[c] * signs[c] < 0, chips)
        bits = np.repeat(bits, min(hold, needed))
        if band_limit_hz is None:
            u[:, c] = np.where(_repeated(bits, wanted), offsets[c] + levels[c], offsets[c] - levels[c])
        else:
            wave = _band_limited(bits, band_limit_hz * dt, inverse_repeat)
            u[:, c] = offsets[c] + levels[c] * _repeated(wave, wanted)
            rms[c] = levels[c] * float(np.sqrt((wave**2).mean()))

    nested = [list(tap_set) for tap_set in polynomials]
    recipe = Recipe.of(
        prbs,
        order=order,
        dt=dt,
        hold=hold,
        highest_hz=highest_hz and float(highest_hz),
        taps=nested if decorrelate == "sequences" else nested[0],
        inverse_repeat=inverse_repeat,
        decorrelate=decorrelate,
        amplitude=levels,
        offset=offsets,
        band_limit_hz=band_limit_hz,
        channels=[str(c) for c in named],
        periods=periods,
        duration_s=None if duration_s is None else float(duration_s),
        seed=seed,
        state=state,
        shifts=shifts,
        signs=signs,
        modulation=rows.tolist(),
        clock_hz=1 / (hold * dt),
        rms=rms,
        period_samples=period,
        usable_response_chips=spacing,
        usable_response_s=spacing * hold * dt,
        cross_correlation=_cross_correlation(order, polynomials, rows, decorrelate),
        product_lag_chips=None if factor > 1 else product_lag,
        warnings=_clock_warning(highest_hz, dt) + _cut_warning(wanted, period, dt),
    )
    return Signal(u, dt, named, period if wanted >= period else None, recipe)


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


def _taps(order: int, taps: object, count: int, decorrelate: str) -> list[tuple[int, ...]]:
    """Return the primitive tap sets: one a channel for different sequences, else one."""
    needed = count if decorrelate == "sequences" else 1
    if taps is None:
        if needed == 1:
            return [TAPS[order]]
        if order > lfsr.MAX_PAIR_ORDER:
            remedy = (
                f"different sequences are chosen up to order {lfsr.MAX_PAIR_ORDER}; give taps, or use shift or hadamard"
            )
            raise check.bad("order", order, remedy)
        if lfsr.polynomials(order) < count:
            remedy = f"order {order} has only {lfsr.polynomials(order)} primitive polynomials; raise the order"
            raise check.bad("channels", count, remedy)
        return list(lfsr.least_correlated(order, TAPS[order], count))
    taps = check.items("taps", taps, f"give a list of whole numbers from 1 to {order - 1}")
    sets = [_primitive(order, each) for each in (taps if isinstance(taps[0], Sequence) else [taps])]
    if len({frozenset(each) for each in sets}) != needed or len(sets) != needed:
        remedy = f"give {needed} different lists" if needed > 1 else "give one list"
        raise check.bad("taps", taps, f"{remedy} for {count} channels decorrelated by {decorrelate}")
    return sets


def _primitive(order: int, taps: object) -> tuple[int, ...]:
    whole = isinstance(taps, Sequence) and all(
        isinstance(t, (int, np.integer)) and not isinstance(t, bool) for t in taps
    )
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


def _cross_correlation(order: int, polynomials: list, rows: np.ndarray, decorrelate: str) -> float | None:
    if len(rows) == 1 or (decorrelate == "sequences" and order > lfsr.MAX_PAIR_ORDER):
        return None
    if decorrelate == "sequences":
        return lfsr.cross_correlation(order, polynomials)
    return (1.0 if decorrelate == "shift" else lfsr.row_correlation(rows)) / (2**order - 1)


def _clock_warning(highest_hz: float | None, dt: float) -> list[str]:
    if highest_hz is None or CLOCK * highest_hz * dt <= 1 + 1e-12:
        return []
    ratio = 1 / (highest_hz * dt)
    return [
        f"the clock, {1 / dt:g} Hz at one sample a chip, is only {ratio:.3g} x highest_hz; sample faster to reach {CLOCK}"
    ]


def _cut_warning(samples: int, period: int, dt: float) -> list[str]:
    whole, rest = divmod(samples, period)
    if not rest:
        return []
    played = f"{samples} samples ({samples * dt:g} s) are {samples / period:.4g} periods of {period} samples"
    lost = f"beyond {whole} whole, {rest} samples are left over" if whole else "not one is complete"
    return [f"{played}: {lost}, so the flat lines and the -1/M correlation hold only approximately"]
