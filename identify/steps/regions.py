"""Regions of the z-plane in which the eigenvalues of every state-space estimate may be held."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.numerics.simulate import observability
from excite.registry import Registry
from identify.steps.kalman import spectral_radius
from identify.steps.shift import Region, Shift


@dataclass(frozen=True)
class Stable:
    """The open unit disc, by the shift that pads with zeros (Maciejowski 1995)."""

    name = "stable"

    def __call__(self, shift: Shift) -> tuple[np.ndarray, str | None]:
        """Return the stable A of `stable_dynamics`, and what it did."""
        radius = spectral_radius(shift.A)
        if radius < 1:
            return shift.A, None
        return stable_dynamics(shift.A, shift.C, shift.rows), (
            f"the estimate of order {shift.order} was unstable (spectral radius {radius:.4f}); A was replaced by the stable "
            "one of a shift padded with zeros (stability_guard), which damps its slow modes: the order is probably too high"
        )


def stable_dynamics(A: np.ndarray, C: np.ndarray, rows: int) -> np.ndarray:
    """Return a stable A near an unstable one.

    A = Gamma^+ [Gamma without its first block row; 0], Gamma being `rows` block rows of the observability matrix of
    (A, C). With Gamma = Q R this is R^-1 Q^T S Q R, S the shift that pads with zeros, a contraction: no eigenvalue lies
    outside the unit circle. The zeros stand for C A^rows, so modes that have died out by then stay as they are.
    """
    gamma = observability(A, C, rows).reshape(-1, len(A))
    return la.lstsq(gamma, np.vstack([gamma[len(C) :], np.zeros_like(C)]), check_finite=False)[0]


# One line adds a region by name: what stands there returns the region when it is called. Entry points: excite.regions.
REGIONS: Registry[Callable[[], Region]] = Registry("region", {"stable": "identify.steps.regions:Stable"})


def region(given: "str | Region") -> Region:
    """Return a region by name; a region itself as it is."""
    return REGIONS[given]() if isinstance(given, str) else given
