"""Polynomial models: ARX, ARMAX, output error, Box-Jenkins and what lies between them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from excite.errors import ExciteError
from excite.models.arrays import covariance, finite, input_samples, offset, read_only
from excite.models.model import Parametric, Predictor, Record, check_horizons
from excite.models.state_space import StateSpaceModel, poles_of
from excite.numerics.simulate import divide, fir, rational
from excite.types.channel import Channels, channels_for, positive
from excite.types.checked import NOT_GIVEN, ArrayByDefault, OptionalArray

COEFFICIENTS = {"a": 1, "b": 0, "c": 1, "d": 1, "f": 1}  # lag of the first coefficient that is not fixed at one


class Branch(NamedTuple):
    """A rational filter of its own between one input (an input u_j, or an innovation e_i) and one row of A(q) y.

    row, column : output i and input j (or i); numerator, denominator : without trailing zeros, the latter monic; states :
    those of its observer form, as a slice of the model's state.
    """

    row: int
    column: int
    numerator: np.ndarray
    denominator: np.ndarray
    states: slice


@dataclass(frozen=True, eq=False)
class PolynomialModel(Predictor, Parametric):
    """Polynomial model A(q) (y - y0) = [B_ij(q) / F_ij(q)] (u - u0) + diag[C_i(q) / D_i(q)] e.

    y(t) + A_1 y(t-1) + … = sum_j (B_ij / F_ij) u_j(t) + (C_i / D_i) e_i(t): Ljung, System Identification, 2nd ed. 1999,
    eq. 4.33, with a full matrix A. ARX has A and B alone, ARMAX also C, output error B and F, Box-Jenkins all but A.

    Parameters
    ----------
    a : (na + 1, ny, ny), a[0] = I, and b : (nb + 1, ny, nu), coefficients by lag
    dt : sampling time, s
    innovation_cov : covariance of e (ny, ny), or None
    c, d : (lags + 1, ny), f : (lags + 1, ny, nu), monic: ones at lag 0; None stands for the polynomial 1
    input_offset, output_offset : operating point u0 (nu,), y0 (ny,)
    free : which coefficients `theta` holds, booleans over a[1:], b, c[1:], d[1:], f[1:] in this order, row by row; None:
        all that are not exactly zero, because zeros are structure (dead time, padding)

    The state x0 of `simulate` and `predict` is that of `to_state_space`: first ny lags values of the observer form, which
    add to the right side of the equation of samples 0, 1, … (lags (ny,) blocks); then the states of each filter 1 / F_ij
    (row by row) and 1 / D_i of degree one or more.

    >>> model = PolynomialModel([[[1.0]], [[-0.5]]], [[[0.0]], [[2.0]]], dt=0.1)  # y(t) = 0.5 y(t-1) + 2 u(t-1) + e(t)
    >>> model.impulse(4).ravel()
    array([0. , 2. , 1. , 0.5])
    """

    a: np.ndarray
    b: np.ndarray
    dt: float
    innovation_cov: OptionalArray = NOT_GIVEN
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN
    c: ArrayByDefault = NOT_GIVEN
    d: ArrayByDefault = NOT_GIVEN
    f: ArrayByDefault = NOT_GIVEN
    input_offset: ArrayByDefault = NOT_GIVEN
    output_offset: ArrayByDefault = NOT_GIVEN
    free: OptionalArray = NOT_GIVEN

    def __post_init__(self) -> None:
        def put(key: str, value: object) -> None:
            object.__setattr__(self, key, value)

        put("b", finite(self.b, (None, None, None), "PolynomialModel.b"))
        if 0 in (self.b.shape[:2]):
            raise ExciteError(f"PolynomialModel.b: shape {self.b.shape}; expected (lags + 1, outputs, inputs)")
        _, ny, nu = self.b.shape
        for key, shape in {"a": (ny, ny), "c": (ny,), "d": (ny,), "f": (ny, nu)}.items():
            one = np.eye(ny) if key == "a" else np.ones(shape)
            value = one[None] if getattr(self, key) is None else getattr(self, key)
            put(key, finite(value, (None, *shape), f"PolynomialModel.{key}"))
            if not np.array_equal(getattr(self, key)[:1], one[None]):
                raise ExciteError(
                    f"PolynomialModel.{key}: the first coefficient must be the identity (ones); divide by it"
                )
        put("dt", positive(self.dt, "PolynomialModel.dt"))
        put("inputs", channels_for(nu, self.inputs, "u"))
        put("outputs", channels_for(ny, self.outputs, "y"))
        put("innovation_cov", covariance(self.innovation_cov, ny, "PolynomialModel.innovation_cov"))
        put("input_offset", offset(self.input_offset, nu, "PolynomialModel.input_offset"))
        put("output_offset", offset(self.output_offset, ny, "PolynomialModel.output_offset"))
        if self.free is not None:
            free, count = np.array(self.free, bool), len(self.coefficients())
            if free.shape != (count,):
                raise ExciteError(f"PolynomialModel.free: shape {free.shape}; expected ({count},), one per coefficient")
            put("free", read_only(free))

    # ------------------------------------------------------------------------------------------------ structure
    @cached_property
    def input_filters(self) -> tuple[Branch, ...]:
        """The pairs (i, j) whose F_ij is not 1, row by row."""
        places = ((i, j, self.b[:, i, j], self.f[:, i, j]) for i, j in np.ndindex(self.f.shape[1:]))
        return tuple(self._branches(places, self.lags * len(self.outputs)))

    @cached_property
    def noise_filters(self) -> tuple[Branch, ...]:
        """The outputs whose D_i is not 1."""
        places = ((i, i, self.c[:, i], self.d[:, i]) for i in range(len(self.outputs)))
        begin = self.input_filters[-1].states.stop if self.input_filters else self.lags * len(self.outputs)
        return tuple(self._branches(places, begin))

    @staticmethod
    def _branches(places: Iterator[tuple[int, int, np.ndarray, np.ndarray]], begin: int) -> Iterator[Branch]:
        for row, column, numerator, denominator in places:
            if np.any(denominator[1:]):
                numerator, denominator = _trimmed(numerator), _trimmed(denominator)
                end = begin + max(len(numerator), len(denominator)) - 1
                yield Branch(row, column, numerator, denominator, slice(begin, end))
                begin = end

    @cached_property
    def _direct(self) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of B where F_ij = 1, and of C where D_i = 1: what enters the observer form of A."""
        shared, plain = not_one(self.f), not_one(self.d)
        return np.where(shared, 0.0, self.b), np.where(plain, 0.0, self.c)

    @cached_property
    def lags(self) -> int:
        """Lags of the observer form of A: those of A, of B where an F_ij is 1, of C where a D_i is 1."""
        b = 0 if not_one(self.f).all() and self.f.size else len(self.b) - 1
        c = 0 if not_one(self.d).all() else len(self.c) - 1
        return max(len(self.a) - 1, b, c)

    @property
    def is_arx(self) -> bool:
        """Whether C, D and F are all 1."""
        return not any(not_one(m).any() for m in (self.c, self.d, self.f))

    # ------------------------------------------------------------------------------------------------ filtering
    def simulate(self, u: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """Noise-free response (N, ny) to u (N, nu) from the state x0."""
        x = self._state(x0)
        w = self._right_side(input_samples(u, len(self.inputs), "PolynomialModel.simulate") - self.input_offset, x)
        if x is not None:
            still = np.zeros(len(w))
            for branch in self.noise_filters:
                w[:, branch.row] += rational(branch.numerator, branch.denominator, still, x[branch.states])[0]
        return divide(self.a, w) + self.output_offset

    def innovations(self, record: Record, x0: np.ndarray | None = None) -> np.ndarray:
        """Return the one-step prediction errors e = (D / C) (A y - (B / F) u) as (N, ny), from the state x0."""
        x = self._state(x0)
        e = fir(self.a, record.y - self.output_offset) - self._right_side(record.u - self.input_offset, x)
        filters = {branch.row: branch for branch in self.noise_filters}
        for i in np.flatnonzero(not_one(self.c) | not_one(self.d)).tolist():
            if i in filters:
                state = None if x is None else -x[filters[i].states]
                e[:, i] = rational(filters[i].denominator, filters[i].numerator, e[:, i], state)[0]
            else:
                e[:, i] = rational(np.ones(1), self.c[:, i], e[:, i])[0]
        return e

    def predictions(
        self, record: Record, horizons: Sequence[int], x0: np.ndarray | None = None
    ) -> tuple[np.ndarray, ...]:
        """Return yhat(t | t - h) as (N, ny) for each h of `horizons`, from the state x0 at the first sample.

        yhat(t | t - h) = y(t) - sum_{i < h} H_i e(t - i), H_i the impulse response of the noise model: the last h
        innovations are what the prediction cannot know (Ljung 1999, eq. 3.29 to 3.31). The first h - 1 samples are simulated.
        """
        check_horizons(horizons)
        e = self.innovations(record, x0)
        H = self.noise_impulse(min(max(horizons, default=1), max(len(e), 1)))
        return tuple(record.y - (e if horizon == 1 else fir(H[:horizon], e)) for horizon in horizons)

    def _state(self, x0: np.ndarray | None) -> np.ndarray | None:
        return None if x0 is None else finite(x0, (self.order,), "PolynomialModel: x0")

    def _right_side(self, u: np.ndarray, x: np.ndarray | None) -> np.ndarray:
        """Return A(q) y without noise: the inputs through B / F, and what the initial state x adds."""
        w = fir(self._direct[0], u)
        for branch in self.input_filters:
            state = None if x is None else x[branch.states]
            w[:, branch.row] += rational(branch.numerator, branch.denominator, u[:, branch.column], state)[0]
        if x is not None:
            ny = w.shape[1]
            w[: self.lags] += x[: self.lags * ny].reshape(self.lags, ny)[: len(w)]
        return w

    def impulse(self, count: int) -> np.ndarray:
        """Markov parameters as (count, ny, nu)."""
        pulses = np.zeros((len(self.inputs), count, len(self.inputs)))
        pulses[:, :1] = np.eye(len(self.inputs))[:, None]
        return _stacked([divide(self.a, self._right_side(u, None)) for u in pulses], (count, *self.b.shape[1:]))

    def noise_impulse(self, count: int) -> np.ndarray:
        """Impulse response of the noise model A^-1 C / D as (count, ny, ny)."""
        ny, pulse = len(self.outputs), np.eye(count, 1)[:, 0]
        w = np.zeros((ny, count, ny))
        for i in range(ny):
            w[i, :, i] = rational(self.c[:, i], self.d[:, i], pulse)[0]
        return _stacked([divide(self.a, each) for each in w], (count, ny, ny))

    # ------------------------------------------------------------------------------------------------ frequency, poles
    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response A^-1 [B_ij / F_ij] as (F, ny, nu) complex."""
        a, b, f = (self.polynomial(key, f_hz) for key in "abf")
        return np.linalg.solve(a, b / f)

    def noise_frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response A^-1 diag[C_i / D_i] of the noise model as (F, ny, ny) complex."""
        a, c, d = (self.polynomial(key, f_hz) for key in "acd")
        return np.linalg.solve(a, np.eye(len(self.outputs)) * (c / d)[:, None, :])

    def polynomial(self, key: str, f_hz: np.ndarray) -> np.ndarray:
        """Return the polynomial "a", "b", "c", "d" or "f" at f_hz (F,): sum_k m_k exp(-j 2 pi f dt k), complex."""
        coefficients = getattr(self, key)
        turns = -2j * np.pi * self.dt * np.outer(np.atleast_1d(f_hz), np.arange(len(coefficients)))
        return np.tensordot(np.exp(turns), coefficients, 1)

    def poles(self) -> np.ndarray:
        """Poles of the path from u to y (z-plane): of A, zero-padding poles at the origin included, and of the F_ij."""
        return self._poles.copy()

    @cached_property
    def _poles(self) -> np.ndarray:
        if not self.noise_filters:
            return self._space.poles()
        end = self.noise_filters[0].states.start
        return poles_of(self._space.A[:end, :end])

    # ------------------------------------------------------------------------------------------------ state space
    @property
    def order(self) -> int:
        """Number of states of `to_state_space`."""
        branches = (*self.input_filters, *self.noise_filters)
        return branches[-1].states.stop if branches else self.lags * len(self.outputs)

    def to_state_space(self) -> StateSpaceModel:
        """Return the observer form, exact and in innovation form: ny lags states, and those of each 1 / F_ij and 1 / D_i."""
        return self._space

    @cached_property
    def _space(self) -> StateSpaceModel:
        (_, ny, nu), n = self.b.shape, self.order
        held = ny * self.lags
        a = _padded(self.a, self.lags).reshape(held, ny)
        b, c = (_padded(m, self.lags) for m in self._direct)
        A, B, K = np.zeros((n, n)), np.zeros((n, nu)), np.zeros((n, ny))
        C = np.eye(ny, n) if self.lags else np.zeros((ny, n))
        A[:held, :held] = np.eye(held, k=ny)
        B[:held] = b.reshape(held, nu)
        K[:held] = (c[:, :, None] * np.eye(ny)).reshape(held, ny)
        for branches, drive, direct in ((self.input_filters, B, self.b[0]), (self.noise_filters, K, np.eye(ny))):
            for row, column, numerator, denominator, states in branches:
                length = states.stop - states.start
                f, g = _padded(denominator, length), _padded(numerator, length)
                C[row, states.start] = 1.0
                A[states, states] = np.eye(length, k=1)
                A[states, states.start] -= f
                drive[states, column] = g - f * direct[row, column]
        A[:held] -= a @ C  # y of the right side, in the states and inputs that make it up
        B[:held] -= a @ self.b[0]
        K[:held] -= a
        noise, offsets = (K, self.innovation_cov), (self.input_offset, self.output_offset)
        return StateSpaceModel(A, B, C, self.b[0], self.dt, *noise, self.inputs, self.outputs, *offsets)

    # ------------------------------------------------------------------------------------------------ parameters
    def coefficients(self) -> np.ndarray:
        """Return a[1:], b, c[1:], d[1:], f[1:], one after the other, each row by row."""
        return np.concatenate([getattr(self, key)[first:].ravel() for key, first in COEFFICIENTS.items()])

    def places(self) -> np.ndarray:
        """Return which of `coefficients` theta holds, as indices (p,)."""
        return np.flatnonzero(self.coefficients() if self.free is None else self.free)

    def theta(self) -> np.ndarray:
        """Return the free coefficients (`free`), in the order of `coefficients`."""
        return self.coefficients()[self.places()]

    def at(self, theta: np.ndarray) -> Self:
        """Return the model with other free coefficients; the same ones stay free, even at zero."""
        values, places = self.coefficients(), self.places()
        values[places] = finite(theta, places.shape, "PolynomialModel.at: theta")
        changed, begin = {}, 0
        for key, first in COEFFICIENTS.items():
            m = getattr(self, key).copy()
            m[first:] = values[begin : (begin := begin + m[first:].size)].reshape(m[first:].shape)
            changed[key] = m
        free = np.zeros(len(values), bool)
        free[places] = True
        return replace(self, **changed, free=free)


def not_one(polynomial: np.ndarray) -> np.ndarray:
    """Return which of the monic polynomials (lags + 1, …) are not the polynomial 1."""
    return np.any(polynomial[1:], axis=0)


def _trimmed(polynomial: np.ndarray) -> np.ndarray:
    """Return a polynomial (lags + 1,) without trailing zeros."""
    return polynomial[: np.flatnonzero(polynomial)[-1] + 1] if np.any(polynomial) else polynomial[:1]


def _padded(polynomial: np.ndarray, lags: int) -> np.ndarray:
    """Return the coefficients of lags 1 … `lags`, zero beyond those that are given."""
    padded = np.zeros((lags, *polynomial.shape[1:]))
    padded[: len(polynomial) - 1] = polynomial[1 : lags + 1]
    return padded


def _stacked(columns: list[np.ndarray], shape: tuple[int, int, int]) -> np.ndarray:
    """Return responses to one input each side by side, empty where there is no input."""
    return np.stack(columns, axis=2) if columns else np.empty(shape)
