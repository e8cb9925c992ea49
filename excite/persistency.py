"""Persistency of excitation: what order a signal has, with what margin, and where its spectrum is empty."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.hankel import columns_of, hankel_factor
from excite.types.experiment import Experiment
from excite.types.signal import Signal

RANK_TOLERANCE = 1e-10  # singular values of the scaled factor below this fraction of the largest are rounding
EMPTY_LINE = 1e-9  # spectral lines below this fraction of the largest are empty


@dataclass(frozen=True)
class Certificate:
    """What a signal excites.

    order : largest s for which the block-Hankel matrix with s block rows has full row rank (sought up to block_rows,
    and for one period of a periodic single-channel signal exactly, by counting spectral lines);
    block_rows : the order asked about; reached : order >= block_rows; margin : smallest singular value of the scaled
    block-Hankel matrix over sqrt(columns), in units of the channels' rms; condition : largest over smallest singular value;
    line_order : spectral lines of one period (None when not periodic); missing_hz : bands without excitation up to Nyquist;
    usable_response_s : how long responses to shifted channels stay apart, or None; warnings : what to know before playing.
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

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        plain = asdict(self)
        plain["condition"] = self.condition if np.isfinite(self.condition) else None
        return plain


def certify(data: Signal | Experiment | Sequence[Experiment], block_rows: int = 20) -> Certificate:
    """Certify the input of a signal or of experiments (side by side: collective persistency) up to `block_rows`.

    The u of order s must make the covariance of s successive samples non-singular (seed 002, 4.0.4). Singular values
    come from the triangular factor of the block-Hankel matrix; where the Gram path is too ill-conditioned to tell, the
    factor is from a QR decomposition.
    """
    records = [data] if isinstance(data, (Signal, Experiment)) else list(data)
    if isinstance(block_rows, bool) or not isinstance(block_rows, (int, np.integer)) or block_rows < 1:
        raise ExciteError(f"certify: block_rows {block_rows!r}; give a whole number of at least 1")
    segments = [np.asarray(r.u) for r in records]
    if any(np.isnan(u).any() for u in segments):
        raise ExciteError("certify: the input has missing samples (NaN); certify the gap-free parts together")
    first = records[0]
    if first.dt is None:
        raise ExciteError("certify: the sampling is not uniform; resample the input first")
    nu = segments[0].shape[1]
    rows = block_rows
    while rows > 1 and columns_of(segments, rows) < rows * nu:
        rows -= 1
    s = _singular_values(segments, rows)
    order = rows if _full_rank(s) else _largest_order(segments, rows)
    warnings = list(getattr(first, "recipe", {}).get("warnings", ()))
    if rows < block_rows:
        warnings.append(
            f"{sum(map(len, segments))} samples of {nu} channels allow at most {rows} block rows; "
            f"{block_rows} were asked for: play longer"
        )
    period = first.period if len(records) == 1 else None
    joined = np.vstack(segments)
    channels = first.channels if isinstance(first, Signal) else first.inputs
    return Certificate(
        order=order, block_rows=int(block_rows), reached=order >= block_rows,
        margin=float(s[-1] / np.sqrt(columns_of(segments, rows))),
        condition=float(s[0] / s[-1]) if s[-1] > 0 else float("inf"),
        line_order=_line_count(segments[0], period), missing_hz=_missing(segments, period, first.dt),
        channels=tuple(map(str, channels)), rms=tuple(np.sqrt((joined**2).mean(0)).tolist()),
        peak=tuple(np.abs(joined).max(0).tolist()), dt=first.dt, samples=len(joined),
        usable_response_s=getattr(first, "recipe", {}).get("usable_response_s"), warnings=tuple(warnings),
    )  # fmt: skip


def _singular_values(segments: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """Singular values of the block-Hankel matrix with every channel scaled to unit rms."""
    rms = np.sqrt(sum((u**2).sum(0) for u in segments) / sum(map(len, segments)))
    rms[rms == 0] = 1.0
    return la.svdvals(hankel_factor([u / rms for u in segments], rows).L)


def _full_rank(s: np.ndarray) -> bool:
    return s[0] > 0 and s[-1] > RANK_TOLERANCE * s[0]


def _largest_order(segments: Sequence[np.ndarray], rows: int) -> int:
    """Largest order below `rows` with full row rank, by bisection (full rank at s implies it below s)."""
    low, high = 0, rows
    while high - low > 1:
        middle = (low + high) // 2
        if _full_rank(_singular_values(segments, middle)):
            low = middle
        else:
            high = middle
    return low


def _lines(u: np.ndarray, period: int | None) -> np.ndarray | None:
    """Largest line amplitude over the channels, (period // 2 + 1,), each channel relative to its largest line."""
    if period is None or len(u) < period:
        return None
    lines = np.abs(np.fft.rfft(u[:period], axis=0))
    return (lines / np.maximum(lines.max(0), np.finfo(float).tiny)).max(1)


def _line_count(u: np.ndarray, period: int | None) -> int | None:
    """Order of one channel by counting lines: two for each in (0, pi), one at 0 and at pi (seed 002, 4.0.4)."""
    lines = _lines(u, period)
    if lines is None:
        return None
    full = lines > EMPTY_LINE
    edges = int(full[0]) + (int(full[-1]) if period % 2 == 0 else 0)
    inner = full[1:-1] if period % 2 == 0 else full[1:]
    return 2 * int(inner.sum()) + edges


def _missing(segments: Sequence[np.ndarray], period: int | None, dt: float) -> tuple[tuple[float, float], ...]:
    """Bands (from, to) in Hz, up to Nyquist, whose power density is below 1e-3 of the mean density."""
    u = max(segments, key=len)
    length = period if period and len(u) >= period else len(u)
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
