"""Shape a signal to the limits of the hardware with the least loss of information."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from excite.errors import DesignRefused, ExciteError
from excite.limits.limits import ROUNDING, LimitReport, Limits, check, lost_power
from excite.limits.program import HALF_TAPS, Bounds, nearest
from excite.numerics.hankel import columns_of, hankel_factor
from excite.persistency.certificate import Certificate, certify
from excite.types.recipe import Recipe
from excite.types.signal import Signal

GONE_DB = -60.0  # a channel left with less power than this was not shaped but silenced
ROUNDS = 40


@dataclass(frozen=True)
class Loss:
    """What shaping cost, after against before; None where there was nothing to compare.

    power_db : power about the mean, one per channel; mean_line_db, worst_line_db : power of the excited lines (those within
    40 dB of a channel's largest), together and the worst one; log_det : change of log det of the information matrix of an
    impulse response of `block_rows` lags, per parameter; margin : ratio of the smallest singular values.
    """

    power_db: tuple[float, ...]
    mean_line_db: float | None
    worst_line_db: float | None
    log_det: float | None
    margin: float | None


@dataclass(frozen=True, eq=False)
class Shaped:
    """A signal that keeps its limits, and what that cost.

    signal : what will be played; before, after : checks of every limit; certificate : of what will be played, after
    quantisation; loss : of information; method : "unchanged", "projection" (clipping, rounding) or "quadratic program";
    bound : names of the limits that the given signal exceeded.
    """

    signal: Signal
    before: LimitReport
    after: LimitReport
    certificate: Certificate
    loss: Loss
    method: str
    bound: tuple[str, ...]

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        parts = {k: getattr(self, k).to_dict() for k in ("before", "after", "certificate")}
        return {"method": self.method, "bound": list(self.bound), "loss": asdict(self.loss), **parts}


def shape(signal: Signal, limits: Limits, band_hz: tuple[float, float] | None = None, block_rows: int = 20) -> Shaped:
    """Return the signal nearest to the given one that keeps every limit, with what that costs.

    Minimises ||F (u - u0)||^2 over the played values subject to low <= u <= high, |u(k+1) - u(k)| <= move and
    y_low <= y(u) <= y_high, F weighing the excited band above the rest (`excite.limits.program`): clipping where that is the
    minimiser, a sparse quadratic program otherwise. Held values and repeated periods are one variable each, so holds and
    periods survive. Lines of which the actuator takes too much are dropped first, lowest gain first.

    The program runs on bounds that rounding keeps: amplitudes on a level of the converter and moves of m whole steps,
    because round(x + m) = round(x) + m. Its last digits are then repaired by a contraction towards rest, which by
    convexity breaks no limit, and outputs leave room for what rounding adds. Report, certificate and loss are those of the
    rounded signal. A signal that keeps its limits is returned as it is, so shaping twice changes nothing.

    Parameters
    ----------
    band_hz : (from, to) where information matters; None: the band that holds 99 % of the signal's power.
    block_rows : order of the certificate and of the loss.

    Raises
    ------
    ExciteError for limits that no signal can keep, naming those that bind; DesignRefused when they leave a channel nothing.
    """
    before = check(signal, limits)
    if before.ok:
        return Shaped(
            signal, before, before, certify(signal, block_rows), _loss(signal, signal, block_rows), "unchanged", ()
        )
    bound = tuple(dict.fromkeys(c.limit for c in before.exceeded))
    bounds, levels, period = _bounds(signal, limits)
    budget = limits.lost_power
    for _ in range(ROUNDS):
        target = _through_actuator(signal, limits, bounds.index, budget)
        values, solved = nearest(target, bounds, _band(target, signal.dt * limits.hold, band_hz), _room(bounds, levels))
        shaped = replace(signal, u=_playable(values, bounds, levels)[bounds.index], period=period)
        after = check(shaped, limits)
        if after.ok or any(c.limit != "lost power" for c in after.exceeded):
            break
        budget *= 0.85  # clipping put power back beyond the actuator's reach
    loss = _loss(signal, shaped, block_rows)
    gone = [c.name for c, db in zip(signal.channels, loss.power_db, strict=True) if db < GONE_DB]
    if gone or not after.ok:
        what = f"leave channel '{gone[0]}' nothing" if gone else "cannot all be kept"
        worst = "; ".join(str(c) for c in (before if gone else after).exceeded[:4])
        raise (DesignRefused if gone else ExciteError)(f"limits: {', '.join(bound)} {what}: {worst}; widen what binds")
    method = "quadratic program" if solved else "projection"
    done = {"limits": limits.to_dict(), "band_hz": band_hz, "method": method}
    shaped = replace(shaped, recipe=replace(signal.recipe or Recipe("samples"), shaped=done))
    return Shaped(shaped, before, after, certify(shaped, block_rows), loss, method, bound)


def _bounds(signal: Signal, limits: Limits) -> tuple[Bounds, tuple[np.ndarray, np.ndarray] | None, int | None]:
    """Bounds on the free values that rounding keeps, the converter's (lowest level, step), and the period that stays."""
    names = [c.name for c in signal.channels]
    low, high = limits.bounds(signal)
    move, levels = limits.largest_move(signal), limits.levels(signal)
    if levels is not None and limits.bits is not None:
        base, step = levels
        first = np.ceil((np.maximum(low, base) - base) / step - ROUNDING)
        last = np.floor((np.minimum(high, base + step * (2**limits.bits - 1)) - base) / step + ROUNDING)
        whole = np.where(np.isfinite(move), np.floor(move / step + ROUNDING), np.inf)
        for i in np.flatnonzero(first > last):
            raise ExciteError(
                f"limits: channel '{names[i]}': no level of the converter (step {step[i]:g} from {base[i]:g}) lies within "
                f"{low[i]:g} to {high[i]:g}; widen the bounds or add bits"
            )
        for i in np.flatnonzero(whole == 0):
            raise ExciteError(
                f"limits: channel '{names[i]}': rate and move allow changes of {move[i]:g}, less than one step {step[i]:g} "
                f"of the converter ({limits.bits} bits); hold values longer, or add bits"
            )
        low, high, move = base + first * step, base + last * step, whole * step
    models = [o.model for o in limits.outputs]
    trims = [m.input_offset for m in models] or [np.zeros(len(names))]
    if any((t != trims[0]).any() for t in trims):
        raise ExciteError("limits: outputs: the models have different input offsets; limit outputs about one trim")
    sides = [np.array(o.bounds()) - o.model.output_offset for o in limits.outputs]
    y_low, y_high = np.hstack([np.empty((2, 0)), *sides])
    B, D = (np.vstack([np.empty((0, len(names))), *[getattr(m, k) for m in models]]) for k in "BD")
    model = block_diag(*[m.A for m in models]), B, block_diag(*[m.C for m in models]), D
    index, repeats = _free_values(signal, limits.hold)
    bounds = Bounds(index, repeats, low, high, move, trims[0], model, y_low, y_high)
    still = bounds.excess(bounds.outputs(np.tile(np.clip(bounds.rest, low, high), (index.max() + 1, 1))))
    outputs = [c.name for m in models for c in m.outputs]
    for i in np.flatnonzero(still > ROUNDING * np.maximum(-y_low, y_high)):
        raise ExciteError(
            f"limits: amplitude keeps the command off trim, and holding it at the nearest allowed value takes output "
            f"'{outputs[i]}' {still[i]:g} past its limit; let low and high include trim, or widen the output's limit"
        )
    return bounds, levels, signal.period if repeats else None


def _free_values(signal: Signal, hold: int) -> tuple[np.ndarray, bool]:
    """Which free value each sample plays, (N,), and whether whole periods repeat them."""
    N, M = len(signal.u), signal.period
    if M is None or N % M or M % hold:
        return np.arange(N) // hold, False
    if N > M and (np.abs(signal.u[M:] - signal.u[:-M]) > ROUNDING * np.abs(signal.u).max()).any():
        return np.arange(N) // hold, False
    return np.arange(N) % M // hold, True


def _through_actuator(signal: Signal, limits: Limits, index: np.ndarray, budget: float) -> np.ndarray:
    """Free values (n, nu): means of the samples they stand for, without lines of which the actuator takes too much."""
    counts = np.bincount(index)
    values = np.stack([np.bincount(index, column) for column in signal.u.T], axis=1) / counts[:, None]
    gain = limits.actuator_gain(signal, len(signal.u))
    if gain is None or (lost_power(values[index], gain) <= budget).all():
        return values
    lines, f_hz = np.fft.rfft(values, axis=0), np.fft.rfftfreq(len(values), signal.dt * limits.hold)
    fine = np.fft.rfftfreq(len(signal.u), signal.dt)
    for c in range(values.shape[1]):
        mine = np.interp(f_hz, fine, gain[:, c])
        power = np.abs(lines[:, c]) ** 2
        power[0] = 0.0
        order = np.argsort(-mine, kind="stable")
        kept = np.cumsum(power[order])
        within = (kept - np.cumsum((power * mine)[order]) <= budget * kept) & (kept > 1e-9 * kept[-1])
        if kept[-1] > 0 and not within.any():
            raise ExciteError(
                f"limits: lost power: the actuator takes more than {limits.lost_power:.0%} of every line of channel "
                f"'{signal.channels[c].name}'; excite below its bandwidth"
            )
        dropped = order[np.flatnonzero(within)[-1] + 1 :] if within.any() else order[:0]
        lines[dropped[dropped > 0], c] = 0.0
    return np.fft.irfft(lines, len(values), axis=0)


def _band(target: np.ndarray, step_s: float, band_hz: tuple[float, float] | None) -> tuple[float, float] | None:
    """Excited band in fractions of the Nyquist frequency of the values; None when it is nearly all there is."""
    if band_hz is not None:
        if len(band_hz) != 2 or not 0 <= band_hz[0] < band_hz[1]:
            raise ExciteError(f"shape: band_hz {band_hz!r}; give (from, to) in Hz with 0 <= from < to")
        low, high = (2 * step_s * f for f in band_hz)
    else:
        power = (np.abs(np.fft.rfft(target - target.mean(0), axis=0)) ** 2 / np.maximum(target.var(0), 1e-300)).sum(1)
        share = np.cumsum(power) / max(power.sum(), 1e-300)
        low, high = np.searchsorted(share, (0.005, 0.995)) / max(len(power) - 1, 1)
    if low >= 1:
        raise ExciteError(
            f"shape: band_hz {band_hz!r} lies above the Nyquist frequency {0.5 / step_s:g} Hz of the values played"
        )
    low, high = (
        (low if low > 1 / HALF_TAPS else 0.0),
        min(high + 0.5 / HALF_TAPS, 1.0),
    )  # the filter tells no finer bands
    return None if high - low > 0.8 else (float(low), float(high))


def _room(bounds: Bounds, levels: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """What rounding to the converter's levels may add to each output, (ny,): its largest response to one draw of it."""
    if levels is None or not len(bounds.y_low):
        return np.zeros(len(bounds.y_low))
    errors = levels[1] * (np.random.default_rng(0).random((bounds.index.max() + 1, len(bounds.rest))) - 0.5)
    return 1.2 * np.abs(bounds.outputs(errors + bounds.rest)).max(0)


def _playable(values: np.ndarray, bounds: Bounds, levels: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """Values that keep every bound exactly, on the converter's levels: clipped, contracted towards rest, rounded.

    Neither clipping nor contraction enlarges a move. Where rounding takes an output past its limit, the contraction
    leaves more room and is done again.
    """
    still = np.clip(bounds.rest, bounds.low, bounds.high)
    values = np.clip(values, bounds.low, bounds.high)
    largest = np.abs(bounds.moves(values)).max(0)
    shrink = np.minimum(1.0, bounds.move * (1 - 1e-12) / np.where(largest > 0, largest, 1.0))
    values = still + shrink * (values - still)
    y, y_still = bounds.outputs(values), bounds.outputs(np.broadcast_to(still, values.shape))
    room = np.zeros(len(bounds.y_low))
    for _ in range(ROUNDS):
        played = _rounded(still + _contraction(y, y_still, bounds, room) * (values - still), bounds, levels)
        excess = bounds.excess(bounds.outputs(played))
        if (excess <= 0).all():
            break
        room = 1.2 * room + 1.1 * np.maximum(excess, 0.0)
    return played


def _contraction(y: np.ndarray, y_still: np.ndarray, bounds: Bounds, room: np.ndarray) -> float:
    """Largest c in [0, 1] for which y_still + c (y - y_still) keeps `room` to the bounds."""
    c = 1.0
    for away, free in ((y - y_still, bounds.y_high - room - y_still), (y_still - y, y_still - bounds.y_low - room)):
        over = away > np.maximum(free, 0)
        if over.any():
            c = min(c, float((np.maximum(np.broadcast_to(free, away.shape)[over], 0) / away[over]).min()))
    return c


def _rounded(values: np.ndarray, bounds: Bounds, levels: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """Values on the nearest level of the converter; halves go up, so that moves of whole steps stay what they are."""
    if levels is None:
        return values
    base, step = levels
    return np.clip(base + step * np.floor((values - base) / step + 0.5), bounds.low, bounds.high)


def _loss(old: Signal, new: Signal, block_rows: int) -> Loss:
    """Information before and after, on the same lines and the same Hankel columns."""
    power = [np.abs(np.fft.rfft(s.u - s.u.mean(0), axis=0)) ** 2 for s in (old, new)]
    totals = [np.maximum(p.sum(0), 1e-300) for p in power]
    excited = power[0] > 1e-4 * power[0].max(0)
    mean = worst = log_det = margin = None
    if excited.any() and power[0].max() > 0:
        ratio = power[1][excited] / power[0][excited]
        mean, worst = _db(power[1][excited].sum() / power[0][excited].sum()), _db(ratio.min())
    rows, nu = block_rows, old.u.shape[1]
    while rows > 1 and columns_of([old.u], rows) < rows * nu:
        rows -= 1
    if columns_of([old.u], rows) >= rows * nu:
        rms = np.sqrt((old.u**2).mean(0))
        L = [hankel_factor([s.u / np.where(rms > 0, rms, 1.0)], rows).L for s in (old, new)]
        singular = [np.linalg.svd(l, compute_uv=False) for l in L]
        if min(s[-1] / max(s[0], 1e-300) for s in singular) > 1e-10:
            log_det = float(2 * (np.log(singular[1]) - np.log(singular[0])).mean())
            margin = float(singular[1][-1] / singular[0][-1])
    return Loss(tuple(_db(b / a) for a, b in zip(*totals, strict=True)), mean, worst, log_det, margin)


def _db(ratio: float) -> float:
    return float(10 * np.log10(max(ratio, 1e-300)))
