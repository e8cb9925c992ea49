"""Exact order of persistency where the singular values of a Hankel matrix drown in rounding.

Ten sines within 1 % of the band have order 20, but the 20-row Hankel matrix of their samples has condition 1e25: no
factorisation of it can tell. Two other views of the same question stay well conditioned:

- periodic records: the lines of the discrete Fourier transform are counted (`order_of_lines`);
- sums of exponentials without a common period: the rank of a *tall* Hankel matrix, whose rows are long enough to tell
  the exponentials apart (`order_of_recurrence`).

Both end in the smallest Kronecker index of a pair. Let the record be u(t) = C x(t), x(t + 1) = A x(t), with x(t) running
through the whole space. A vector polynomial p(z) = sum_i p_i z^i of degree below s annihilates every row of the Hankel
matrix with s block rows exactly when sum_i p_i^T C A^i = 0; so that matrix has full row rank s nu exactly when
C, CA, …, CA^(s-1) has, that is when s is at most the smallest observability index of (A, C). For a periodic record A is
diagonal with the lines z_l = exp(2 pi i l / M) and C holds their DFT vectors U_l; then the indices of the nu channels add
up to the number of lines L, whence order <= floor(L / nu), with equality for one channel: line counting (Zaffalon and
Hofmann, System Identification, ETH Zurich 2024, 4.0.4). Channels that share no line do not bear on each other, and the
least of their line counts decides.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from scipy import fft
from scipy.sparse.csgraph import connected_components

from excite.numerics.hankel import columns_of

EMPTY_LINE = 1e-9  # spectral lines below this fraction of the largest are empty
TALL_ROWS = 2**13  # rows of the tall Hankel matrix at most: more separate no frequencies that matter
OVERSAMPLING = 12  # random columns beyond the rank sought, so that the sketch keeps its small singular values
UNCERTAIN = 1e-5  # a dependency found with less accuracy than this is none that can be asserted


@dataclass(frozen=True)
class ExactOrder:
    """order : proven order of persistency, at most the one asked; exact : the true order is no larger (or was not asked).

    When not exact, double precision cannot decide between `order` and `ceiling`.
    """

    order: int
    exact: bool
    ceiling: int


def line_vectors(period: np.ndarray, noise: np.ndarray | float = 0.0) -> np.ndarray:
    """Lines U_l of one period (M, nu) as (M // 2 + 1, nu) complex, empty ones exactly zero, largest of a channel 1.

    Empty is what lies below EMPTY_LINE of the channel's largest line, or within five standard deviations of the lines of
    white noise with standard deviation `noise` in the samples of the period.
    """
    lines = fft.rfft(period, axis=0)
    size = np.abs(lines)
    largest = size.max(0)
    lines[size <= np.maximum(EMPTY_LINE * largest, 5 * np.sqrt(len(period)) * noise)] = 0.0
    return lines / np.where(largest > 0, largest, 1.0)


def line_weights(M: int) -> np.ndarray:
    """Number of lines on the full circle for each line of a real DFT, (M // 2 + 1,)."""
    weights = np.full(M // 2 + 1, 2)
    weights[0] = 1
    if M % 2 == 0:
        weights[-1] = 1
    return weights


def order_of_lines(lines: np.ndarray, M: int, most: int) -> ExactOrder:
    """Order, up to `most`, of the periodic signal with DFT vectors `lines` (M // 2 + 1, nu) of M samples."""
    support = lines != 0
    _, group = connected_components(support.T.astype(int) @ support.astype(int), directed=False)
    parts = [_coupled_lines(lines[:, group == g], M, most) for g in np.unique(group)]
    order, ceiling = min(p.order for p in parts), min(p.ceiling for p in parts)
    return ExactOrder(order, order == ceiling, ceiling)


def _coupled_lines(lines: np.ndarray, M: int, most: int) -> ExactOrder:
    """Order of channels that share lines, in real coordinates: each line turns its plane by 2 pi l / M a sample."""
    nu = lines.shape[1]
    kept = np.flatnonzero((lines != 0).any(1))
    ceiling = min(most, int(line_weights(M)[kept].sum()) // nu)
    if nu == 1 or ceiling == 0:
        return ExactOrder(ceiling, True, ceiling)
    angle = 2 * np.pi * kept[:, None] / M
    cos, sin = np.cos(angle), np.sin(angle)

    def turn(Q: np.ndarray) -> np.ndarray:
        re, im = np.split(Q, 2)
        return np.vstack([cos * re - sin * im, sin * re + cos * im])

    return smallest_index(turn, np.vstack([lines[kept].real, lines[kept].imag]), ceiling, noise=1e-14)


def smallest_index(
    step: Callable[[np.ndarray], np.ndarray], start: np.ndarray, ceiling: int, noise: float
) -> ExactOrder:
    """Largest s for which start, step(start), …, step^(s-1)(start) are linearly independent columns.

    The block Arnoldi process: each new block is made orthogonal to all before it, so that independence is decided by
    local numbers of size one instead of powers of `step` (staircase algorithm; Van Dooren, IEEE TAC 26, 1981). An error
    `noise` in `start` grows at each block by at most the inverse of its smallest singular value: a block whose singular
    value stands above the grown error is independent for certain, and the first that does not ends the count.
    """
    start = start / np.maximum(np.linalg.norm(start, axis=0), np.finfo(float).tiny)
    n, nu = start.shape
    basis, block, error = np.empty((n, 0)), start, noise
    for s in range(ceiling):
        for _ in range(2):
            block = block - basis @ (basis.T @ block)
        new, singular, _ = la.svd(block, full_matrices=False)
        if basis.shape[1] + nu > n or singular[-1] <= 10 * error:
            return ExactOrder(s, error < UNCERTAIN, s if error < UNCERTAIN else ceiling)
        error /= min(1.0, singular[-1])
        basis = np.hstack([basis, new])
        block = step(new)
    return ExactOrder(ceiling, True, ceiling)


def order_of_recurrence(segments: Sequence[np.ndarray], most: int) -> ExactOrder | None:
    """Order, up to `most`, of records (N_i, nu) by the rank of a tall Hankel matrix; None when that does not tell.

    One channel: if the tall matrix has rank at least s, then so has the one with s rows, since an annihilating
    polynomial of degree below s would, shifted, leave a matrix of r rows a rank below s. If its rank L is smaller than
    its rows, then the record obeys a recurrence of L terms and its order is L (Ho and Kalman, 1966; the rank profile of
    finite Hankel matrices: Heinig and Rost, 1984). Several channels: the realisation (A, C) is read off the column
    space, and its smallest observability index is the order.
    """
    nu = segments[0].shape[1]
    segments = [w for w in segments if len(w) >= most]
    if not segments:
        return None
    if not all(np.any([w.any(0) for w in segments], axis=0)):
        return ExactOrder(0, True, 0)  # a silent channel excites nothing
    if len(segments) == 1:
        rows = (len(segments[0]) + 1) // (nu + 1)
    else:  # no record may be too short for a column: its samples would escape the verdict
        rows = min(map(len, segments))
        while rows > most and columns_of(segments, rows) < rows * nu:
            rows = max(most, rows - max(1, rows // 16))
    rows = min(rows, max(TALL_ROWS // nu, most))
    sketch = _tall_rank(segments, rows, most * nu)
    if sketch is None:
        return ExactOrder(most, True, most) if nu == 1 else None
    space, uncertain = sketch
    L = space.shape[1]
    if nu == 1:
        return ExactOrder(min(L, most), not uncertain, most if uncertain else min(L, most))
    if uncertain:
        return None
    own = [_tall_rank([w[:, [a]] for w in segments], rows, most * nu) for a in range(nu)]
    sure = [part[0] for part in own if part is not None and not part[1]]
    if len(sure) == nu:
        ranks = [space.shape[1] for space in sure]
        if sum(ranks) == L:  # the channels share no exponential
            return ExactOrder(min(*ranks, most), True, min(*ranks, most))
    A = la.lstsq(space[:-nu], space[nu:])[0]
    return smallest_index(lambda Q: A.T @ Q, space[:nu].T, min(most, L // nu), noise=1e-12)


def _tall_rank(segments: Sequence[np.ndarray], rows: int, most: int) -> tuple[np.ndarray, bool] | None:
    """Column space (rows nu, L) of the tall Hankel matrix and whether L is in doubt; None when its rank reaches `most`.

    Random combinations of the columns have the same rank; each is a correlation, made by FFT. Singular values below
    20 eps sqrt(N) of the norm are rounding: samples of a sine at time t carry its phase error eps omega t, over the
    record eps pi N / sqrt(12) rms, as white noise with matrix norm sqrt(2 N) times that, against a norm of N / 2: together
    2.6 eps sqrt(N). A true singular value less than a thousand times the tolerance leaves the rank in doubt.
    """
    nu = segments[0].shape[1]
    rms = np.sqrt(sum((w**2).sum(0) for w in segments) / sum(map(len, segments)))
    scaled = [w / np.where(rms > 0, rms, 1.0) for w in segments]
    columns = columns_of(segments, rows)
    tolerance = 20 * np.finfo(float).eps * np.sqrt(sum(map(len, segments)))
    rng = np.random.default_rng(0)  # a fixed sketch: the same record always gets the same verdict
    full = min(most + OVERSAMPLING, rows * nu, columns)
    sketch = np.empty((rows * nu, 0))
    for width in (min(32, full), full):
        sketch = np.hstack([sketch, _combinations(scaled, rows, width - sketch.shape[1], rng)])
        space, s, _ = la.svd(sketch, full_matrices=False)
        level = tolerance * np.linalg.norm(s)
        L = int((s > level).sum())
        if L <= width - OVERSAMPLING or width == full:
            break
    if L >= min(most, full):
        return None
    return space[:, :L], L > 0 and bool(s[L - 1] < 1e3 * level)


def _combinations(segments: Sequence[np.ndarray], rows: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return H @ Omega (rows nu, count) for Gaussian Omega, H the block-Hankel matrix of all segments."""
    total = np.zeros((rows * segments[0].shape[1], count))
    for w in segments:
        n = fft.next_fast_len(len(w), real=True)
        spectrum = fft.rfft(w, n, axis=0)
        for k in range(count):
            omega = np.conj(fft.rfft(rng.standard_normal(len(w) - rows + 1), n))
            total[:, k] += fft.irfft(spectrum * omega[:, None], n, axis=0)[:rows].reshape(-1)
    return total
