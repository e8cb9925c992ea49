"""Compressed block-Hankel data: a triangular factor L with H = L Q, Q Q^T = I, without forming H.

The Gram matrix H H^T has displacement structure, G[i+1, j+1] = G[i, j] - w(i) w(j)^T + w(M+i) w(M+j)^T, so its first
block row, which is a correlation, and M-independent updates give all of it; its Cholesky factor is L. Squaring the data
squares the condition, so when the factor's condition leaves what double precision can hold, a QR decomposition over
chunks takes over.
"""

from bisect import bisect_right
from collections.abc import Sequence, Sized
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.lib.stride_tricks import sliding_window_view

from excite.errors import ExciteError
from excite.numerics.correlation import Correlation, Segment, correlate

GRAM_CONDITION = 1e6  # beyond it the Gram form holds fewer than four digits of the smallest singular value
QR_VALUES = 131_072  # doubles of explicit Hankel columns decomposed at once, 1 MB (more where d columns need it)


@dataclass(frozen=True, eq=False)
class HankelFactor:
    """L (d, d) lower triangular with H = L Q for H (d, columns), d = rows * channels, row i*channels + a = w_a(t+i).

    The rows of H may be taken in another order, as `index` tells; order : that order, None for their own;
    condition : 1-norm condition estimate of L with unit-norm rows; path : "gram-cholesky" or "blocked-qr"; correlation : of
    the segments that have columns.
    """

    L: np.ndarray
    rows: int
    channels: int
    columns: int
    condition: float
    path: str
    correlation: Correlation
    order: np.ndarray | None = None

    def index(self, channel: slice | Sequence[int], start: int, stop: int) -> np.ndarray:
        """Where L has the given channels of block rows start:stop, time-major."""
        rows = block_rows(self.channels, channel, start, stop)
        return rows if self.order is None else self._place[rows]

    @cached_property
    def _place(self) -> np.ndarray:
        return np.arange(len(self.L)) if self.order is None else np.argsort(self.order)


def block_rows(channels: int, channel: slice | Sequence[int], start: int, stop: int) -> np.ndarray:
    """Row numbers in H of the given ones of `channels` in block rows start:stop, time-major."""
    return (np.arange(start, stop)[:, None] * channels + np.arange(channels)[channel]).ravel()


def columns_of(segments: Sequence[Sized], rows: int) -> int:
    """Number of Hankel columns that segments of data leave for `rows` block rows."""
    return sum(max(0, len(w) - rows + 1) for w in segments)


def hankel_factor(segments: Sequence[Segment], rows: int, order: np.ndarray | None = None) -> HankelFactor:
    """Compress the block-Hankel matrix of several segments (N_i, c), side by side, into its triangular factor.

    order (d,) : the rows of H in the order in which the factor is to be triangular; their own when not given.

    A segment is an array or whatever has its shape, length and slices (a memory map, an HDF5 dataset): it is read chunk
    after chunk, twice where the Gram form does not hold. Raises ExciteError when the data leave no more columns than
    there are rows, saying how many rows they allow.
    """
    channels = segments[0].shape[1]
    columns = columns_of(segments, rows)
    d = rows * channels
    if columns < d:
        raise ExciteError(
            f"{rows} block rows of {channels} channels need at least {d} Hankel columns, but {_lengths(segments)} leave "
            f"{columns}; the largest possible number of block rows is {largest_rows(segments)}"
        )
    segments = [w for w in segments if len(w) >= rows]
    correlation = correlate(segments, rows - 1)
    gram = hankel_gram(segments, correlation)
    L = cholesky(gram if order is None else gram[np.ix_(order, order)])
    if L is not None:
        condition, spread = condition_of(L), np.sqrt(np.diag(gram).reshape(rows, channels))
        if condition * (spread.max(0) / spread.min(0)).max() <= GRAM_CONDITION:
            return HankelFactor(L, rows, channels, columns, condition, "gram-cholesky", correlation, order)
    L = _blocked_qr(segments, rows, slice(None) if order is None else order)
    return HankelFactor(L, rows, channels, columns, condition_of(L), "blocked-qr", correlation, order)


def largest_rows(segments: Sequence[Segment]) -> int:
    """Largest number of block rows with at least as many columns as rows."""
    channels = segments[0].shape[1]
    return bisect_right(range(1, max(map(len, segments)) + 1), 0, key=lambda n: n * channels - columns_of(segments, n))


def hankel_gram(segments: Sequence[Segment], correlation: Correlation) -> np.ndarray:
    """Gram matrix H H^T (d, d) by displacement, H having a block row for each linear lag of the segments' correlation."""
    rows, c = correlation.linear.shape[:2]
    starts = np.array([w[: rows - 1] for w in segments], float)
    ends = np.array([w[len(w) - rows + 1 :] for w in segments], float)
    step = np.tensordot(ends, ends, (0, 0)) - np.tensordot(starts, starts, (0, 0))
    G = np.empty((rows, c, rows, c))
    G[0] = correlation.linear.transpose(1, 0, 2)
    if rows > 1:  # a column begins no later than `rows` samples before the end
        G[0, :, :-1] -= correlate(list(ends), rows - 2).linear.transpose(1, 0, 2)
    for i in range(rows - 1):
        np.add(G[i, :, :-1], step[i], out=G[i + 1, :, 1:])
        G[i + 1, :, 0] = G[0, :, i + 1].T
    return G.reshape(rows * c, rows * c)


def cholesky(gram: np.ndarray) -> np.ndarray | None:
    """Lower triangular factor of a symmetric matrix, None when it is not positive definite to rounding.

    By numpy's LAPACK, since matrix products use it too: threads of two BLAS libraries that wait for each other's turn
    cost tens of milliseconds.
    """
    try:
        L = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        return None
    return L if np.isfinite(L[-1, -1]) else None


def condition_of(L: np.ndarray) -> float:
    """1-norm condition estimate of L after scaling its rows to unit norm."""
    scale = np.linalg.norm(L, axis=1)
    if (scale == 0).any() or (np.diag(L) == 0).any():
        return np.inf
    reciprocal, _ = la.lapack.dtrcon((L / scale[:, None]).T, norm="I", uplo="U")
    return 1 / reciprocal if reciprocal > 0 else np.inf


def _blocked_qr(segments: Sequence[Segment], rows: int, order: np.ndarray | slice) -> np.ndarray:
    """Triangular factor by QR of chunk after chunk of Hankel columns; memory bounded, condition not squared."""
    d = rows * segments[0].shape[1]
    R = np.zeros((d, d), order="F")
    size = max(d, QR_VALUES // d)
    for w in segments:
        for start in range(0, len(w) - rows + 1, size):
            chunk = np.ascontiguousarray(w[start : start + size + rows - 1])
            R = append_rows(R, sliding_window_view(chunk.reshape(-1), d)[:: w.shape[1], order])
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    return (signs[:, None] * R).T


def append_rows(R: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the upper triangular factor of [R; rows], R (d, d) being one already; it is overwritten."""
    below = np.array(rows, order="F")
    return la.lapack.dtpqrt(0, min(32, len(R)), R, below, overwrite_a=True, overwrite_b=True)[0]


def _lengths(segments: Sequence[Sized]) -> str:
    if len(segments) == 1:
        return f"{len(segments[0])} samples"
    return f"{len(segments)} segments of {min(map(len, segments))} to {max(map(len, segments))} samples"
