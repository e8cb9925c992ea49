"""Pseudo-random binary sequences of maximum length."""

from collections.abc import Sequence
from functools import cache
from itertools import combinations

import numpy as np
from scipy.signal import max_len_seq

from excite.errors import ExciteError
from excite.types.channel import Channel, channels_for
from excite.types.signal import Signal

# Order n -> taps t of s(k+n) = s(k) + sum s(k+t) mod 2: the table of scipy.signal.max_len_seq, which names New Wave
# Instruments' list of m-sequence feedback taps (first entry of each length) as its source. The tests prove every
# polynomial primitive. Other lists, such as Xilinx XAPP052, differ for some orders and serve equally.
TAPS: dict[int, tuple[int, ...]] = {
    2: (1,), 3: (2,), 4: (3,), 5: (3,), 6: (5,), 7: (6,), 8: (7, 6, 1), 9: (5,), 10: (7,), 11: (9,),
    12: (11, 10, 4), 13: (12, 11, 8), 14: (13, 12, 2), 15: (14,), 16: (15, 13, 4), 17: (14,), 18: (11,),
    19: (18, 17, 14), 20: (17,), 21: (19,), 22: (21,), 23: (18,), 24: (23, 22, 17), 25: (22,), 26: (25, 24, 20),
    27: (26, 25, 22), 28: (25,), 29: (27,), 30: (29, 28, 7), 31: (28,), 32: (31, 30, 10),
}  # fmt: skip
MAX_VALUES = 2 * 10**8
MAX_ZECH_ORDER = 14


