"""What the subspace methods have in common: horizons, limits, the shared compressed data, and the way to a model."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as la

from excite.numerics.hankel import columns_of, largest_rows
from identify.data.records import Records
from identify.estimate import Estimate
from identify.state_space_method import StateSpaceMethod
from identify.steps.completion import Inputs, Noise, complete
from identify.steps.compression import PastFuture, compress, regress
from identify.steps.kalman import state_regression
from identify.steps.shift import Shift


@dataclass(frozen=True, eq=False)
class Subspace:
    """What a method finds before it knows the order; the model of order n takes the first n singular values.

    values : singular values; reader (k, m) : X = reader[:n] on_past Z_p, on_past (m, past rows) being I where it is None;
    gamma (future rows, k) or None : extended observability matrix, from whose first n columns A and C follow by shift
    invariance, else by regression on X.
    """

    values: np.ndarray
    reader: np.ndarray
    on_past: np.ndarray | None = None
    gamma: np.ndarray | None = None

    @classmethod
    def of_gamma(cls, left: np.ndarray, values: np.ndarray, on_past: np.ndarray) -> "Subspace":
        """Gamma = U S^1/2, and the state it reads from Gamma L_p Z_p, `on_past` being Gamma L_p."""
        root = np.sqrt(values)
        readable = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
        return cls(values, (left * readable).T, on_past, left * root)

    @classmethod
    def of_states(cls, observed: np.ndarray, Z: np.ndarray) -> "Subspace":
        """The state S^1/2 V^T from the SVD of Gamma X = U S V^T, `observed`, as combinations of the past Z."""
        _, values, right = la.svd(observed, full_matrices=False, check_finite=False)
        return cls(values, regress(np.sqrt(values)[:, None] * right, Z)[0])

    def to_state(self, n: int) -> np.ndarray:
        """J (n, past rows) with X = J Z_p."""
        return self.reader[:n] if self.on_past is None else self.reader[:n] @ self.on_past


@dataclass(frozen=True)
class BlockHankel:
    """The compression of all methods over these block rows of [u; y]: one triangular factor."""

    past: int
    future: int

    def __call__(self, data: Records) -> PastFuture:
        """Compress past + future block rows of the gap-free parts."""
        return compress(data.parts(self.past + self.future), self.past, self.future)


@dataclass(frozen=True)
class SubspaceMethod(StateSpaceMethod[Records]):
    """A method over past and future horizons; one decomposition serves all orders."""

    extent: ClassVar[str] = "past + future"  # what messages call the sum of the horizons

    feedthrough: bool = field(
        default=False,
        metadata={"meaning": "estimate D (else zero); where the loop is closed, the controller then needs a delay"},
    )
    input_delay: int = field(
        default=0,
        metadata={"minimum": 0, "meaning": "known dead time of all inputs in samples, for which the model has states"},
    )

    @abstractmethod
    def horizons(self) -> tuple[int, int]:
        """Return (past, future) in samples."""

    @abstractmethod
    def decompose(self, factor: PastFuture) -> Any:
        """Return what all orders share: a Subspace, unless the method has a `realize` of its own."""

    def found(self, factor: PastFuture) -> Any:
        """The decomposition of these data, made at the first order asked for."""
        return factor.once(self, self.decompose)

    def singular_values(self, factor: PastFuture) -> np.ndarray:
        """Return those of the decomposition."""
        return self.found(factor).values

    def uses_predictor(self, factor: PastFuture) -> bool:
        """Fit B, D and x0 through the one-step predictor: the only consistent way where the loop is closed."""
        return self.consistent_in_closed_loop or factor.closed

    def span(self, order: int | None) -> int:
        """past + future."""
        return sum(self.horizons())

    def unsupported(self, data: Records) -> str | None:
        """Return why these data do not suit: too few columns for the horizons."""
        rows = sum(self.horizons())
        parts = data.parts(rows)
        channels = len(parts[0].inputs) + len(parts[0].outputs)
        columns = columns_of(parts, rows)
        if columns < rows * channels:
            apart = f" in {len(parts)} gap-free parts" if len(parts) > 1 else ""
            largest = largest_rows([np.hstack([e.u, e.y]) for e in parts])
            return (
                f"{self.extent} = {rows} block rows of {channels} channels need {rows * channels} Hankel columns, but the "
                f"data leave {columns}{apart}; the largest possible {self.extent} is {largest}"
            )
        return None

    def required_excitation(self, order: int | None) -> int:
        """Block rows of the future: U_f must have full row rank to be projected out."""
        return self.horizons()[1]

    def sufficient_excitation(self, order: int | None) -> int:
        """Order + past + future: Willems' lemma for all trajectories of length past + future."""
        return (order or 0) + sum(self.horizons())

    def largest_order(self, data: Records) -> int:
        """(future - 1) ny: one block row of the observability matrix is lost to the shift."""
        past, future = self.horizons()
        nu, ny = len(data.inputs), len(data.outputs)
        return min((future - 1) * ny, past * (nu + ny))

    @property
    def compression(self) -> BlockHankel:
        """Methods with the same horizons share one factor."""
        return BlockHankel(*self.horizons())

    def realize(self, factor: PastFuture, order: int, data: Records) -> Estimate:
        """Return the model of one order."""
        found, now, n = self.found(factor), factor.past, order
        J = found.to_state(n)
        X = J @ factor.z()
        A, C, K, E = state_regression(
            X, J @ factor.z(1), factor.u(now, now + 1), factor.y(now, now + 1), self.feedthrough
        )
        if found.gamma is None:
            shift = Shift.of_states(A, C, X, factor.future)
        else:
            shift = Shift.of_gamma(found.gamma[:, :n], factor.ny)
        A, notes = self.dynamics(shift)
        return self.completed(factor, A, shift.C, K, E, found.values, warnings=notes)

    def completed(
        self,
        factor: PastFuture,
        A: np.ndarray,
        C: np.ndarray,
        K: np.ndarray,
        E: np.ndarray,
        values: np.ndarray,
        inputs: Inputs | None = None,
        **options: Any,
    ) -> Estimate:
        """Return the estimate from A, C, K and compressed innovation rows E (ny, …), whose covariance is the noise's."""
        return complete(
            self.name,
            factor.experiments,
            A,
            C,
            noise=Noise(K, E @ E.T / factor.factor.columns),
            inputs=inputs,
            feedthrough=self.feedthrough,
            predictor=options.pop("predictor", self.uses_predictor(factor)),
            circular=factor.circular if inputs is None else None,
            singular_values=values,
            condition=factor.factor.condition,
            route=factor.factor.path,
            **options,
        )


@dataclass(frozen=True)
class TwoHorizonMethod(SubspaceMethod):
    """A method with a past and a future horizon."""

    past: int = field(default=20, metadata={"meaning": "past horizon p in samples"})
    future: int = field(default=20, metadata={"meaning": "future horizon f in samples"})

    def horizons(self) -> tuple[int, int]:
        """(past, future)."""
        return self.past, self.future
