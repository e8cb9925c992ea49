"""Sums over all samples of products of records that are filtered by the modes of a model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.numerics.correlation import Joint, blocks_at_once, channel_blocks

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

    Within a block, zeta is its periodic response plus lambda^t times what its start lacks of that. The periodic part of
    on_data comes from the circular correlation, the rest from two weighted sums of each block. The sums of zeta^* zeta
    follow, for they are also those of the next samples: (1 - conj(lambda_i) lambda_j) own = conj(lambda_i) on_data + (…)^* +
    what the ends bring. All modes must lie inside the unit circle.
    """
    size, c, n = len(circular), circular.shape[1], len(modes)
    filters = _Filters(modes.conj(), size, min(blocks_at_once(c, size), -(-max(map(len, records)) // size)))
    free, last = map(np.stack, zip(*[filters.run(w, m) for w in records], strict=True))
    on_data = (filters.periodic(circular[:, :m]) + free[:, :, :m].sum(0)).transpose(1, 0, 2)
    decay_on_data = free[:, :, m]
    modes = filters.modes
    turn = (1 - np.multiply.outer(modes, modes.conj()))[:, None]
    ahead, final = modes[:, None, None] * on_data[:, :, :m, None], last[:, :m].reshape(len(records), m * n)
    own = circular[0, :m, None, :m, None] + ahead + ahead.transpose(2, 3, 0, 1).conj()
    own -= (final.T @ final.conj()).reshape(own.shape)
    decay_on_own = -last[:, m, :, None, None] * last.conj()[:, None]
    decay_on_own[:, :, :m] += modes[:, None, None] * decay_on_data[:, :, :m, None]
    decay_on_own[:, :, m] += 1
    return ModalSums(on_data, own / turn, decay_on_data, decay_on_own / turn)


class _Filters:
    """zeta(t+1) = mu_i zeta(t) + w(t) over blocks of `size` samples, at most `most` at once."""

    def __init__(self, modes: np.ndarray, size: int, most: int) -> None:
        powers = _powers(modes, size + 1)
        powers[np.abs(powers) < DENORMAL] = 0
        self.modes, self.powers, self.around = modes, powers[:size], powers[size]
        self.parts, self.of_parts = _real_parts(modes, self.powers)
        lag = np.subtract.outer(np.arange(most + 1), np.arange(most + 1))
        self.scan = np.where(lag >= 0, _powers(self.around, most + 1).T[:, lag], 0)  # starts from what each block adds

    def periodic(self, circular: np.ndarray) -> np.ndarray:
        """Sums (n, m, c) of the periodic responses to the first of w_a w_b, circular (size, m, c), with the second."""
        ahead = np.roll(circular, -1, axis=0).reshape(len(circular), -1)
        sums = self.of_parts.T @ (self.parts.T @ ahead) / (1 - self.around)[:, None]
        return sums.reshape(len(sums), *circular.shape[1:])

    def run(self, w: np.ndarray | Joint, m: int) -> tuple[np.ndarray, np.ndarray]:
        """Sums (n, m + 1, c) over record w (N, c) of what its zeta add to their periodic responses, and zeta(N), (m + 1, n).

        zeta_a for the first m channels a from zero, and the decay of 1 without an input.
        """
        size, c, n = len(self.powers), w.shape[1], len(self.modes)
        sums, state = np.zeros((n, m + 1, c), complex), np.zeros((n, m + 1), complex)
        state[:, m] = 1
        for X in channel_blocks(w, size):
            blocks = X.shape[1]
            weighted = (X @ self.parts @ self.of_parts).transpose(2, 1, 0)
            added = np.zeros((n, blocks + 1, m + 1), complex)
            added[:, 0] = state
            added[:, 1:, :m] = (X[:m] @ self.parts[::-1] @ self.of_parts).transpose(2, 1, 0)
            starts = self.scan[:, : blocks + 1, : blocks + 1] @ added
            state = starts[:, -1]
            free = starts[:, :-1] - added[:, 1:] / (1 - self.around)[:, None, None]
            sums += free.transpose(0, 2, 1) @ weighted
        rest = (len(w) - 1) % size + 1  # samples of the last block
        last = starts[:, -2].T * self.modes**rest
        last[:m] += X[:m, -1, :rest] @ self.powers[rest - 1 :: -1]
        return sums, last


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
