"""Modes of a discrete linear model: continuous-time poles, natural frequencies, dampings, shapes, and the modal form."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError

DELAY = 1e-9  # modulus of a pole that only delays: it has neither frequency nor time constant
DEFECTIVE = 1e8  # condition of unit eigenvectors beyond which no modal form is worth having


@dataclass(frozen=True, eq=False)
class Mode:
    """One real pole or one pair of complex poles.

    pole : s = log(z) / dt in rad/s, the one with positive frequency; f_hz : natural frequency |s| / 2 pi; damping :
    -Re s / |s|, NaN for an integrator; time_constant_s : -1 / Re s, of the real mode or of the envelope, inf when undamped;
    shape (ny,) : the outputs in this mode, complex, its largest component 1. A pole on the negative real z axis shows as
    one beyond the Nyquist frequency: sampled alternation.
    """

    pole: complex
    f_hz: float
    damping: float
    time_constant_s: float
    shape: np.ndarray


def continuous_poles(poles: np.ndarray, dt: float) -> np.ndarray:
    """s = log(lambda) / dt, rad/s; poles at the origin are put at |lambda| = 1e-12."""
    safe = np.where(np.abs(poles) < 1e-12, 1e-12, poles)
    return np.log(safe.astype(complex)) / dt


def modes_of(A: np.ndarray, C: np.ndarray, dt: float) -> tuple[Mode, ...]:
    """Return the modes of x(k+1) = A x(k), y = C x, slowest first; poles at the origin, which only delay, are none."""
    poles, vectors = _upper(A, C)
    found, lasting = [], np.abs(poles) > DELAY
    for s, shape in zip(continuous_poles(poles[lasting], dt), (C @ vectors[:, lasting]).T, strict=True):
        size = abs(s)
        damping = -s.real / size if size > 0 else float("nan")
        decay = -1 / s.real if s.real != 0 else float("inf")
        found.append(Mode(complex(s), size / (2 * np.pi), damping, decay, shape))
    return tuple(sorted(found, key=lambda mode: mode.f_hz))


def modal_basis(A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return T and the block-diagonal inv(T) A T: z for a real pole, [[re z, im z], [-im z, re z]] for a pair.

    The columns of T are eigenvectors (real and imaginary parts), scaled as in `modes_of`, so that those of C T are the
    mode shapes. Raises ExciteError where the eigenvectors of coinciding poles do not span the state space.
    """
    poles, vectors = _upper(A, C)
    order = np.argsort(np.abs(np.log(np.maximum(np.abs(poles), 1e-300)) + 1j * np.angle(poles)), kind="stable")
    columns, blocks = [], []
    for z, v in zip(poles[order], vectors.T[order], strict=True):
        columns += [v.real] if z.imag == 0 else [v.real, v.imag]
        blocks.append([[z.real]] if z.imag == 0 else [[z.real, z.imag], [-z.imag, z.real]])
    T = np.column_stack(columns) if columns else np.empty((0, 0))
    condition = np.linalg.cond(T / np.linalg.norm(T, axis=0)) if len(T) else 1.0
    if condition > DEFECTIVE:
        apart = np.abs(np.subtract.outer(poles, poles)) + np.diag(np.full(len(poles), np.inf))
        i, j = np.unravel_index(np.argmin(apart), apart.shape)
        raise ExciteError(
            f"poles {poles[i]:.6g} and {poles[j]:.6g} coincide (condition of the eigenvectors {condition:.1e}), so that the "
            "model has no modal form; keep the state-space form, or lower the order"
        )
    return T, la.block_diag(*blocks) if blocks else np.empty((0, 0))


def _upper(A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues with nonnegative imaginary part, and eigenvectors (columns) whose largest output is 1."""
    poles, vectors = la.eig(A) if len(A) else (np.empty(0, complex), np.empty((0, 0)))
    keep = poles.imag >= 0
    poles, vectors = poles[keep], vectors[:, keep]
    shapes = C @ vectors
    peak = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(len(poles))]
    hidden = np.abs(peak) < 1e-12 * np.linalg.norm(C)
    return poles, vectors / np.where(hidden, 1.0, peak)
