"""B, D and x0 by linear least squares over all samples, given A, C and a predictor gain."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.hankel import append_rows, cholesky, condition_of
from excite.types.experiment import Experiment

BLOCK = 16  # samples lifted at once: the Gram matrices grow with them, the scan from block to block shrinks
CHUNK_VALUES = 262_144  # doubles of lifted data held at once, 2 MB
NORMAL_CONDITION = 1e4  # up to it the normal equations hold eight digits of the solution
FADED = 1e-20  # of its beginning: what the initial state adds to the output by then is lost in rounding
MODAL_CONDITION = 1e3  # of the eigenvectors: up to it sums over modes hold ten digits, squared


@dataclass(frozen=True, eq=False)
class InputMatrices:
    """B (n, nu), D (ny, nu), x0 one (n,) an experiment."""

    B: np.ndarray
    D: np.ndarray
    x0: tuple[np.ndarray, ...]


def input_matrices(
    experiments: tuple[Experiment, ...], A: np.ndarray, C: np.ndarray, K: np.ndarray, feedthrough: bool
) -> InputMatrices:
    """Fit B, D, x0 of y = C (qI - Ak)^-1 [(B - K D) u + K y] + D u + C Ak^t x0 + e, with Ak = A - K C.

    K = 0 makes it the simulation (output-error) fit of open-loop data; with K it is the one-step predictor, the only
    consistent choice in closed loop. The regressors come from the dual system: z_lj(t+1) = Ak^T z_lj(t) + C_l^T u_j(t)
    gives the response of output l to column j of B as z_lj^T B_j, and rho_l(t) = (Ak^T)^t C_l^T gives that to x0. One
    dual system serves all outputs where Ak is diagonalisable (`_Dual`), else there is one an output.

    Within a block of samples the rows phi(t) = [z_1 … z_nu, rho, u](t) are linear in what the block starts from and its u,
    so that the normal equations need only the Gram matrix of those; where their condition is too large for that, the
    rows themselves are decomposed by QR, chunk after chunk.
    """
    n, ny, nu = len(A), len(C), experiments[0].u.shape[1]
    shared = n * nu + (ny * nu if feedthrough else 0)
    unknowns = shared + n * len(experiments)
    dual = _Dual(A - K @ C, C, K, nu)
    places = [
        [_places(l, dual.maps[l], K, nu, feedthrough, unknowns, shared + e * n) for l in range(ny)]
        for e in range(len(experiments))
    ]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable Ak may overflow: the result then is not finite
        theta = _by_normal_equations(experiments, dual, places)
        if theta is None:
            theta = _by_qr(experiments, dual, places)
    B, D, x0 = np.split(theta, [n * nu, shared])
    D = D.reshape(nu, ny).T if feedthrough else np.zeros((ny, nu))
    return InputMatrices(B.reshape(nu, n).T, D, tuple(x0.reshape(len(experiments), n)))


def _places(
    l: int, to_output: np.ndarray, K: np.ndarray, nu: int, feedthrough: bool, unknowns: int, at_x0: int
) -> np.ndarray:
    """T (p, unknowns) with phi(t) T the row of output l in the whole problem: B and D by columns, then each x0."""
    n, ny = K.shape
    T = np.zeros(((nu + 1) * n + nu, unknowns))
    T[nu * n : (nu + 1) * n, at_x0 : at_x0 + n] = to_output
    for j in range(nu):
        z_j = slice(j * n, (j + 1) * n)
        T[z_j, z_j] = to_output
        if feedthrough:  # column j of D acts on y directly, and through -K D on the state
            D_j = slice(nu * n + j * ny, nu * n + (j + 1) * ny)
            T[z_j, D_j] = -to_output @ K
            T[(nu + 1) * n + j, D_j][l] = 1
    return T


def _by_normal_equations(
    experiments: tuple[Experiment, ...], dual: "_Dual", places: list[list[np.ndarray]]
) -> np.ndarray | None:
    """Return the least-squares solution, or None where the condition is too large."""
    unknowns = places[0][0].shape[1]
    N, b = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for experiment, own_places in zip(experiments, places, strict=True):
        sums = {}
        for blocks in dual.blocks(experiment):
            products, shape = blocks.products(), (blocks.S.shape[2], blocks.Y.shape[2])
            sums[shape] = [a + p for a, p in zip(sums[shape], products, strict=True)] if shape in sums else products
        for shape, (grams, on_y) in sums.items():
            for g, outputs in enumerate(dual.outputs):
                G = dual.rows_of(g, *shape)
                phi = G.reshape(-1, G.shape[2])
                own = phi.T @ np.tensordot(grams[g], G, 1).reshape(phi.shape)
                for l in outputs:
                    N += own_places[l].T @ own @ own_places[l]
                    b += on_y[l].ravel() @ phi @ own_places[l]
    scale = np.sqrt(np.diag(N))
    if not (np.isfinite(scale).all() and scale.all()):
        return None
    L = cholesky(N / np.outer(scale, scale))
    if L is None or condition_of(L) > NORMAL_CONDITION:
        return None
    return la.cho_solve((L, True), b / scale, check_finite=False) / scale


def _by_qr(experiments: tuple[Experiment, ...], dual: "_Dual", places: list[list[np.ndarray]]) -> np.ndarray:
    """Return the least-squares solution, of least norm where it is not unique."""
    p, unknowns = places[0][0].shape
    R = np.zeros((unknowns + 1, unknowns + 1), order="F")
    for experiment, own_places in zip(experiments, places, strict=True):
        own = [np.zeros((p + len(outputs), p + len(outputs)), order="F") for outputs in dual.outputs]
        for blocks in dual.blocks(experiment):
            for g, outputs in enumerate(dual.outputs):
                G = dual.rows_of(g, blocks.S.shape[2], blocks.Y.shape[2])
                phi = np.tensordot(np.hstack([blocks.S[g], blocks.U]), G, 1).reshape(-1, p)
                own[g] = append_rows(own[g], np.hstack([phi, blocks.Y[outputs].reshape(len(outputs), -1).T]))
        for R_g, outputs in zip(own, dual.outputs, strict=True):
            for i, l in enumerate(outputs):
                R = append_rows(R, np.column_stack([R_g[:p, :p] @ own_places[l], R_g[:p, p + i]]))
    if not np.isfinite(R).all():
        return np.full(unknowns, np.nan)
    scale = np.linalg.norm(R[:, :-1], axis=0)
    scale[scale == 0] = 1.0
    return la.lstsq(R[:, :-1] / scale, R[:, -1], cond=1e-12, check_finite=False)[0] / scale


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Successive blocks of one record.

    S (g, blocks, s) : z_1 … z_nu, and rho until it has faded, of each dual system at the blocks' starts, s = nu n or
    (nu + 1) n; U (blocks, BLOCK nu) : inputs;
    Y (ny, blocks, steps) : what the phi are to explain, steps being BLOCK but for a last block that the record leaves open.
    """

    S: np.ndarray
    U: np.ndarray
    Y: np.ndarray

    def products(self) -> list[np.ndarray]:
        """Gram matrices of x = [S, U], (g, q, q), and products x^T Y, (ny, q, steps), summed over the blocks."""
        (g, _, s), St = self.S.shape, self.S.transpose(0, 2, 1)
        q = s + self.U.shape[1]
        grams, on_y = np.empty((g, q, q)), np.empty((len(self.Y), q, self.Y.shape[2]))
        for gram, S in zip(grams, self.S, strict=True):
            gram[:s, :s] = S.T @ S
        grams[:, :s, s:], grams[:, s:, s:] = St @ self.U, self.U.T @ self.U
        on_y[:, :s], on_y[:, s:] = St @ self.Y, self.U.T @ self.Y
        grams[:, s:, :s] = grams[:, :s, s:].transpose(0, 2, 1)
        return [grams, on_y]


