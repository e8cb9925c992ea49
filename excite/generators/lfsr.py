"""Linear feedback shift registers over GF(2): fast sequences, jumps ahead, and proofs that taps are primitive.

A register of n bits with taps t runs the recursion s(k + n) = s(k) + sum_t s(k + t) mod 2; its characteristic polynomial
is p(x) = x^n + sum_t x^t + 1, and a shift by one chip is multiplication by x. Registers and polynomials are integers: bit
i of a register is s(i), bit i of a polynomial the coefficient of x^i.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import chain, combinations, islice
from math import gcd, isqrt, lcm

import numpy as np

# Every prime that divides 2^n - 1 for an n up to 32 (Brillhart et al., Factorizations of b^n +- 1, 1988).
PRIMES = (
    3,
    5,
    7,
    11,
    13,
    17,
    19,
    23,
    29,
    31,
    41,
    43,
    47,
    73,
    89,
    113,
    127,
    151,
    233,
    241,
    257,
    331,
    337,
    601,
    683,
    1103,
    1801,
    2089,
    2731,
    8191,
    65537,
    131071,
    178481,
    262657,
    524287,
    2147483647,
)
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
MAX_ZECH_ORDER = 14  # beyond it, trying all spacings would take longer than generating the signal
MAX_PAIR_ORDER = 20  # beyond it, correlating two sequences over one period would
PAIRS = 1 << 24  # chips of correlations that `least_correlated` computes, at most about half of them


def sequence(order: int, taps: Sequence[int], state: int, length: int) -> np.ndarray:
    """Return `length` bits of the register, (length,) uint8: scipy.signal.max_len_seq's bits, much faster.

    Over GF(2), p(x)^B = p(x^B) for B a power of two, so the bits obey s(k + nB) = s(k) + sum_t s(k + tB) too. With B a
    multiple of 8 these are sums of whole bytes; B doubles as the known part grows, so nearly all bits come from a
    handful of long vectorised sums.
    """
    total = -(-length // 8)
    packed = np.empty(max(total, order), dtype=np.uint8)
    packed[:order] = np.frombuffer(_continued(order, taps, state, 8 * order).to_bytes(order, "little"), dtype=np.uint8)
    known = order
    while known < total:
        block = 1 << ((known // order).bit_length() - 1)
        start = known - order * block
        count = min(block * (order - max(taps)), total - known)
        new = packed[known : known + count]
        new[:] = packed[start : start + count]
        for tap in taps:
            new ^= packed[start + tap * block : start + tap * block + count]
        known += count
    return np.unpackbits(packed, count=length, bitorder="little")


def advance(order: int, taps: Sequence[int], state: int, chips: int) -> int:
    """Return the register `chips` steps later: with x^chips = sum_i c_i x^i mod p, s(k + chips) = sum_i c_i s(k + i)."""
    jump = power_of_x(chips, order, taps)
    bits = _continued(order, taps, state, 2 * order)
    return sum(((jump & bits >> i).bit_count() & 1) << i for i in range(order))


def _continued(order: int, taps: Sequence[int], state: int, length: int) -> int:
    """Return the first `length` bits of the sequence as one integer."""
    bits, window = state, 1 | sum(1 << tap for tap in taps)
    for k in range(length - order):
        bits |= ((bits >> k & window).bit_count() & 1) << (k + order)
    return bits


def power_of_x(exponent: int, order: int, taps: Sequence[int]) -> int:
    """Return x^exponent modulo p(x)."""
    polynomial = 1 << order | 1 | sum(1 << tap for tap in taps)
    result = 1
    for digit in f"{exponent:b}":
        result = int(f"{result:b}", 4) << int(digit)  # squaring over GF(2) puts a zero between any two coefficients
        while result >> order:
            result ^= polynomial << (result.bit_length() - 1 - order)
    return result


def is_primitive(order: int, taps: Sequence[int]) -> bool:
    """Whether x has the order 2^n - 1 modulo p, so that the sequence has the maximum period."""
    length = 2**order - 1
    return power_of_x(length, order, taps) == 1 and all(
        power_of_x(length // q, order, taps) != 1 for q in PRIMES if length % q == 0
    )


def period(order: int, taps: Sequence[int]) -> int:
    """Return the order of x modulo p, the longest period that the register has from any state.

    It divides lcm(2^d - 1, d <= n) 2^m with 2^m >= n, since p's irreducible factors have degrees up to n and
    multiplicities up to n (Lidl and Niederreiter, Finite Fields, 1983, chapter 3); prime factors that are not needed
    are divided out.
    """
    length = lcm(*(2**d - 1 for d in range(1, order + 1))) << (order - 1).bit_length()
    for q in (2, *PRIMES):
        while length % q == 0 and power_of_x(length // q, order, taps) == 1:
            length //= q
    return length


def decimated(order: int, taps: Sequence[int], every: int) -> tuple[int, ...]:
    """Return the taps of the sequence s(every k), for primitive `taps` and `every` coprime with 2^n - 1.

    They are the linear dependence of 1, x^every, x^(2 every), … modulo p, found by elimination; each power carries a mark
    of its own above bit n, which tells which powers a sum holds.
    """
    pivots: dict[int, int] = {}
    for k in range(order + 1):
        row = power_of_x(every * k, order, taps) | 1 << (order + k)
        for pivot, other in pivots.items():
            row ^= other * (row >> pivot & 1)
        low = row & ((1 << order) - 1)
        if low:
            pivots[low.bit_length() - 1] = row
    return tuple(k for k in reversed(range(1, order)) if row >> (order + k) & 1)


def decimations(order: int) -> Iterator[int]:
    """Yield decimations that lead to different maximum-length sequences, those with small cross-correlations first.

    Gold's 2^k + 1 and Kasami's 4^k - 2^k + 1, Niho's 2^(n/2 + 1) - 1 for even n (Sarwate and Pursley, Proc. IEEE 68,
    1980), products of two of them, then all others; one of each cyclotomic coset {r, 2r, 4r, …} mod 2^n - 1.
    """
    length = 2**order - 1
    good = (
        [2**k + 1 for k in range(1, order)] + [4**k - 2**k + 1 for k in range(2, order)] + [2 ** (order // 2 + 1) - 1]
    )
    seen = {1 << k for k in range(order)}
    for every in chain(good, (a * b for a, b in combinations(good, 2)), range(3, length, 2)):
        leader = every % length
        if leader not in seen and gcd(leader, length) == 1:
            seen.update((leader << k) % length for k in range(order))
            yield leader


def polynomials(order: int) -> int:
    """Return how many primitive polynomials of a degree there are, phi(2^n - 1) / n."""
    count = 2**order - 1
    for q in PRIMES:
        if (2**order - 1) % q == 0:
            count = count // q * (q - 1)
    return count // order


@cache
def least_correlated(order: int, first: tuple[int, ...], count: int) -> tuple[tuple[int, ...], ...]:
    """Return `count` tap sets whose sequences correlate little: `first`, and others from a pool of primitive ones.

    For every second one, the set is completed by always adding the one whose worst correlation with those chosen is
    least; the best set wins. The pool is as large as `PAIRS` chips of correlations allow; up to order 10 it holds every
    primitive polynomial, and with them the preferred pairs of Gold (1967) where they exist.
    """
    size = max(count, min(64, isqrt(PAIRS >> order)))
    pool = [first, *(decimated(order, first, every) for every in islice(decimations(order), size - 1))]
    lines = [_lines(order, taps) for taps in pool]
    peaks = np.zeros((len(pool), len(pool)))
    for i, j in combinations(range(len(pool)), 2):
        peaks[i, j] = peaks[j, i] = _peak(lines[i], lines[j], 2**order - 1)

    def completed(second: int) -> tuple[float, list[int]]:
        chosen = [0, second]
        while len(chosen) < count:
            worst = peaks[chosen].max(axis=0)
            worst[chosen] = np.inf
            chosen.append(int(worst.argmin()))
        return peaks[np.ix_(chosen, chosen)].max(), chosen

    return tuple(pool[i] for i in min(completed(second) for second in range(1, len(pool)))[1])


def cross_correlation(order: int, tap_sets: Sequence[tuple[int, ...]]) -> float:
    """Return the largest |(1/M) sum_k a(k) b(k + l)| over all lags l and all pairs of different sequences."""
    lines = [_lines(order, taps) for taps in tap_sets]
    return max((_peak(a, b, 2**order - 1) for a, b in combinations(lines, 2)), default=0.0)


def _lines(order: int, taps: tuple[int, ...]) -> np.ndarray:
    return np.fft.rfft(1.0 - 2.0 * sequence(order, taps, 1, 2**order - 1))


def _peak(a: np.ndarray, b: np.ndarray, length: int) -> float:
    # The correlations are whole numbers over M: rounding makes equal ones equal.
    return float(np.abs(np.rint(np.fft.irfft(a.conj() * b, length))).max()) / length


@cache
def spacing(order: int, taps: tuple[int, ...], count: int) -> tuple[int, int | None]:
    """Return the spacing of `count` shifts and the least lag, in chips, of a product of two channels behind a channel.

    s(k) + s(k + d) = s(k + z(d)) over GF(2) (Zech's logarithm z, read from the register's states); up to order
    `MAX_ZECH_ORDER` all spacings are tried, beyond it the spacing just avoids dividing M.
    """
    length = 2**order - 1
    if count < 2:
        return length, None
    if order > MAX_ZECH_ORDER:
        return (length - 1) // count, None
    bits = sequence(order, taps, 2**order - 1, length + order - 1).astype(np.int64)
    register = np.lib.stride_tricks.sliding_window_view(bits, order) @ (1 << np.arange(order))
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


def modulation(count: int, hadamard: bool, inverse_repeat: bool) -> np.ndarray:
    """Return the signs, (count, K), that multiply the chips of each channel in turn; K is a power of two.

    Hadamard: rows of Sylvester's matrix, (-1)^popcount(r k). The square waves r = 0, 1, 2, 4, … come first, because
    their lines are disjoint and they are therefore uncorrelated at every lag. Inverse-repeat: each row followed by its
    negative. K is coprime with the odd M, so the product with a sequence has the period K M and its correlation is the
    product of both correlations.
    """
    size = 1 << (count - 1).bit_length() if hadamard else 1
    rows = np.array(sorted(range(size), key=lambda r: (r.bit_count(), r))[:count] if hadamard else [0] * count)
    signs = 1 - 2 * (np.bitwise_count(rows[:, None] & np.arange(size)) & 1).astype(int)
    return np.hstack([signs, -signs]) if inverse_repeat else signs


def row_correlation(signs: np.ndarray) -> float:
    """Return the largest circular correlation of two different rows of `modulation`, at any lag."""
    lines, K = np.fft.rfft(signs), signs.shape[1]
    return max(
        (
            float(np.rint(np.abs(np.fft.irfft(a.conj() * lines[i + 1 :], K))).max()) / K
            for i, a in enumerate(lines[:-1])
        ),
        default=0.0,
    )
