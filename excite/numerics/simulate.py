"""Fast exact simulation of discrete LTI models and polynomial matrices, and their Markov parameters.

The recursion x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k) is lifted over blocks of samples: within a block the
output is a block-Toeplitz product, between blocks the state obeys the same recursion with A^L, solved by lifting
again. Matrix products do all the work and no modal form is needed, so defective matrices (integrators) are exact.
"""

import numpy as np

BLOCK = 16  # samples lifted at once: enough for BLAS, few enough that the Toeplitz product stays cheap
LONG = 64  # taps beyond which a convolution by FFT costs less


def markov(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, count: int) -> np.ndarray:
    """Return the impulse response D, CB, CAB, … as (count, ny, nu)."""
    h = np.empty((count, len(C), B.shape[1]))
    h[:1] = D
    if count > 1:
        h[1:] = observability(A, C, count - 1) @ B
    return h


def observability(A: np.ndarray, C: np.ndarray, count: int) -> np.ndarray:
    """Return C, CA, …, CA^(count-1) as (count, ny, n), by doubling."""
    O, power, (ny, n) = C, A, C.shape
    while len(O) < count * ny:
        O = np.vstack([O, O @ power])  # one matrix product for all block rows
        power = power @ power
    return O[: count * ny].reshape(count, ny, n)


