"""Persistency of excitation: what order a signal has, with what margin, and where its spectrum is empty."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la

from excite.arguments import is_whole, one_per_channel
from excite.errors import ExciteError
from excite.numerics.hankel import columns_of, hankel_factor, largest_rows
from excite.persistency.rank import EMPTY_LINE, line_vectors, line_weights, order_of_lines, order_of_recurrence
from excite.types.experiment import Experiment
from excite.types.signal import Signal

RANK_TOLERANCE = 1e-10  # singular values of the scaled factor above this fraction of the largest are no rounding

Data = Signal | Experiment | Sequence[Experiment]


@dataclass(frozen=True)
class Certificate:
    """What a signal excites.

    order : largest s for which the block-Hankel matrix with s block rows has full row rank, the algebraic order, sought
    up to block_rows; block_rows : the order asked about; reached : order >= block_rows; margin : smallest singular value
    of the block-Hankel matrix over sqrt(columns), in units of the channels' rms; condition : largest over smallest
    singular value of the same matrix; line_order : order of one period repeated for ever, by its spectral lines (None
    when not periodic; with several channels sought up to block_rows; where measured periods differ, by the lines that
    stand above that noise); lines : spectral lines on the full circle that some
    channel excites; missing_hz : bands without excitation up to Nyquist; usable_response_s : how long responses to
    shifted channels stay apart, or None; warnings : what to know before playing.

    noise_floor : standard deviation of what is not excitation in each channel, in its unit; floor_source : "given",
    "periods" (differences between repeated periods) or "rounding"; order_above_floor : largest s whose smallest singular
    value, every channel measured in units of its floor, over sqrt(columns) exceeds 1; margin_over_floor : that number for
    the block rows certified.
    """

    order: int
    block_rows: int
    reached: bool
    margin: float
    condition: float
    line_order: int | None
    missing_hz: tuple[tuple[float, float], ...]
    channels: tuple[str, ...]
    rms: tuple[float, ...]
    peak: tuple[float, ...]
    dt: float
    samples: int
    usable_response_s: float | None = None
    warnings: tuple[str, ...] = ()
    lines: int | None = None
    noise_floor: tuple[float, ...] = ()
    floor_source: str = "rounding"
    order_above_floor: int = 0
    margin_over_floor: float = 0.0

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        plain = asdict(self)
        plain["condition"] = self.condition if np.isfinite(self.condition) else None
        return plain


@dataclass(frozen=True)
class Verdict:
    """Whether an excitation is enough for one method.

    status : "yes", "yes, with a warning", "no" or "not known"; text : one sentence with the numbers.
    """

    name: str
    status: str
    order: int
    required: int
    sufficient: int
    margin: float
    text: str

    @property
    def ok(self) -> bool:
        """Whether the method can run (the necessary condition holds)."""
        return self.status.startswith("yes")

    def __str__(self) -> str:
        return self.text


def certify(data: Data, block_rows: int = 20, noise_floor: float | Sequence[float] | None = None) -> Certificate:
    """Certify the input of a signal or of experiments (side by side: collective persistency) up to `block_rows`.

    An input is persistently exciting of order s when the covariance of s successive samples is non-singular, that is,
    when its block-Hankel matrix with s block rows has full row rank s nu (Zaffalon and Hofmann, System Identification,
    ETH Zurich 2024, 4.0.4; several records: van Waarde et al., IEEE L-CSS 4, 2020). The order comes from the
    well-conditioned one of three views: the triangular factor of the Hankel matrix (from its Gram matrix; by QR where
    that would lose the small singular values), the spectral lines of a period, or a tall Hankel matrix
    (`excite.persistency.rank`).

    Parameters
    ----------
    data : Signal, Experiment, or several experiments; without missing samples, uniformly sampled.
    block_rows : the order s asked about.
    noise_floor : standard deviation of noise in the channels' units, one number or one per channel. None: estimated from
        the differences between whole periods when the data repeat, else what rounding may be, RANK_TOLERANCE of the rms.

    Raises
    ------
    ExciteError naming the value and the remedy.
    """
    records = [data] if isinstance(data, (Signal, Experiment)) else list(data)
    if not is_whole(block_rows) or block_rows < 1:
        raise ExciteError(f"certify: block_rows {block_rows!r}; give a whole number of at least 1")
    if not records:
        raise ExciteError("certify: no record given; pass at least one")
    segments = [np.asarray(r.u) for r in records]
    if any(np.isnan(u).any() for u in segments):
        raise ExciteError("certify: the input has missing samples (NaN); certify the gap-free parts together")
    first = records[0]
    if first.dt is None:
        raise ExciteError("certify: the sampling is not uniform; resample the input first")
    nu = segments[0].shape[1]
    if any(u.shape[1] != nu for u in segments):
        raise ExciteError(f"certify: records of {[u.shape[1] for u in segments]} channels; pass like with like")
    rows = min(block_rows, max(1, largest_rows(segments)))
    recipe = first.recipe if isinstance(first, Signal) else None
    warnings = [] if recipe is None else list(recipe.warnings)
    if rows < block_rows:
        warnings.append(
            f"{sum(map(len, segments))} samples of {nu} channels allow at most {rows} block rows; "
            f"{block_rows} were asked for: play longer"
        )
    joined = np.vstack(segments)
    rms = np.sqrt((joined**2).mean(0))
    period = first.period if len(records) == 1 and first.period and len(joined) >= first.period else None
    floor, source = _floor(noise_floor, joined, period, rms)
    factor, columns = _factor(segments, rows, rms), columns_of(segments, rows)
    s = la.svdvals(factor)
    lines = None
    if period is not None:
        noise = floor / np.sqrt(len(joined) // period) if source == "periods" else 0.0
        lines = line_vectors(_mean_period(joined, period), noise)
    order, line_order, notes = _orders(segments, rows, block_rows, rms, s, lines, period)
    in_floors = factor * np.tile(rms / floor, rows)[:, None] / np.sqrt(columns)
    channels = first.channels if isinstance(first, Signal) else first.inputs
    return Certificate(
        order=order,
        block_rows=int(block_rows),
        reached=order >= block_rows,
        margin=float(s[-1] / np.sqrt(columns)),
        condition=float(s[0] / s[-1]) if s[-1] > 0 else float("inf"),
        line_order=line_order,
        missing_hz=_missing(segments, period, first.dt),
        channels=tuple(map(str, channels)),
        rms=tuple(rms.tolist()),
        peak=tuple(np.abs(joined).max(0).tolist()),
        dt=first.dt,
        samples=len(joined),
        usable_response_s=None if recipe is None else recipe.get("usable_response_s"),
        warnings=(*warnings, *notes),
        lines=None if lines is None or period is None else int(line_weights(period)[np.any(lines != 0, axis=1)].sum()),
        noise_floor=tuple(floor.tolist()),
        floor_source=source,
        order_above_floor=_largest(lambda n: la.svdvals(in_floors[: n * nu, : n * nu])[-1] > 1, rows),
        margin_over_floor=float(la.svdvals(in_floors)[-1]),
    )


def verdict(
    data: Certificate | Data,
    name: str,
    required: int,
    sufficient: int | None = None,
    noise_floor: float | Sequence[float] | None = None,
) -> Verdict:
    """Say whether an excitation is enough for a method: a necessary condition refuses, a sufficient one warns.

    name : how the reader knows the method, such as "po_moesp with 20 block rows and order 6"; required : order without
    which the estimate does not exist; sufficient : order that guarantees it, `required` when not given. A certificate is
    taken as it is; data are certified for both orders, and the margin is that of `required` block rows.
    """
    sufficient = required if sufficient is None else sufficient
    for key, value in (("required", required), ("sufficient", sufficient)):
        if not is_whole(value) or value < 0:
            raise ExciteError(f"verdict: {key} {value!r}; give a whole number from 0")
    if isinstance(data, Certificate):
        own = whole = data
    else:
        whole = certify(data, max(sufficient, required, 1), noise_floor)
        own = whole if required in (0, whole.block_rows) else certify(data, required, noise_floor)
    order = max(whole.order, own.order)
    if order < min(required, whole.block_rows):
        status, why = "no", f"order {order} < {required}"
    elif order < required:
        status, why = "not known", f"certified up to order {order} only; certify with block_rows = {required}"
    else:
        doubts = []
        if order < sufficient:
            known = "has order" if order < whole.block_rows else "is certified up to order"
            doubts.append(f"order {sufficient} would suffice, the input {known} {order}")
        if own.order_above_floor < min(required, own.block_rows):
            doubts.append(f"only order {own.order_above_floor} stands above the noise floor ({own.floor_source})")
        status = "yes, with a warning" if doubts else "yes"
        why = "; ".join([*doubts, f"margin {own.margin:.3g} of the rms, condition {own.condition:.3g}"])
    separator = ": " if status == "yes, with a warning" else ", "
    text = f"enough for {name}: {status}{separator}{why}"
    return Verdict(name, status, int(order), int(required), int(sufficient), own.margin, text)


def _factor(segments: Sequence[np.ndarray], rows: int, rms: np.ndarray) -> np.ndarray:
    """Triangular factor of the block-Hankel matrix with every channel scaled to unit rms."""
    return hankel_factor([u / np.where(rms > 0, rms, 1.0) for u in segments], rows).L


def _full_rank(s: np.ndarray) -> bool:
    return bool(s[0] > 0 and s[-1] > RANK_TOLERANCE * s[0])


def _orders(
    segments: Sequence[np.ndarray],
    rows: int,
    asked: int,
    rms: np.ndarray,
    s: np.ndarray,
    lines: np.ndarray | None,
    period: int | None,
) -> tuple[int, int | None, list[str]]:
    """Order of the record, order of its period repeated for ever (None without one), and what stays in doubt."""
    nu, line_order, by_lines = segments[0].shape[1], None, None
    notes: list[str] = []
    if lines is not None and period is not None:
        asked = min(asked, period)  # no sequence excites beyond its period
        played = _mean_period(segments[0], period)
        wrapped = np.resize(played, (period + asked - 1, nu))
        if nu > 1 and period >= asked * nu and _full_rank(la.svdvals(_factor([wrapped], asked, rms))):
            line_order = asked
        else:
            by_lines = order_of_lines(lines, period, period if nu == 1 else asked)
            line_order = by_lines.order
    if _full_rank(s):
        return rows, line_order, notes
    exact = None
    if by_lines is not None and period is not None and _repeats(segments[0], period):
        # a Vandermonde matrix of L lines over L samples is regular: the record's columns span what the period's do
        if columns_of(segments, rows) >= int(line_weights(period)[np.any(lines != 0, axis=1)].sum()):
            exact = by_lines
    exact = exact or order_of_recurrence(segments, rows)
    if exact is None:
        order = _largest(lambda n: _full_rank(la.svdvals(_factor(segments, n, rms))), rows)
        shared = "its channels may be dependent, or too alike for double precision to tell"
        return (
            order,
            line_order,
            [f"order {order} is proven; beyond it the input matrix is singular to rounding: {shared}"],
        )
    if not exact.exact:
        notes.append(
            f"order {exact.order} is proven; up to {min(exact.ceiling, rows)} it cannot be decided in double precision "
            "(frequencies too close for this length): play longer, or sample more slowly"
        )
    return min(exact.order, rows), line_order, notes


def _largest(holds: Callable[[int], bool], most: int) -> int:
    """Largest n from 0 to `most` for which `holds(n)`, true up to it and false beyond, by bisection."""
    if holds(most):
        return most
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _mean_period(u: np.ndarray, period: int) -> np.ndarray:
    """Average of the whole periods, (period, nu); exactly the first where they are alike."""
    if _repeats(u, period):
        return u[:period]
    whole = len(u) // period * period
    return u[:whole].reshape(-1, period, u.shape[1]).mean(0)


def _repeats(u: np.ndarray, period: int) -> bool:
    """Whether the record equals its first period, repeated, to the size of an empty line."""
    return bool((np.abs(u[period:] - u[:-period]).max(0, initial=0) <= EMPTY_LINE * np.abs(u).max(0)).all())


def _floor(
    given: float | Sequence[float] | None, u: np.ndarray, period: int | None, rms: np.ndarray
) -> tuple[np.ndarray, str]:
    """Noise standard deviation of each channel, never below rounding, and where it comes from."""
    rounding = RANK_TOLERANCE * np.where(rms > 0, rms, 1.0)
    if given is not None:
        floor = one_per_channel(
            given, "certify: noise_floor", len(rms), lambda x: x >= 0, "a standard deviation is at least 0"
        )
        return np.maximum(floor, rounding), "given"
    if period is not None and len(u) >= 2 * period:
        spread = (u[period:] - u[:-period]).std(0) / np.sqrt(2)
        if (spread > rounding).any():
            return np.maximum(spread, rounding), "periods"
    return rounding, "rounding"


def _missing(segments: Sequence[np.ndarray], period: int | None, dt: float) -> tuple[tuple[float, float], ...]:
    """Bands (from, to) in Hz, up to Nyquist, whose power density is below 1e-3 of the mean density."""
    u = max(segments, key=len)
    length = period or len(u)
    power = (np.abs(np.fft.rfft(u[:length] - u[:length].mean(0), axis=0)) ** 2)[1:]
    bins = min(64, len(power))
    if bins < 2:
        return ()
    power = (power / np.maximum(power.mean(0), np.finfo(float).tiny)).max(1)
    edges = np.linspace(0, len(power), bins + 1).astype(int)
    density = np.array([power[a:b].mean() for a, b in pairwise(edges)])
    empty = np.concatenate([[False], density < 1e-3, [False]])
    starts, stops = np.flatnonzero(~empty[:-1] & empty[1:]), np.flatnonzero(empty[:-1] & ~empty[1:])
    hz = edges / (length * dt)
    return tuple((float(hz[a]), float(hz[b])) for a, b in zip(starts, stops, strict=True))
