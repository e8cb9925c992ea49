"""Covariance functions of long records, by FFT over blocks: memory grows with the lags and channels, not the samples.

Covariance here is the mean lagged product; no mean is removed, for no method detrends on its own account.
"""

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from excite.errors import ExciteError
from excite.numerics.correlation import Segment

BLOCK_VALUES = 250_000  # doubles in one block of samples: 2 MB, so that its transform stays in the cache

Pairs = Sequence[tuple[Segment, Segment]]


def cross_covariance(pairs: Pairs, first_lag: int, last_lag: int) -> np.ndarray:
    """Return R(tau) = mean over t of w(t + tau) xi(t)^T for first_lag <= tau <= last_lag, as (lags, c, m).

    pairs : (w (N_i, c), xi (N_i, m)) of each record. The mean runs over the same instants t for every lag (those at
    which all lags exist), where the textbook estimate changes its instants with the lag. So R obeys w's linear
    recursions exactly, R_x(tau + 1) = A R_x(tau) + B R_u(tau), and no end of the record disturbs a noise-free
    realization; the price is the last_lag - first_lag products at the ends.
    """
    lags = last_lag - first_lag + 1
    before, after = max(0, -first_lag), max(0, last_lag)
    count = sum(max(0, len(w) - before - after) for w, _ in pairs)
    if count == 0:
        raise ExciteError(
            f"lags {first_lag} to {last_lag} reach over {before + after} samples, but the longest record has "
            f"{max(len(w) for w, _ in pairs)}; choose lags nearer to 0 or record more"
        )
    c = pairs[0][0].shape[1]
    size = next_fast_len(max(8 * lags, min(count + lags, BLOCK_VALUES // c)), real=True)
    step = size - lags + 1
    spectrum = np.zeros(())  # takes the shape of what is added
    for w, xi in pairs:
        stop = len(w) - after
        for start in range(before, stop, step):
            end = min(start + step, stop)
            spectrum = spectrum + _product(w[start + first_lag : end + last_lag], xi[start:end], size)
    return irfft(spectrum, size, axis=0)[:lags] / count


def smoothed_covariance(pairs: Pairs, first_lag: int, last_lag: int, segments: int) -> np.ndarray:
    """Return the covariance function of Welch's cross-spectrum, (lags, c, m): Miller (2012), 5.4.2 and C.1 (`xcovsmooth`).

    Each record is cut into `segments` pieces that overlap by half, with a Hamming window on both signals. The mean of
    such an estimate is R(tau) times the window's own covariance function, which is divided out; so the linear relation
    of the covariances holds on average, but no longer exactly.
    """
    length = min(2 * len(w) // (segments + 1) for w, _ in pairs)
    reach = max(abs(first_lag), abs(last_lag))
    if length <= 2 * reach:
        raise ExciteError(
            f"{segments} segments leave {length} samples in each, but lags to {reach} need more than {2 * reach}; "
            "take fewer segments or lags nearer to 0"
        )
    from scipy.signal import get_window  # slow to import, and few runs need it

    window = get_window("hamming", length)[:, None]
    size = next_fast_len(length + reach, real=True)
    spectrum, count = np.zeros(()), 0  # takes the shape of what is added
    for w, xi in pairs:
        for start in range(0, len(w) - length + 1, length // 2):
            piece = slice(start, start + length)
            spectrum, count = spectrum + _product(window * w[piece], window * xi[piece], size), count + 1
    lags = np.arange(first_lag, last_lag + 1)
    own = irfft(_product(window, window, size), size, axis=0)[lags]
    return irfft(spectrum, size, axis=0)[lags] / (count * own)


def _product(w: np.ndarray, xi: np.ndarray, size: int) -> np.ndarray:
    """Cross-spectrum (F, c, m) of two zero-padded pieces."""
    return rfft(w, size, axis=0)[:, :, None] * rfft(xi, size, axis=0).conj()[:, None, :]
