"""What the subspace methods have in common: horizons, limits, the shared compressed data, and the way to a model."""

from abc import abstractmethod
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as la

from excite.numerics.hankel import columns_of, largest_rows
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.method import Data, Method, experiments, order_or_gap
from identify.steps.compression import PastFuture, compress, regress
from identify.steps.kalman import state_regression
from identify.steps.regions import stable_dynamics
from identify.steps.shift import shift_invariance
from identify.subspace.realize import complete


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
class SubspaceMethod(Method):
    """A method over past and future horizons; subclasses say what they are called in its literature."""

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

    def uses_predictor(self, factor: PastFuture) -> bool:
        """Fit B, D and x0 through the one-step predictor: the only consistent way where the loop is closed."""
        return self.closed_loop or any(e.loop.closed for e in factor.experiments)

    def span(self, order: int) -> int:
        """past + future."""
        return sum(self.horizons())

    def unsupported(self, data: Data) -> str | None:
        """Return why these data do not suit: sampling, or too few columns for the horizons."""
        if reason := super().unsupported(data):
            return reason
        rows = sum(self.horizons())
        parts = gap_free(experiments(data), rows).parts
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

    def required_excitation(self, order: int) -> int:
        """Block rows of the future: U_f must have full row rank to be projected out."""
        return self.horizons()[1]

    def sufficient_excitation(self, order: int) -> int:
        """Order + past + future: Willems' lemma for all trajectories of length past + future."""
        return order + sum(self.horizons())

    def largest_order(self, data: Data) -> int:
        """(future - 1) ny: one block row of the observability matrix is lost to the shift."""
        past, future = self.horizons()
        first = experiments(data)[0]
        return min((future - 1) * first.y.shape[1], past * (first.u.shape[1] + first.y.shape[1]))

    def factor_key(self) -> tuple:
        """Methods with the same horizons and dead time share one factor."""
        return ("past-future", *self.horizons(), self.input_delay)

    def prepare(self, data: Data) -> PastFuture:
        """Compress past + future block rows of [u; y]."""
        return compress(gap_free(experiments(data), sum(self.horizons())).parts, *self.horizons())


@dataclass(frozen=True)
class DecomposingMethod(SubspaceMethod):
    """A subspace method one decomposition of which serves all orders."""

    stability_guard: bool = field(
        default=False,
        metadata={
            "meaning": "replace an unstable A by a stable one (Maciejowski 1995); not for unstable or integrating plants"
        },
    )

    @abstractmethod
    def decompose(self, factor: PastFuture) -> Any:
        """Return what all orders share: a Subspace, unless the method has a `realize` of its own."""

    def realize(self, factor: PastFuture, order: int | None) -> Estimate:
        """Return the model of one order."""
        found = self.found(factor)
        n, warnings = order_or_gap(order, found.values, self.largest_order(factor.experiments))
        now, J = factor.past, found.to_state(n)
        A, C, K, E = state_regression(
            J @ factor.z(), J @ factor.z(1), factor.u(now, now + 1), factor.y(now, now + 1), self.feedthrough
        )
        if found.gamma is not None:
            A, C = shift_invariance(found.gamma[:, :n], factor.ny)
        A, guarded = self.guard(A, C, factor.future)
        return complete(
            self.name,
            factor,
            A,
            C,
            K,
            E,
            feedthrough=self.feedthrough,
            predictor=self.uses_predictor(factor),
            singular_values=found.values,
            warnings=warnings + guarded,
        )

    def guard(self, A: np.ndarray, C: np.ndarray, rows: int) -> tuple[np.ndarray, tuple[str, ...]]:
        """Return A, stable where the setting asks for it, and a warning where it was changed."""
        return stable_dynamics(A, C, rows) if self.stability_guard else (A, ())

    def found(self, factor: PastFuture) -> Any:
        """The decomposition of these data, made at the first order asked for."""
        return factor.once((self.name, *asdict(self).values()), self.decompose)


@dataclass(frozen=True)
class TwoHorizonMethod(DecomposingMethod):
    """A method with a past and a future horizon."""

    past: int = field(default=20, metadata={"meaning": "past horizon p in samples"})
    future: int = field(default=20, metadata={"meaning": "future horizon f in samples"})

    def horizons(self) -> tuple[int, int]:
        """(past, future)."""
        return self.past, self.future