@dataclass(frozen=True, eq=False)
class _Dual:
    """Dual systems z(t+1) = Ak^T z(t) + b u_j(t) over blocks of BLOCK samples: in a block, phi(t + i) = x G[:, i].

    With Ak^T = V diag(lambda) V^-1 and b the sum of all eigenvectors, the response to C_l^T is T_l times that to b,
    T_l = V diag(V^-1 C_l^T) V^-1: one system serves all outputs. Where V is ill-conditioned each output has its own, b = C_l^T.
    """

    Ak: np.ndarray
    C: np.ndarray
    K: np.ndarray
    nu: int

    @cached_property
    def _modal(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Generator b^T (1, n) and maps T_l^T (ny, n, n) of one system for all outputs, or None."""
        if len(self.C) == 1:
            return None
        V = la.eig(self.Ak.T)[1]
        if np.linalg.cond(V) > MODAL_CONDITION:
            return None
        inverse = la.inv(V)
        maps = (V * (inverse @ self.C.T).T[:, None, :]) @ inverse
        return V.sum(1).real[None], maps.real.transpose(0, 2, 1)

    @cached_property
    def generators(self) -> np.ndarray:
        """The b^T of each system, (g, n)."""
        return self._modal[0] if self._modal else self.C

    @cached_property
    def maps(self) -> np.ndarray:
        """T_l^T (ny, n, n): z_l^T = z^T T_l^T."""
        return self._modal[1] if self._modal else np.broadcast_to(np.eye(len(self.Ak)), (len(self.C), *self.Ak.shape))

    @cached_property
    def outputs(self) -> list[list[int]]:
        """Which outputs each system serves."""
        each = list(range(len(self.C)))
        return [each] if self._modal else [[l] for l in each]

    @cached_property
    def responses(self) -> np.ndarray:
        """b^T Ak^i (BLOCK, g, n)."""
        return lti.observability(self.Ak, self.generators, BLOCK)

    @cached_property
    def powers(self) -> np.ndarray:
        """Ak^i (BLOCK + 1, n, n)."""
        return lti.observability(self.Ak, np.eye(len(self.Ak)), BLOCK + 1)

    def rows_of(self, g: int, s: int, steps: int) -> np.ndarray:
        """G (q, steps, p) of system g for blocks of `steps` samples that start from s states."""
        return np.delete(self.rows[g][:, :steps], slice(s, (self.nu + 1) * len(self.Ak)), axis=0)

    @cached_property
    def rows(self) -> list[np.ndarray]:
        """G (q, BLOCK, p) of each system."""
        n, nu = len(self.Ak), self.nu
        lag = BLOCK - 1 + np.arange(BLOCK) - np.arange(BLOCK)[:, None]
        found = []
        for response in self.responses.transpose(1, 0, 2):
            G = np.zeros(((nu + 1) * n + BLOCK * nu, BLOCK, (nu + 1) * n + nu))
            for j in range(nu + 1):
                G[j * n : (j + 1) * n, :, j * n : (j + 1) * n] = self.powers[:-1].transpose(1, 0, 2)
            for j in range(nu):
                G[(nu + 1) * n + j :: nu, :, j * n : (j + 1) * n] = np.concatenate([np.zeros((BLOCK, n)), response])[lag]
                G[(nu + 1) * n + np.arange(BLOCK) * nu + j, np.arange(BLOCK), (nu + 1) * n + j] = 1
            found.append(G)
        return found

    def blocks(self, experiment: Experiment) -> Iterator[_Blocks]:
        """Yield the record's blocks, as many at once as CHUNK_VALUES allows."""
        n, ny, nu, g = len(self.Ak), len(self.C), self.nu, len(self.generators)
        start, x = np.zeros((nu + 1, g, n)), np.zeros(n)
        start[nu] = self.generators
        reach = self.responses[::-1].reshape(BLOCK, g * n)
        reach_y = (self.powers[BLOCK - 1 :: -1] @ self.K).transpose(0, 2, 1).reshape(-1, n)
        size = BLOCK * max(1, CHUNK_VALUES // (g * (nu + 1) * n + BLOCK * (nu + ny)))
        whole = len(experiment) // BLOCK * BLOCK
        for first in [*range(0, whole, size), *([whole] if whole < len(experiment) else [])]:
            u, y = (w[first : min(first + size, whole) if first < whole else None] for w in (experiment.u, experiment.y))
            steps = min(len(u), BLOCK)
            if steps < BLOCK:
                u, y = (np.vstack([w, np.zeros((BLOCK - steps, w.shape[1]))]) for w in (u, y))
            blocks = len(u) // BLOCK
            if self.K.any():
                driven = lti.simulate(self.Ak, self.K, self.C, np.zeros((ny, ny)), y, x)
                x = _scan(self.powers[-1].T, y.reshape(blocks, -1) @ reach_y, x)[-1]
                y = y - driven
            by_input = u.reshape(blocks, BLOCK, nu).transpose(0, 2, 1).reshape(-1, BLOCK)
            drive = np.zeros((blocks, *start.shape))
            drive[:, :nu] = (by_input @ reach).reshape(blocks, nu, g, n)
            starts = _scan(self.powers[-1], drive, start)
            start = starts[-1]
            S = starts[:-1].transpose(2, 0, 1, 3).reshape(g, blocks, -1)
            Y = np.ascontiguousarray(y.reshape(blocks, BLOCK, ny)[:, :steps].transpose(2, 0, 1))
            yield _Blocks(S, u.reshape(blocks, -1), Y)
            if np.abs(start[nu:]).max(initial=0.0) < FADED * np.abs(self.generators).max():
                start = start[:nu]


def _scan(step: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States s(0) = start, s(b+1) = s(b) step + drive(b), (blocks + 1, …, n): pairs of steps first, then those between."""
    s = np.empty((len(drive) + 1, *start.shape))
    s[0] = start
    if len(drive):
        even, odd = drive[::2], drive[1::2]
        s[::2] = _scan(step @ step, _times(even[: len(odd)], step) + odd, start)
        s[1::2] = _times(s[::2][: len(even)], step) + even
    return s


def _times(rows: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Product of all row vectors with one matrix, as a single matrix product."""
    return (rows.reshape(-1, len(step)) @ step).reshape(rows.shape)
