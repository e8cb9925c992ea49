"""Derivatives of each class of models with respect to its parameters, by filtering, a block of samples at a time.

`blocks` and `frf_derivatives` dispatch on the class of the model; a class from elsewhere joins by `blocks.register` and
`frf_derivatives.register`. What to do with the derivatives is in excite.numerics.sensitivity.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from excite.errors import ExciteError
from excite.models.fir import FirModel
from excite.models.foster import FosterModel
from excite.models.model import Parametric, Record
from excite.models.polynomial import COEFFICIENTS, Branch, PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import BLOCK, observability, rational, recurrence, states

VALUES = 2_000_000  # doubles that the derivatives of one block fill, 16 MB
ONE = np.ones(1)  # the polynomial 1


@dataclass(frozen=True, eq=False)
class Block:
    """Some samples of a record: residuals and derivatives.

    start : first sample; residuals : y - yhat (T, ny); parts : for each output i, the columns (p_i,) of theta that move it
    and d yhat_i / d theta there, (T, p_i); the derivative by all other parameters is zero.
    """

    start: int
    residuals: np.ndarray
    parts: tuple[tuple[np.ndarray, np.ndarray], ...]


@singledispatch
def blocks(model: Parametric, record: Record, x0: np.ndarray | None = None, initial: bool = False) -> Iterator[Block]:
    """Yield the residuals of the one-step prediction and its derivatives, block by block through the record.

    x0 : state at the first sample, zero when not given; initial : append the derivatives by x0 as further parameters.
    A model without noise part is taken as its own predictor (output error): the derivatives are those of its simulation.
    """
    raise ExciteError(
        f"{type(model).__name__}: no derivatives by parameters are known; register them, or choose another model"
    )


@singledispatch
def frf_derivatives(model: Parametric, f_hz: np.ndarray) -> np.ndarray:
    """Return dG(f) / d theta as (F, ny, nu, p), complex, at f_hz (F,)."""
    raise ExciteError(
        f"{type(model).__name__}: no derivatives by parameters are known; register them, or choose another model"
    )


def _stretches(count: int, width: int) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) of blocks whose derivatives, `width` a sample, fill about VALUES doubles."""
    size = max(1, VALUES // (max(width, 1) * BLOCK)) * BLOCK
    for start in range(0, count, size):
        yield start, min(start + size, count)


# ---------------------------------------------------------------------------------------------------- state space
@blocks.register
def _(model: StateSpaceModel, record: Record, x0: np.ndarray | None = None, initial: bool = False) -> Iterator[Block]:
    """Filter x, u and e through C (q I - A + K C)^-1: all derivatives of yhat are sums of these and of x, u themselves."""
    keys, (n, nu), ny = model.free(), model.B.shape, len(model.C)
    K = np.zeros((n, ny)) if model.K is None else model.K
    A, B = model.A - K @ model.C, np.hstack([model.B - K @ model.D, K])
    x = np.zeros(n) if x0 is None else np.asarray(x0, float)
    count = sum(getattr(model, key).size for key in keys) + n * initial
    columns, free = np.arange(count), model.C
    M = np.zeros((n + nu + ny, ny, n))
    for start, stop in _stretches(len(record.y), ny * (count + n * (nu + ny))):
        u, y = record.u[start:stop] - model.input_offset, record.y[start:stop] - model.output_offset
        X = states(A, B, np.hstack([u, y]), x)
        e = y - X @ model.C.T - u @ model.D.T
        H, M = _filtered(A, model.C, np.hstack([X, u, e]), M)
        by_x, by_u, by_e = H[..., :n], H[..., n : n + nu], H[..., n + nu :]
        found = {"A": by_x, "B": by_u, "C": -(K.T @ by_x), "D": -(K.T @ by_u), "K": by_e}
        for i in range(ny):
            found["C"][i, :, i] += X
            found["D"][i, :, i] += u
        J = [found[key].reshape(ny, len(y), -1) for key in keys]
        if initial:
            J.append(observability(A, free, len(y)).transpose(1, 0, 2))
            free = free @ np.linalg.matrix_power(A, len(y))
        yield Block(start, e, tuple((columns, each) for each in np.concatenate(J, axis=2)))
        x = A @ X[-1] + B @ np.concatenate([u[-1], y[-1]])


def _filtered(A: np.ndarray, C: np.ndarray, s: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return H (ny, T, n, m) with H(t) = sum_{k < t} C A^(t-1-k) s(k), for each of the m signals s (T, m), and its state.

    M : the state (m, ny, n) that M(t+1) = M(t) A + C s(t) has reached before the first sample. Lifted as `simulate` is. The
    state returned is that after the last whole stretch of BLOCK samples, from which to go on when T is a multiple of it.
    """
    (ny, n), (T, m), L = C.shape, s.shape, BLOCK
    stretches = -(-T // L)
    padded = np.zeros((stretches * L, m))
    padded[:T] = s
    S = padded.reshape(stretches, L, m).transpose(0, 2, 1)
    response = np.concatenate([np.zeros((L, ny, n)), observability(A, C, L)])
    lag = L - 1 + np.arange(L)[None, :] - np.arange(L)[:, None]  # of the sample that is filtered (row) to its effect
    H = S @ response[lag].reshape(L, L * ny * n)
    drive = (S @ response[L:][::-1].reshape(L, ny * n)).reshape(stretches, m, ny, n)
    powers = observability(A, np.eye(n), L)
    step, starts = A @ powers[-1], np.empty((stretches + 1, m, ny, n))
    starts[0] = M
    for k in range(stretches):
        starts[k + 1] = starts[k] @ step + drive[k]
    H = H.reshape(stretches, m, L, ny, n)
    H += np.einsum("bmoi,lij->bmloj", starts[:-1], powers, optimize=True)
    return H.transpose(3, 0, 2, 4, 1).reshape(ny, stretches * L, n, m)[:, :T], starts[-1]


@frf_derivatives.register
def _(model: StateSpaceModel, f_hz: np.ndarray) -> np.ndarray:
    """dG = C R dA R B + C R dB + dC R B + dD with R = (z I - A)^-1."""
    z = np.exp(2j * np.pi * np.atleast_1d(f_hz) * model.dt)
    (n, nu), ny = model.B.shape, len(model.C)
    R = np.linalg.inv(z[:, None, None] * np.eye(n) - model.A)
    left, right = model.C @ R, R @ model.B
    found = {
        "A": np.einsum("foi,fjc->focij", left, right),
        "B": np.einsum("foi,jc->focij", left, np.eye(nu)),
        "C": np.einsum("oi,fjc->focij", np.eye(ny), right),
        "D": np.broadcast_to(np.einsum("oi,jc->ocij", np.eye(ny), np.eye(nu)), (len(z), ny, nu, ny, nu)),
        "K": np.zeros((len(z), ny, nu, n, ny)),
    }
    return np.concatenate([found[key].reshape(len(z), ny, nu, -1) for key in model.free()], axis=3)


# ---------------------------------------------------------------------------------------------------- polynomial
class _Lagged:
    """Columns of theta that all move one output by the same filtered signal, each at a lag of its own.

    prepare : makes the signal of a source (u_j, y_j, e_i, or a pulse at sample 0), None where it is the source itself; its
    state, that of the filter and the last `depth` samples go on from block to block.
    """

    def __init__(self, source: tuple[str, int], numerator: np.ndarray, denominator: np.ndarray, sign: float) -> None:
        self.source, self.sign = source, sign
        self.stages: list[list] = [[numerator, denominator, None]]
        self.lags = self.columns = np.empty(0, int)
        self.past = np.zeros(0)

    def after(self, numerator: np.ndarray, denominator: np.ndarray, x0: np.ndarray | None) -> "_Lagged":
        """Put another filter, with its initial state, before this one."""
        self.stages.insert(0, [numerator, denominator, x0])
        return self

    def at(self, lags: np.ndarray, columns: np.ndarray) -> "_Lagged":
        """Say which lags move which columns of theta."""
        self.lags, self.columns, self.past = lags, columns, np.zeros(int(lags.max()))
        return self

    def __call__(self, signals: dict[tuple[str, int], np.ndarray]) -> np.ndarray:
        """Return the derivatives of the next block, (T, len(lags))."""
        signal = signals[self.source]
        for stage in self.stages:
            if len(stage[0]) > 1 or len(stage[1]) > 1:
                signal, stage[2] = rational(stage[0], stage[1], signal, stage[2])
            else:
                signal = stage[0][0] * signal
        depth, window = len(self.past), np.concatenate([self.past, signal])
        self.past = window[len(signal) :]
        return self.sign * np.stack([window[depth - k : depth - k + len(signal)] for k in self.lags], axis=1)


@blocks.register
def _(model: PolynomialModel, record: Record, x0: np.ndarray | None = None, initial: bool = False) -> Iterator[Block]:
    """Filter y, u, w = (B / F) u, e and v = (C / D) e by D / C, 1 / F and 1 / C (Ljung 1999, eq. 10.54), and lag them."""
    residuals = model.innovations(record, x0)
    groups = _lagged(model, None if x0 is None else np.asarray(x0, float), initial)
    u, y = record.u - model.input_offset, record.y - model.output_offset
    count = sum(len(group.columns) for groups_of_output in groups for group in groups_of_output)
    for start, stop in _stretches(len(y), count):
        named = {"u": u[start:stop], "y": y[start:stop], "e": residuals[start:stop]}
        signals = {(key, j): signal for key, values in named.items() for j, signal in enumerate(values.T)}
        signals["pulse", 0] = (np.arange(start, stop) == 0).astype(float)
        parts = []
        for each in groups:
            columns = np.concatenate([np.empty(0, int), *(group.columns for group in each)])
            parts.append((columns, np.hstack([np.empty((stop - start, 0)), *(group(signals) for group in each)])))
        yield Block(start, residuals[start:stop], tuple(parts))


def _lagged(model: PolynomialModel, x0: np.ndarray | None, initial: bool) -> list[list[_Lagged]]:
    """Return for each output what moves it."""
    ny = len(model.outputs)
    groups: list[list[_Lagged]] = [[] for _ in range(ny)]
    branches: dict[tuple, Branch] = {("f", b.row, b.column): b for b in model.input_filters} | {
        ("d", b.row): b for b in model.noise_filters
    }
    for key, place, lags, columns in _columns(model):
        i, j = place[0], place[-1]
        c, d = model.c[:, i], model.d[:, i]
        pair = np.convolve(c, model.f[:, i, j]) if key in "bf" else c
        group = {
            "a": _Lagged(("y", j), d, c, -1.0),
            "b": _Lagged(("u", j), d, pair, 1.0),
            "c": _Lagged(("e", i), ONE, c, 1.0),
            "d": _Lagged(("e", i), ONE, c, -1.0),
            "f": _Lagged(("u", j), d, pair, -1.0),
        }[key]
        if branch := branches.get((key, *place)):
            group.after(branch.numerator, branch.denominator, None if x0 is None else x0[branch.states])
        elif key in "df":  # the filter is 1, but a coefficient of it is free
            group.after(c if key == "d" else model.b[:, i, j], ONE, None)
        groups[i].append(group.at(lags, columns))
    if initial:
        p = len(model.places())
        for i, held in enumerate(np.arange(model.lags * ny).reshape(model.lags, ny).T if model.lags else ()):
            groups[i].append(
                _Lagged(("pulse", 0), model.d[:, i], model.c[:, i], 1.0).at(np.arange(model.lags), p + held)
            )
        for (key, i, *_), (*_, denominator, within) in branches.items():
            c, states = model.c[:, i], np.arange(within.start, within.stop)
            filters = (model.d[:, i], np.convolve(c, denominator)) if key == "f" else (ONE, c)
            groups[i].append(_Lagged(("pulse", 0), filters[0], filters[1], 1.0).at(states - within.start, p + states))
    return groups


def _columns(model: PolynomialModel) -> Iterator[tuple[str, tuple[int, ...], np.ndarray, np.ndarray]]:
    """Yield (polynomial, its output and input, lags, columns of theta) of the coefficients that are free."""
    column = np.full(len(model.coefficients()), -1)
    column[model.places()] = np.arange(len(model.places()))
    begin = 0
    for key, first in COEFFICIENTS.items():
        shape = getattr(model, key)[first:].shape
        end = begin + int(np.prod(shape))
        mine, begin = column[begin:end].reshape(shape), end
        for place in np.ndindex(shape[1:]):
            of_place = mine[:, *place]
            if (kept := np.flatnonzero(of_place >= 0)).size:
                yield key, place, kept + first, of_place[kept]


@frf_derivatives.register
def _(model: PolynomialModel, f_hz: np.ndarray) -> np.ndarray:
    """dG = A^-1 (d(B / F) - dA G)."""
    f_hz = np.atleast_1d(f_hz)
    inverse, b, f = np.linalg.inv(model.polynomial("a", f_hz)), model.polynomial("b", f_hz), model.polynomial("f", f_hz)
    G, turn = inverse @ (b / f), np.exp(-2j * np.pi * model.dt * f_hz)
    found = np.zeros((len(f_hz), *G.shape[1:], len(model.places())), complex)
    for key, place, lags, columns in _columns(model):
        i, j = place[0], place[-1]
        delayed = turn[:, None] ** lags
        if key == "a":
            found[..., columns] -= np.einsum("fo,fc,fk->fock", inverse[:, :, i], G[:, j], delayed)
        elif key in "bf":
            by_w = 1 / f[:, i, j] if key == "b" else -b[:, i, j] / f[:, i, j] ** 2
            found[:, :, j, columns] += np.einsum("fo,f,fk->fok", inverse[:, :, i], by_w, delayed)
    return found


# ---------------------------------------------------------------------------------------------------- FIR, Foster
@blocks.register
def _(model: FirModel, record: Record, x0: np.ndarray | None = None, initial: bool = False) -> Iterator[Block]:
    """All outputs are moved by the same inputs, at the lags of the taps; x0 holds the inputs before the record."""
    (count, ny, nu), before = model.h.shape, len(model.h) - 1
    past = np.zeros((before, nu)) if x0 is None else np.reshape(x0, (before, nu))[::-1]
    u = np.concatenate([past, record.u - model.input_offset])
    residuals = record.y - model.simulate(record.u, x0)
    columns = np.arange(model.h.size).reshape(model.h.shape)
    onward = np.concatenate([model.h, np.zeros((before, ny, nu))])  # taps that the inputs before the record still reach
    for start, stop in _stretches(len(residuals), ny * (model.h.size // ny + model.order * initial)):
        lagged = np.lib.stride_tricks.sliding_window_view(u[start : stop + before], count, axis=0)[..., ::-1]
        J = lagged.transpose(0, 2, 1).reshape(stop - start, count * nu)
        parts = [(columns[:, i].ravel(), J) for i in range(ny)]
        if initial:
            lag = np.arange(start, stop)[:, None] + 1 + np.arange(before)
            taps = onward[np.minimum(lag, len(onward) - 1)] * (lag < count)[:, :, None, None]
            states = model.h.size + np.arange(model.order)
            parts = [
                (np.concatenate([mine, states]), np.hstack([J, taps[:, :, i].reshape(len(J), -1)]))
                for i, (mine, J) in enumerate(parts)
            ]
        yield Block(start, residuals[start:stop], tuple(parts))


@frf_derivatives.register
def _(model: FirModel, f_hz: np.ndarray) -> np.ndarray:
    """dG_ij / dh_k,ij = exp(-j 2 pi f dt k)."""
    (count, ny, nu), f_hz = model.h.shape, np.atleast_1d(f_hz)
    turns = np.exp(-2j * np.pi * model.dt * np.outer(f_hz, np.arange(count)))
    found = np.einsum("fk,oi,cj->fockij", turns, np.eye(ny), np.eye(nu))
    return found.reshape(len(f_hz), ny, nu, model.h.size)


@blocks.register
def _(model: FosterModel, record: Record, x0: np.ndarray | None = None, initial: bool = False) -> Iterator[Block]:
    """The lags x_i by R_i; by log tau_i, z(k+1) = a z(k) + a (step / tau) (x(k) - u(k)) with a = exp(-step / tau)."""
    (n, ny, nu), tau, time = model.R.shape, model.tau[:, None], record.time_s
    x, z = np.zeros(n * nu) if x0 is None else np.asarray(x0, float), np.zeros((n, nu))
    columns, lags = np.arange(model.R.size).reshape(model.R.shape), model.R.size + np.arange(n)
    states = model.R.size + n + np.arange(model.order)
    for start, stop in _stretches(len(time), ny * (n * nu + n + model.order * initial)):
        to = min(stop + 1, len(time))  # one further sample, with which the next block begins
        u = record.u[start:to]
        X = model.states(u, time[start:to], x)
        ratio = np.diff(time[start:to])[:, None, None] / tau
        decay = np.exp(-ratio)
        Z = recurrence(decay, decay * ratio * (X[:-1] - (u - model.input_offset)[:-1, None]), z)
        x, z, X, Z = X[-1].ravel(), Z[-1], X[: stop - start], Z[: stop - start]
        residuals = record.y[start:stop] - model.output_offset - np.einsum("tij,ioj->to", X, model.R)
        fading = np.exp(-(time[start:stop] - time[0])[:, None, None] / tau)
        parts = []
        for i in range(ny):
            J = [X.reshape(len(X), -1), np.einsum("tij,ij->ti", Z, model.R[:, i])]
            mine = [columns[:, i].ravel(), lags]
            if initial:
                J, mine = [*J, (fading * model.R[:, i]).reshape(len(X), -1)], [*mine, states]
            parts.append((np.concatenate(mine), np.hstack(J)))
        yield Block(start, residuals, tuple(parts))


@frf_derivatives.register
def _(model: FosterModel, f_hz: np.ndarray) -> np.ndarray:
    """dG / dR_i = 1 / (1 + s tau_i), dG / d log tau_i = -R_i s tau_i / (1 + s tau_i)^2."""
    (_, ny, nu), f_hz = model.R.shape, np.atleast_1d(f_hz)
    turn = 2j * np.pi * np.outer(f_hz, model.tau)
    by_R = np.einsum("fn,oi,cj->focnij", 1 / (1 + turn), np.eye(ny), np.eye(nu)).reshape(len(f_hz), ny, nu, -1)
    by_tau = np.einsum("fn,noc->focn", -turn / (1 + turn) ** 2, model.R)
    return np.concatenate([by_R, by_tau], axis=3)