def prbs(
    order: int | None = None,
    *,
    dt: float,
    hold: int = 1,
    amplitude: float | Sequence[float] = 1.0,
    channels: int | str | Channel | Sequence[str | Channel] = 1,
    periods: int | None = None,
    duration_s: float | None = None,
    seed: int = 0,
) -> Signal:
    """Return a maximum-length binary sequence, one circular shift of it a channel.

    A shift register with primitive feedback polynomial of degree n runs through all M = 2^n - 1 non-zero states, so its
    bits, mapped to s = +1 and -1, have the circular autocorrelation

        (1/M) sum_k s(k) s(k + l) = 1 for l = 0 mod M, -1/M otherwise,

    hence the mean +1/M or -1/M and M - 1 other lines of one size, |S(f)| / M = sqrt(M + 1) / M. The sequence is
    persistently exciting of order M. Holding each chip for `hold` samples multiplies the spectrum by
    |sin(pi f / f_clock) / (hold sin(pi f dt))| with f_clock = 1 / (hold dt): -2.3 dB at 0.4 f_clock, so clock at about
    2.5 times the highest frequency of interest.

    Channel c plays the sequence `shifts[c]` chips ahead, the shifts being multiples of one spacing. Two channels
    correlate with +1/M or -1/M, except at the lag that aligns them; so impulse responses up to the spacing separate
    (`usable_response_s` in the recipe). The product of two channels is itself a shift of the sequence (shift and add),
    so a product nonlinearity of the plant looks like a delayed linear response; with the spacing M/3 of three channels
    it even is the third channel. The spacing, at most M / channels, is therefore the one that puts the aligned product
    of any two channels farthest behind every channel (`product_lag_chips`).

    Parameters
    ----------
    order : degree n, 2 to 32. None: the largest whose period fits into `duration_s`.
    dt : sampling time, s.
    hold : samples per chip, at least 1.
    amplitude : levels are +amplitude and -amplitude, in the channels' units; one number, or one a channel.
    channels : their count, or their names with units such as ``["roll_ref [deg]", "pitch_ref [deg]"]``.
    periods : whole periods to play, default 1.
    duration_s : length in s, instead of `periods`; the signal is cut there, and when that is not a whole number of
        periods a `warnings` entry says what is lost.
    seed : whole number from 0. It draws the start state, which channel gets which shift, and the sign of each channel:
        a fresh realisation with the same autocorrelation, one of M c! 2^c for c channels. One channel's realisations
        are circular shifts of one sequence and of its negative.

    Returns
    -------
    Signal with u (N, channels), period = M hold samples (None when less than one period is played), and the recipe: the
    parameters above and the decisions kind, taps, state, shifts, signs, period_samples, usable_response_chips,
    usable_response_s, product_lag_chips, warnings. All of it is JSON; `regenerate(recipe)` returns the same bits.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Golomb, Shift Register Sequences, 1967 (properties); Söderström and Stoica, System Identification, 1989, chapter 5
    (autocorrelation, persistency of excitation).
    """
    dt = _positive("dt", dt)
    hold = _whole("hold", hold, 1)
    seed = _whole("seed", seed, 0)
    if isinstance(channels, (int, np.integer)):
        count, names = _whole("channels", channels, 1), None
    else:
        names = [channels] if isinstance(channels, (str, Channel)) else list(channels)
        count = len(names)
        if not names:
            raise _bad("channels", channels, "name at least one")

    if periods is not None and duration_s is not None:
        raise _bad("periods", periods, f"duration_s = {duration_s!r} is given too; give one of the two")
    wanted = None if duration_s is None else _samples(duration_s, dt)
    if order is None:
        if wanted is None:
            raise _bad("order", order, "give a whole number from 2 to 32, or duration_s to have it chosen")
        fitting = [n for n in TAPS if (2**n - 1) * hold <= wanted]
        if not fitting:
            raise _bad("duration_s", duration_s, f"the shortest period takes {3 * hold * dt:g} s; play longer")
        order = fitting[-1]
    order = _whole("order", order, 2)
    if order not in TAPS:
        raise _bad("order", order, f"orders from 2 to {max(TAPS)} are known")
    length = 2**order - 1
    if count > length:
        raise _bad("channels", count, f"order {order} has only {length} distinct shifts; raise the order")
    period = length * hold
    if wanted is None:
        periods = _whole("periods", 1 if periods is None else periods, 1)
        wanted = periods * period
    if wanted * count > MAX_VALUES:
        remedy = "lower order, hold, periods or channels, or cut with duration_s"
        raise _bad("order", order, f"{wanted} samples x {count} channels exceed {MAX_VALUES} values; {remedy}")

    levels = _amplitudes(amplitude, count)
    named = channels_for(count, names, "u")
    spacing, product_lag = _spacing(order, count)
    state, shifts, signs = _draw(seed, length, count, spacing)
    register = np.array([state >> bit & 1 for bit in range(order)])
    u = np.empty((wanted, count))
    for c in range(count):
        start = _advance(register, TAPS[order], shifts[c])
        bits, _ = max_len_seq(order, state=start, length=min(length, -(-wanted // hold)), taps=TAPS[order])
        high = signs[c] * levels[c]
        u[:, c] = np.resize(np.repeat(np.array([-high, high])[bits], hold), wanted)

    recipe = {
        "kind": "prbs", "order": order, "dt": dt, "hold": hold, "amplitude": levels,
        "channels": [str(c) for c in named], "periods": periods,
        "duration_s": None if duration_s is None else float(duration_s), "seed": seed,
        "taps": list(TAPS[order]), "state": state, "shifts": shifts, "signs": signs, "period_samples": period,
        "usable_response_chips": spacing, "usable_response_s": spacing * hold * dt, "product_lag_chips": product_lag,
        "warnings": _cut_warning(wanted, period, dt),
    }  # fmt: skip
    return Signal(u, dt, named, period if wanted >= period else None, recipe)


@cache
def _spacing(order: int, count: int) -> tuple[int, int | None]:
    """Return the spacing of the shifts and the least lag, in chips, of a product of two channels behind a channel.

    s(k) + s(k + d) = s(k + z(d)) over GF(2) (Zech's logarithm z, read from the register's states); up to order
    `MAX_ZECH_ORDER` all spacings are tried, beyond it the spacing just avoids dividing M.
    """
    length = 2**order - 1
    if count < 2:
        return length, None
    if order > MAX_ZECH_ORDER:
        return (length - 1) // count, None
    bits = max_len_seq(order, taps=TAPS[order])[0].astype(np.int64)
    windows = np.lib.stride_tricks.sliding_window_view(np.resize(bits, length + order - 1), order)
    register = windows @ (1 << np.arange(order))
    index = np.empty(length + 1, dtype=np.int64)
    index[register] = np.arange(length)
    zech = index[register[0] ^ register[1:]]
    spacings = np.arange(max(1, length // (2 * count)), length // count + 1)
    lags = np.full(len(spacings), length)
    for i, j in combinations(range(count), 2):
        product = i * spacings + zech[(j - i) * spacings - 1]
        for channel in range(count):
            lags = np.minimum(lags, (channel * spacings - product) % length)
    best = np.lexsort((spacings, np.minimum(lags, spacings)))[-1]
    return int(spacings[best]), int(lags[best])


def _draw(seed: int, length: int, count: int, spacing: int) -> tuple[int, list[int], list[int]]:
    """Return start state, shift and sign of each channel; raw SeedSequence words, whose stream NumPy keeps fixed."""
    words = np.random.SeedSequence(seed).generate_state(1 + 2 * count, np.uint64)
    order = np.argsort(words[1 : 1 + count], kind="stable")
    shifts = [int(k) * spacing for k in order]
    return 1 + int(words[0]) % length, shifts, [1 if word & np.uint64(1) else -1 for word in words[1 + count :]]


def _advance(register: np.ndarray, taps: tuple[int, ...], chips: int) -> np.ndarray:
    """Return the register `chips` steps later, by repeated squaring of the companion matrix over GF(2)."""
    step = np.eye(len(register), k=1, dtype=int)
    step[-1, [0, *taps]] = 1
    while chips:
        if chips & 1:
            register = step @ register % 2
        step = step @ step % 2
        chips >>= 1
    return register


def _cut_warning(samples: int, period: int, dt: float) -> list[str]:
    whole, rest = divmod(samples, period)
    if not rest:
        return []
    played = f"{samples} samples ({samples * dt:g} s) are {samples / period:.4g} periods of {period} samples"
    lost = f"beyond {whole} whole, {rest} samples are left over" if whole else "not one is complete"
    return [f"{played}: {lost}, so the flat lines and the -1/M correlation hold only approximately"]


def _bad(name: str, value: object, remedy: str) -> ExciteError:
    return ExciteError(f"prbs: {name}: {value!r}; {remedy}")


def _whole(name: str, value: object, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise _bad(name, value, f"give a whole number of at least {least}")
    return int(value)


def _positive(name: str, value: object) -> float:
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not (number and 0 < value < np.inf):
        raise _bad(name, value, "give a positive number of seconds")
    return float(value)


def _samples(duration_s: object, dt: float) -> int:
    ratio = _positive("duration_s", duration_s) / dt
    if not 0.5 < ratio < 2**53:
        raise _bad("duration_s", duration_s, f"it must span at least one sample of dt = {dt:g} s, and fewer than 2^53")
    return round(ratio)


def _amplitudes(amplitude: object, count: int) -> list[float]:
    try:
        levels = np.asarray(amplitude, dtype=np.float64)
    except (TypeError, ValueError):
        raise _bad("amplitude", amplitude, "give a positive number, or one a channel") from None
    if levels.shape not in ((), (1,), (count,)):
        raise _bad("amplitude", amplitude, f"give one number, or one for each of the {count} channels")
    if not (np.isfinite(levels) & (levels > 0)).all():
        raise _bad("amplitude", amplitude, "every amplitude must be positive and finite")
    return np.broadcast_to(levels, count).tolist()
