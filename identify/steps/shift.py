"""The one door to A: from what shifts by one sample to the dynamics, for all state-space methods."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la

from identify.steps.hankel_svd import HankelSvd


@dataclass(frozen=True, eq=False)
class Shift:
    """A least-squares A (n, n) with its C (ny, n), and the cost of leaving it: || left (A' - A) right ||.

    rows : block rows of the observability matrix over which the data show the states; left, right : what weights a
    change of A, made when they are asked for. Regions of eigenvalues move A where that costs least.
    """

    A: np.ndarray
    C: np.ndarray
    rows: int
    _left: Callable[[], np.ndarray]
    _right: Callable[[], np.ndarray]

    @cached_property
    def left(self) -> np.ndarray:
        """(n, n)."""
        return self._left()

    @cached_property
    def right(self) -> np.ndarray:
        """(n, n)."""
        return self._right()

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.A)

    @classmethod
    def of_gamma(cls, gamma: np.ndarray, ny: int) -> "Shift":
        """From an extended observability matrix (f ny, n): A by shift invariance, C the first block row.

        A = argmin || Gamma without its last block row A - Gamma without its first || (Kung 1978; MOESP, N4SID, SSI).
        """
        A = la.lstsq(gamma[:-ny], gamma[ny:], check_finite=False)[0]
        weight = lambda: la.qr(gamma[:-ny], mode="r")[0][: len(A)]  # noqa: E731
        return cls(A, gamma[:ny].copy(), len(gamma) // ny, weight, lambda: np.eye(len(A)))

    @classmethod
    def of_pair(cls, H: HankelSvd, shifted: np.ndarray, order: int) -> "Shift":
        """From a Hankel matrix and the same `shifted` by one sample: A = S^-1/2 U^T H' V S^-1/2, C from U S^1/2.

        Juang and Pappa (1985); COBRA, OKID, step-based and input-output realization, SSI-COV. The cost is
        || S^1/2 (A' - A) S^1/2 ||.
        """
        root = np.sqrt(H.values[:order])
        inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)  # nothing to read where H has no rank
        A = inverse[:, None] * (H.left[:, :order].T @ shifted @ H.right[:order].T) * inverse
        return cls(A, H.gamma(order)[: H.ny], len(H.left) // H.ny, lambda: np.diag(root), lambda: np.diag(root))

    @classmethod
    def of_states(cls, A: np.ndarray, C: np.ndarray, X: np.ndarray, rows: int) -> "Shift":
        """From the regression of the next states on the states X (n, columns): SSARX, PBSID, CVA, N4SID.

        The cost is || (A' - A) X ||.
        """
        return cls(A, C, rows, lambda: np.eye(len(A)), lambda: la.qr(X.T, mode="r")[0][: len(A)].T)


# A region of eigenvalues: returns A inside it, and what was changed in words, or the A it was given and None.
Region = Callable[[Shift], tuple[np.ndarray, str | None]]


def dynamics(shift: Shift, regions: Iterable[Region]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return A inside all regions, applied one after the other, and what they changed."""
    notes: list[str] = []
    for region in regions:
        A, note = region(shift)
        if note is not None:
            shift, notes = replace(shift, A=A), [*notes, note]
    return shift.A, tuple(notes)
