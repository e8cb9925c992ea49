"""Fast exact simulation of discrete LTI models, and their Markov parameters.

The recursion x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k) is lifted over blocks of samples: within a block the
output is a block-Toeplitz product, between blocks the state obeys the same recursion with A^L, solved by lifting
again. Matrix products do all the work and no modal form is needed, so defective matrices (integrators) are exact.
"""

import numpy as np

BLOCK = 32  # samples lifted at once: large enough for BLAS, small enough that the Toeplitz product stays cheap


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
    """Return y(t) = sum_i h[i] u(t - i) as (N, ny), for Markov parameters h (count, ny, nu) and u (N, nu), by FFT."""
    from scipy.signal import oaconvolve  # it loads scipy.stats, a third of the time of importing excite

    return np.stack(
        [
            sum((oaconvolve(u[:, j], h[:, i, j])[: len(u)] for j in range(u.shape[1])), np.zeros(len(u)))
            for i in range(h.shape[1])
        ],
        axis=1,
    )