def simulate(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, u: np.ndarray, x0: np.ndarray | None = None
) -> np.ndarray:
    """Return y (N, ny) of the model for u (N, nu) from state x0 (n,), zero when not given."""
    N, nu = u.shape
    n, ny = len(A), len(C)
    x = np.zeros(n) if x0 is None else np.asarray(x0, float)
    if n == 0:
        return u @ D.T
    if N <= max(BLOCK, n):  # the powers of a large A cost more than so few steps
        y = np.empty((N, ny))
        for k in range(N):
            y[k] = C @ x + D @ u[k]
            x = A @ x + B @ u[k]
        return y
    L, blocks = BLOCK, -(-N // BLOCK)
    padded = np.zeros((blocks * L, nu))
    padded[:N] = u
    U = padded.reshape(blocks, L * nu)
    powers = observability(A, np.eye(n), L)
    reach = (powers[::-1] @ B).transpose(1, 0, 2).reshape(n, L * nu)
    drive = U[:-1] @ reach.T
    starts = np.empty((blocks, n))
    starts[0] = x
    if blocks > 1:
        step = A @ powers[-1]
        starts[1:] = simulate(step, np.eye(n), step, np.eye(n), drive, x)
    h = np.concatenate([np.zeros((L - 1, ny, nu)), markov(A, B, C, D, L)])
    lag = np.arange(L)[:, None] - np.arange(L)[None, :] + L - 1
    T = h[lag].transpose(0, 2, 1, 3).reshape(L * ny, L * nu)
    y = U @ T.T + starts @ (C @ powers).reshape(L * ny, n).T
    return y.reshape(blocks * L, ny)[:N]


def states(A: np.ndarray, B: np.ndarray, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
    """Return x (N, n): the state at each sample of u (N, nu), from x0."""
    n = len(A)
    return simulate(A, B, np.eye(n), np.zeros((n, B.shape[1])), u, x0)


def fir(h: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return y(t) = sum_i h[i] u(t - i) as (N, ny), for Markov parameters h (count, ny, nu) and u (N, nu), zero before."""
    return _short_fir(h, u) if len(h) <= LONG else _long_fir(h, u)


def _short_fir(h: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Lifted: each block of outputs is a banded block-Toeplitz matrix times the inputs it looks back on."""
    (count, ny, nu), N = h.shape, len(u)
    blocks, width = -(-N // BLOCK), BLOCK + count - 1
    windows = np.ascontiguousarray(_windows(u, count, width, BLOCK, blocks)).reshape(blocks, width * nu)
    band = np.concatenate([np.zeros((BLOCK, ny, nu)), h[::-1], np.zeros((BLOCK, ny, nu))])
    place = BLOCK + np.arange(width)[None, :] - np.arange(BLOCK)[:, None]
    T = band[place].transpose(0, 2, 1, 3).reshape(BLOCK * ny, width * nu)
    return (windows @ T.T).reshape(blocks * BLOCK, ny)[:N]


def _long_fir(h: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Overlap-save: one transform for each input and each output, whatever their number of pairs."""
    (count, ny, _), N = h.shape, len(u)
    length = 1 << (min(max(4 * count, 1024), N + count - 1) - 1).bit_length()
    step = length - count + 1
    blocks = -(-N // step)
    spectra = np.fft.rfft(_windows(u, count, length, step, blocks).transpose(1, 2, 0), axis=0)
    y = np.fft.irfft(np.fft.rfft(h, length, axis=0) @ spectra, length, axis=0)[count - 1 :]
    return y.transpose(2, 0, 1).reshape(blocks * step, ny)[:N]


def _windows(u: np.ndarray, count: int, width: int, step: int, blocks: int) -> np.ndarray:
    """Return (blocks, width, nu): `width` samples each, the first of them count - 1 before sample 0, each `step` later."""
    padded = np.zeros(((blocks - 1) * step + width, u.shape[1]))
    padded[count - 1 : count - 1 + len(u)] = u[: len(padded) - count + 1]
    return np.lib.stride_tricks.sliding_window_view(padded, width, axis=0)[::step].transpose(0, 2, 1)


def divide(a: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return y (N, ny) of A(q) y = w for w (N, ny) and a (lags + 1, ny, ny) with a[0] = I; y and w are zero before.

    Lifted as `simulate` is, but in the last `lags` outputs instead of a state: two matrix products over all blocks, and
    between them one product of size lags ny per block.
    """
    (lags, ny), N = (len(a) - 1, a.shape[1]), len(w)
    if lags == 0 or N == 0:
        return w.copy()
    L = min(max(4 * BLOCK, lags), max(lags, N))
    g = _inverse(a, L)
    lag = np.arange(L)[:, None] - np.arange(L)[None, :]
    G = np.where((lag >= 0)[:, :, None, None], g[np.maximum(lag, 0)], 0.0).transpose(0, 2, 1, 3).reshape(L * ny, L * ny)
    behind = (
        np.arange(lags)[:, None] + lags - np.arange(lags)[None, :]
    )  # lag of a block's sample to one of the last before
    H = np.where((behind <= lags)[:, :, None, None], a[np.minimum(behind, lags)], 0.0)
    onward = -G[:, : lags * ny] @ H.transpose(0, 2, 1, 3).reshape(lags * ny, lags * ny)
    blocks = -(-N // L)
    padded = np.zeros((blocks * L, ny))
    padded[:N] = w
    Y = padded.reshape(blocks, L * ny) @ G.T
    last = Y[:, -lags * ny :].copy()
    step = np.ascontiguousarray(onward[-lags * ny :])
    for k in range(1, blocks):
        last[k] += step @ last[k - 1]
    Y[1:] += last[:-1] @ onward.T
    return Y.reshape(blocks * L, ny)[:N]


def _inverse(a: np.ndarray, count: int) -> np.ndarray:
    """Impulse response (count, ny, ny) of the inverse of A(q)."""
    g, ny = np.zeros((count, *a.shape[1:])), a.shape[1]
    g[0] = np.eye(ny)
    row = a[1:].transpose(1, 0, 2).reshape(ny, -1)  # A_1, A_2, … side by side
    for k in range(1, count):
        known = g[k - 1 :: -1][: len(a) - 1].reshape(-1, ny)
        g[k] = -row[:, : len(known)] @ known
    return g


def rational(
    b: np.ndarray, a: np.ndarray, u: np.ndarray, x0: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return y (N,) of a(q) y = b(q) u for one input u (N,), a monic, and the state after it, from which to go on.

    x0 : state (max(len(a), len(b)) - 1,) of the observer form: its entry k adds to the right side at sample k.
    """
    if len(a) == len(b) == 1:
        return b[0] * u, np.zeros(0)
    from scipy.signal import lfilter  # it loads scipy.stats, a third of the time of importing excite

    return lfilter(b, a, u, zi=np.zeros(max(len(a), len(b)) - 1) if x0 is None else x0)


def recurrence(decay: np.ndarray, drive: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Return x (N, …) of x(k+1) = decay(k) x(k) + drive(k), elementwise, x(0) = x0 (…).

    decay, drive (N - 1, …). The steps are taken side by side in about sqrt(N) blocks, each from zero, and the blocks are
    joined afterwards: no division, so that decays may vanish.
    """
    steps = len(drive)
    L = max(1, int(np.sqrt(steps)))
    blocks = -(-steps // L)
    shape = np.broadcast_shapes(decay.shape, drive.shape)[1:]
    past, x = np.zeros((blocks * L, *shape)), np.zeros((blocks * L, *shape))  # past : product of the decays so far
    past[:steps], x[:steps] = decay, drive
    past, x = past.reshape(blocks, L, *shape), x.reshape(blocks, L, *shape)
    for k in range(1, L):
        x[:, k] += past[:, k] * x[:, k - 1]
        past[:, k] *= past[:, k - 1]
    starts = np.empty((blocks + 1, *shape))
    starts[0] = x0
    for k in range(blocks):
        starts[k + 1] = past[k, -1] * starts[k] + x[k, -1]
    x += past * starts[:-1, None]
    return np.concatenate([starts[:1], x.reshape(blocks * L, *shape)[:steps]])
