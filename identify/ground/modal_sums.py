"""Sums over all samples of products of records that are filtered by the modes of a model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.correlation import Joint, channel_blocks

DENORMAL = 1e-100  # smaller powers are taken as zero: products of denormal numbers are slow


@dataclass(frozen=True, eq=False)
class ModalSums:
    """Sums over all samples t of records w(t) (c,), with zeta_ai(t+1) = lambda_i zeta_ai(t) + w_a(t) from zeta(0) = 0.

    on_data [a, i, b] : conj(zeta_ai) w_b over all records, (m, n, c) for the first m channels a;
    own [a, i, b, j] : conj(zeta_ai) zeta_bj over all records, (m, n, m, n);
    decay_on_data [e, i, b] : conj(rho_i) w_b over record e, (records, n, c), with rho_i(t) = lambda_i^t;
    decay_on_own [e, i, b, j] : conj(rho_i) zeta_bj over record e, (records, n, m + 1, n), the last b being rho itself.
    """

    on_data: np.ndarray
    own: np.ndarray
    decay_on_data: np.ndarray
    decay_on_own: np.ndarray


def modal_sums(records: Sequence[np.ndarray | Joint], circular: np.ndarray, modes: np.ndarray, m: int) -> ModalSums:
    """Sum over records (N_e, c) of the given circular correlation, for the modes (n,) of a real matrix, as `eig` gives them.

    Within a block, zeta is its periodic response plus lambda^t times what its start lacks of that: the sums on data come
    from the circular correlation and from two weighted sums of each block. The sums of zeta^* zeta follow from those, for
    they are also those of the next samples: (1 - conj(lambda_i) lambda_j) own = conj(lambda_i) on_data + (…)^* + what the
    ends bring. All modes must lie inside the unit circle.
    """
    size, c, n = len(circular), circular.shape[1], len(modes)
    modes = modes.conj()  # whose filters make conj(zeta)
    powers = _powers(modes, size + 1)
    powers[np.abs(powers) < DENORMAL] = 0
    powers, around = powers[:size], powers[size]
    parts, of_parts = _real_parts(modes, powers)
    forced = circular[np.arange(1, size + 1) % size, :m].reshape(size, -1)
    on_data = (of_parts.T @ (parts.T @ forced) / (1 - around)[:, None]).reshape(n, m, c)
    decay_on_data = np.zeros((len(records), n, c), complex)
    last = np.empty((len(records), m + 1, n), complex)
    decay = _decaying(around, 1)
    for e, w in enumerate(records):
        state, left = np.zeros((n, m + 1), complex), len(w)
        state[:, m] = 1
        for X in channel_blocks(w, size):
            blocks = X.shape[1]
            weighted = (X @ parts @ of_parts).transpose(2, 1, 0)
            drive = np.zeros((n, blocks + 1, m + 1), complex)
            drive[:, 0] = state
            drive[:, 1:, :m] = (X[:m] @ parts[::-1] @ of_parts).transpose(2, 1, 0)
            if len(decay[0]) <= blocks:
                decay = _decaying(around, blocks + 1)
            starts = decay[:, : blocks + 1, : blocks + 1] @ drive
            state = starts[:, -1]
            left -= (blocks - 1) * size
            if left <= size:  # the end of the record, be it within its last block
                last[e] = starts[:, -2].T * modes**left
                last[e, :m] += X[:m, -1, :left] @ powers[left - 1 :: -1]
            left -= size
            periodic = drive[:, 1:] / (1 - around)[:, None, None]
            free = (starts[:, :-1] - periodic).transpose(0, 2, 1) @ weighted
            on_data += free[:, :m]
            decay_on_data[e] += free[:, m]
    on_data = on_data.transpose(1, 0, 2)
    turn = (1 - np.multiply.outer(modes, modes.conj()))[:, None]
    ahead, final = modes[:, None, None] * on_data[:, :, :m, None], last[:, :m].reshape(len(records), -1)
    own = circular[0, :m, None, :m, None] + ahead + ahead.transpose(2, 3, 0, 1).conj()
    own -= (final.T @ final.conj()).reshape(own.shape)
    decay_on_own = -last[:, m, :, None, None] * last.conj()[:, None]
    decay_on_own[:, :, :m] += modes[:, None, None] * decay_on_data[:, :, :m, None]
    decay_on_own[:, :, m] += 1
    return ModalSums(on_data, own / turn, decay_on_data, decay_on_own / turn)


def _decaying(factors: np.ndarray, count: int) -> np.ndarray:
    """Lower triangular (n, count, count) with factor^(i - j): what x(i) = factor x(i-1) + d(i) makes of d."""
    lag = np.subtract.outer(np.arange(count), np.arange(count))
    return np.where(lag >= 0, _powers(factors, count).T[:, lag], 0)


def _powers(factors: np.ndarray, count: int) -> np.ndarray:
    """Powers 0 to count - 1 of each factor, (count, n), by doubling."""
    powers = np.ones((1, len(factors)), complex)
    while len(powers) < count:
        powers = np.concatenate([powers, powers * factors])
        factors = factors * factors
    return powers[:count]


def _real_parts(modes: np.ndarray, powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real P and complex S (n, n) with powers = P S, so that long sums are real and each conjugate pair costs one."""
    S = np.eye(len(modes), dtype=complex)
    second = np.flatnonzero(modes.imag)[1::2]
    S[second, second], S[second, second - 1], S[second - 1, second] = 1j, -1j, 1
    P = powers.real.copy()
    P[:, second] = powers[:, second].imag
    return P, S
