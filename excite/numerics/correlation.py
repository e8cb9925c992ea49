"""Lagged products of long records, by FFT over blocks of samples: one transform per channel and block."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

BLOCK = 512  # samples transformed at once: longer blocks leave the cache, shorter ones have more seams
CHUNK_VALUES = 64_000  # doubles read at once, so that they stay in the cache …
CHUNK_BLOCKS = 32  # … but at least as many blocks as keep matrix products busy
FEW_CHANNELS = 3  # up to which matrix products, one a frequency, cost more than sums over blocks


@dataclass(frozen=True, eq=False)
class Joint:
    """Arrays (N, c_i) side by side, as (N, sum c_i), joined slice by slice, so that no long record is copied."""

    parts: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return len(self.parts[0])

    @property
    def shape(self) -> tuple[int, int]:
        """(N, sum c_i)."""
        return len(self), sum(part.shape[1] for part in self.parts)

    def __getitem__(self, samples: slice) -> np.ndarray:
        return np.hstack([part[samples] for part in self.parts])


@dataclass(frozen=True, eq=False)
class Correlation:
    """Lagged products of several segments of samples w(t) (c,).

    circular (size, c, c) : [d, a, b] is the sum over blocks of `size` samples of w_a(t) w_b(t + d), with t + d wrapped round
    within its block; linear (reach + 1, c, c) : the sum over all t with t + d in the same segment.
    """

    circular: np.ndarray
    linear: np.ndarray


Segment = np.ndarray | Joint


def correlate(segments: Sequence[Segment], reach: int) -> Correlation:
    """Correlate segments (N_i, c) over lags 0 to `reach`.

    Circular products pair the end of a block with its own beginning, where linear ones pair it with that of the next:
    the products of ends and beginnings make up for the difference.
    """
    size = _block_length(segments, reach)
    seam = next_fast_len(max(1, 2 * reach), real=True)
    within = across = np.zeros(())  # takes the shape of what is added
    for w in segments:
        end = np.zeros((w.shape[1], 1, reach))
        for X in channel_blocks(w, size):
            heads, ends = X[..., :reach], X[..., size - reach :]
            within = within + cross_spectrum(X, X, size)
            across = across + cross_spectrum(np.concatenate([end, ends[:, :-1]], axis=1) - ends, heads, seam)
            end = ends[:, -1:].copy()
    circular = irfft(within, size, axis=0)
    return Correlation(circular, circular[: reach + 1] + irfft(across, seam, axis=0)[np.arange(-reach, 1)])


def cross_spectrum(A: np.ndarray, B: np.ndarray, size: int) -> np.ndarray:
    """Spectrum (size // 2 + 1, a, b) of the circular correlations of A (a, blocks, m) and B (b, blocks, m), summed over blocks.

    Zeros fill up blocks of fewer than `size` samples.
    """
    F = rfft(A, size)
    G = F if B is A else rfft(B, size)
    if len(A) <= FEW_CHANNELS:
        return np.einsum("anf,bnf->fab", F.conj(), G)
    F, G = (np.ascontiguousarray(Z.transpose(2, 0, 1)) for Z in (F, G))
    return F.conj() @ G.transpose(0, 2, 1)


def channel_blocks(w: np.ndarray | Joint, size: int) -> Iterator[np.ndarray]:
    """Yield w (N, c) as blocks (c, blocks, size), as many at once as stay in the cache; zeros fill up the last one.

    All are views of one buffer: what is yielded changes with the next.
    """
    N, c = w.shape
    turn = size * blocks_at_once(c, size)
    X = np.empty((c, min(turn, -(-N // size) * size)))
    for start in range(0, N, turn):
        count, first = min(turn, N - start), 0
        blocks = -(-count // size)
        for part in w.parts if isinstance(w, Joint) else (w,):  # a joined slice would be a copy more
            last = first + part.shape[1]
            X[first:last, :count] = part[start : start + count].T
            first = last
        X[:, count : blocks * size] = 0
        yield X[:, : blocks * size].reshape(c, blocks, size)


def blocks_at_once(channels: int, size: int) -> int:
    """Most blocks that `channel_blocks` yields at once."""
    return max(CHUNK_BLOCKS, CHUNK_VALUES // (channels * size))


def _block_length(segments: Sequence[Segment], reach: int) -> int:
    """Samples a block: what suits the FFT, with few seams of `reach` samples, and no longer than the data."""
    return next_fast_len(max(reach, min(max(map(len, segments)), max(BLOCK, 8 * reach))), real=True)
