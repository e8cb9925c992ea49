"""What the subspace methods have in common: horizons, limits and the shared compressed data."""

from dataclasses import dataclass

import numpy as np

from excite.hankel import columns_of, largest_rows
from identify.ground.compression import PastFuture, compress
from identify.method import Data, Method, experiments


@dataclass(frozen=True)
class SubspaceMethod(Method):
    """A method over past and future horizons; subclasses say what they are called in its literature."""

    def horizons(self) -> tuple[int, int]:
        """Return (past, future) in samples."""
        raise TypeError(f"{type(self).__name__} does not state its horizons")

    def unsupported(self, data: Data) -> str | None:
        """Return why these data do not suit: sampling, missing samples, or too few columns for the horizons."""
        if reason := super().unsupported(data):
            return reason
        data = experiments(data)
        segments = [np.hstack([e.u, e.y]) for e in data]
        rows, channels = sum(self.horizons()), segments[0].shape[1]
        columns = columns_of(segments, rows)
        if columns < rows * channels:
            return (
                f"past + future = {rows} block rows of {channels} channels need {rows * channels} Hankel columns, but the "
                f"data leave {columns}; the largest possible past + future is {largest_rows(segments)}"
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
        """Methods with the same horizons share one factor."""
        return ("past-future", *self.horizons())

    def prepare(self, data: Data) -> PastFuture:
        """Compress past + future block rows of [u; y]."""
        return compress(experiments(data), *self.horizons())


@dataclass(frozen=True)
class TwoHorizonMethod(SubspaceMethod):
    """A method with a past horizon p and a future horizon f, in samples."""

    past: int = 20
    future: int = 20

    def horizons(self) -> tuple[int, int]:
        """(past, future)."""
        return self.past, self.future
