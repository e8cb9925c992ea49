"""Compressed block-Hankel data: a triangular factor L with H = L Q, Q Q^T = I, without forming H.

The Gram matrix H H^T has displacement structure, G[i+1, j+1] = G[i, j] - w(i) w(j)^T + w(M+i) w(M+j)^T, so its first
block row and M-independent updates give all of it; its Cholesky factor is L. Squaring the data squares the condition,
so when the factor's condition leaves what double precision can hold, a QR decomposition over chunks takes over.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.lib.stride_tricks import sliding_window_view

from excite.errors import ExciteError

GRAM_CONDITION = 1e6  # beyond it the Gram form holds fewer than four digits of the smallest singular value
CHUNK_VALUES = 4_000_000  # doubles in one chunk of explicit Hankel columns, 32 MB


@dataclass(frozen=True, eq=False)
class HankelFactor:
    """L (d, d) lower triangular with H = L Q for H (d, columns), d = rows * channels, row i*channels + a = w_a(t+i).

    condition : 1-norm condition estimate of L with unit-norm rows; path : "gram-cholesky" or "blocked-qr".
    """

    L: np.ndarray
    rows: int
    channels: int
    columns: int
    condition: float
    path: str

    def index(self, channel: slice | Sequence[int], start: int, stop: int) -> np.ndarray:
        """Row numbers of the given channels in block rows start:stop, time-major."""
        block = np.arange(self.channels)[channel]
        return (np.arange(start, stop)[:, None] * self.channels + block).ravel()


def columns_of(segments: Sequence[np.ndarray], rows: int) -> int:
    """Number of Hankel columns that segments of data leave for `rows` block rows."""
    return sum(max(0, len(w) - rows + 1) for w in segments)


def hankel_factor(segments: Sequence[np.ndarray], rows: int) -> HankelFactor:
    """Compress the block-Hankel matrix of several segments (N_i, c), side by side, into its triangular factor.

    Raises ExciteError when the data leave no more columns than there are rows, saying how many rows they allow.
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
    norms = np.sqrt(sum((w**2).sum(0) for w in segments) / sum(map(len, segments)))
    norms[norms == 0] = 1.0
    segments = [w / norms for w in segments]
    L, condition, path = _cholesky(segments, rows, d), np.inf, "gram-cholesky"
    if L is not None:
        condition = _condition(L)
    if condition > GRAM_CONDITION:
        L, path = _blocked_qr(segments, rows, d), "blocked-qr"
        condition = _condition(L)
    return HankelFactor(L * np.tile(norms, rows)[:, None], rows, channels, columns, condition, path)


def largest_rows(segments: Sequence[np.ndarray]) -> int:
    """Largest number of block rows with at least as many columns as rows."""
    channels, rows = segments[0].shape[1], 0
    while columns_of(segments, rows + 1) >= (rows + 1) * channels:
        rows += 1
    return rows


def hankel_gram(segments: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """Gram matrix H H^T (d, d) of the block-Hankel matrix, by displacement."""
    c = segments[0].shape[1]
    G = np.zeros((rows, c, rows, c))
    for w in segments:
        M = len(w) - rows + 1
        g = np.empty_like(G)
        g[0] = _first_block_row(w, rows)
        head, tail = w[:rows], w[M:]
        for i in range(rows - 1):
            g[i + 1, :, 1:] = g[i, :, :-1] - np.multiply.outer(head[i], head[:-1]) + np.multiply.outer(tail[i], tail)
            g[i + 1, :, 0] = g[0, :, i + 1].T
        G += g
    return G.reshape(rows * c, rows * c)


def _first_block_row(w: np.ndarray, rows: int) -> np.ndarray:
    """Sum over columns t of w(t) w(t+j)^T for j below `rows`, as (c, rows, c).

    Blocks of B samples times their windows of B + rows - 1 samples, all in one matrix product X^T Y; the sum over t is
    then that of the product's B diagonals: M (B + rows) multiplications a channel pair, where columns one by one read
    M rows numbers from memory.
    """
    c = w.shape[1]
    M = len(w) - rows + 1
    B = max(rows, 32)
    blocks = -(-M // B)
    heads, tails = np.zeros((blocks * B, c)), np.zeros(((blocks + 1) * B, c))
    heads[:M], tails[: len(w)] = w[:M], w
    X = heads.reshape(blocks, B * c)
    Y = sliding_window_view(tails.reshape(-1), (B + rows - 1) * c)[:: B * c][:blocks]
    size = max(1, CHUNK_VALUES // (8 * (B + rows) * c))
    P = np.zeros((B * c, (B + rows - 1) * c))
    for start in range(0, blocks, size):
        P += X[start : start + size].T @ np.ascontiguousarray(Y[start : start + size])
    P = P.reshape(B, c, B + rows - 1, c)
    return sum(P[i, :, i : i + rows] for i in range(B))


def _cholesky(segments: Sequence[np.ndarray], rows: int, d: int) -> np.ndarray | None:
    try:
        return la.cholesky(hankel_gram(segments, rows), lower=True)
    except la.LinAlgError:
        return None


def _condition(L: np.ndarray) -> float:
    """1-norm condition estimate of L after scaling its rows to unit norm."""
    scale = np.linalg.norm(L, axis=1)
    if (scale == 0).any() or (np.diag(L) == 0).any():
        return np.inf
    reciprocal, _ = la.lapack.dtrcon(L / scale[:, None], norm="1", uplo="L")
    return 1 / reciprocal if reciprocal > 0 else np.inf


def _blocked_qr(segments: Sequence[np.ndarray], rows: int, d: int) -> np.ndarray:
    """Triangular factor by QR of chunk after chunk of Hankel columns; memory bounded, condition not squared."""
    R = np.zeros((0, d))
    size = max(d, CHUNK_VALUES // d)
    for w in segments:
        windows = sliding_window_view(np.ascontiguousarray(w).reshape(-1), d)[:: w.shape[1]]
        for start in range(0, len(windows), size):
            (R,) = la.qr(np.vstack([R, windows[start : start + size]]), mode="r", overwrite_a=True, check_finite=False)
            R = R[:d]
    signs = np.where(np.diag(R) < 0, -1.0, 1.0)
    return (signs[:, None] * R).T


def _lengths(segments: Sequence[np.ndarray]) -> str:
    if len(segments) == 1:
        return f"{len(segments[0])} samples"
    return f"{len(segments)} segments of {min(map(len, segments))} to {max(map(len, segments))} samples"
