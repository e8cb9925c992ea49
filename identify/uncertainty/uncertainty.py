"""How far an estimate may be off: several ways to know it, one way to ask."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from excite.models.modes import continuous_poles


class Uncertainty(ABC):
    """The scatter of an estimate about what would be found without noise, first of all of functions of its model.

    model : the estimated model; kind : how it is known, in words; withheld : why no number is given, or None.
    """

    model: Model
    kind: str
    withheld: str | None

    @abstractmethod
    def of(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Return the covariance (m, m) of a real function of the model, with m values.

        Raises ExciteError, with the reason, where it cannot be told.
        """

    def std(self, function: Callable[[Model], np.ndarray]) -> np.ndarray:
        """Return the standard deviation (m,) of a real function of the model."""
        return np.sqrt(np.diag(self.of(function)))

    def poles(self) -> np.ndarray:
        """Return the covariance (n, 2, 2) of the real and the imaginary part of each pole, in the order of the model's."""
        n = len(_dynamic(self.model).poles())

        def parts(model: Model) -> np.ndarray:
            found = _matched(_dynamic(model).poles(), _dynamic(self.model).poles())
            return np.column_stack([found.real, found.imag]).ravel()

        cov = self.of(parts).reshape(n, 2, n, 2)
        return cov[np.arange(n), :, np.arange(n), :]

    def frf(self, f_hz: np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Return std (F, ny, nu) of |G| to first order, and the radius (F, ny, nu) of circles that hold G at a level."""
        f_hz = np.atleast_1d(f_hz)

        def parts(model: Model) -> np.ndarray:
            G = model.frf(f_hz)
            return np.stack([G.real, G.imag], axis=-1).ravel()

        G = self.model.frf(f_hz)
        cov = self.of(parts).reshape(G.size, 2, G.size, 2)
        cov = cov[np.arange(G.size), :, np.arange(G.size), :].reshape(*G.shape, 2, 2)
        unit = np.stack([G.real, G.imag], axis=-1) / np.maximum(np.abs(G), 1e-300)[..., None]
        std = np.sqrt(np.einsum("...i,...ij,...j->...", unit, cov, unit))
        return std, np.sqrt(-2 * np.log(1 - level) * np.linalg.eigvalsh(cov)[..., -1])

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the standard deviations (n,) of natural frequency in Hz and of damping of each pole, to first order."""
        model = _dynamic(self.model)
        z, cov = model.poles(), self.poles()
        s = z if model.dt is None else continuous_poles(z, model.dt)
        ds = np.ones(len(z), complex) if model.dt is None else 1 / (z * model.dt)
        size = np.abs(s)
        # of s = sigma + i omega: |s| and -sigma / |s|, each with respect to the parts of z
        along = np.stack([ds, 1j * ds], axis=-1)
        on_size = np.real(s.conj()[:, None] * along) / size[:, None]
        on_damping = -np.real(along) / size[:, None] + s.real[:, None] * on_size / size[:, None] ** 2
        std = [np.sqrt(np.einsum("ni,nij,nj->n", g, cov, g)) for g in (on_size / (2 * np.pi), on_damping)]
        return std[0], std[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: kind, withheld, and the poles' standard deviations and covariances."""
        if self.withheld is not None:
            return {"kind": self.kind, "withheld": self.withheld}
        cov = self.poles()
        std = np.sqrt(np.trace(cov, axis1=1, axis2=2))
        return {"kind": self.kind, "withheld": None, "pole_std": std, "pole_covariance": cov}


def _dynamic(model: Model) -> Dynamic:
    if not isinstance(model, Dynamic):
        raise ExciteError(f"a {type(model).__name__} has no poles; ask for its frequency response")
    return model


def _matched(found: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the poles found in the order of the reference, each to its nearest."""
    _, columns = linear_sum_assignment(np.abs(reference[:, None] - found[None, :]))
    return found[columns]
