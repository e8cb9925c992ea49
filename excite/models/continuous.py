"""Continuous-time state-space models, and the way to them from sampled ones whose input is held between samples."""

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.types.channel import Channel

if TYPE_CHECKING:
    import control

ON_AXIS = 1e-9  # relative distance to the negative real axis at which a pole has no continuous-time counterpart
AT_ORIGIN = 1e-12  # modulus of a pole that is a delay
ROUND_TRIP = 1e-8  # relative error of sampling the result again, beyond which it is no result


@dataclass(frozen=True, eq=False)
class ContinuousModel:
    """Deterministic continuous-time model dx/dt = A x + B u, y = C x + D u, in the channels of the sampled one."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, rad/s."""
        return la.eigvals(self.A) if len(self.A) else np.empty(0, complex)

    def to_control(self) -> "control.StateSpace":
        """Return the python-control system."""
        import control

        names = [c.name for c in self.inputs], [c.name for c in self.outputs]
        return control.StateSpace(self.A, self.B, self.C, self.D, inputs=names[0], outputs=names[1])


def invert_hold(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return continuous A, B whose zero-order-hold discretisation at dt is the one given.

    log [[A, B], [0, I]] = dt [[A_c, B_c], [0, 0]], the principal logarithm, which takes every pole to lie below the
    Nyquist frequency; integrators and repeated poles need no modal form. Raises ExciteError, naming the pole, where no
    real continuous-time model exists: poles at 0 and on the negative real axis.
    """
    n, nu = B.shape
    nyquist = 0.5 / dt
    for z in la.eigvals(A) if n else ():
        if abs(z) <= AT_ORIGIN:
            raise ExciteError(
                f"the pole at z = {z.real:.3g} is a delay of one sample, which no continuous-time model of finite order "
                "holds; shift the input by the delay before identifying, or lower the order"
            )
        if z.real < 0 and abs(z.imag) <= ON_AXIS * abs(z):
            raise ExciteError(
                f"the pole at z = {z.real:.6g} on the negative real axis oscillates at the Nyquist frequency, {nyquist:g} Hz, "
                "as no sampled real pole or pair below it does; lower the order, or sample faster"
            )
    M = np.block([[A, B], [np.zeros((nu, n)), np.eye(nu)]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # judged below, by sampling again
        try:
            log = la.logm(M)
        except ValueError:  # where it overflows, logm's own check refuses it
            log = np.full_like(M, np.nan)
    finite = np.isrealobj(log) and np.isfinite(log).all()
    error = la.norm(la.expm(log) - M) / la.norm(M) if finite else np.inf
    if not error < ROUND_TRIP:
        raise ExciteError(
            f"the matrix logarithm is inaccurate (sampled again, the model is off by {error:.1e}), because poles lie near "
            f"z = 0, at |z| = {np.abs(la.eigvals(A)).min():.3g}; lower the order, or shift the input by the delay"
        )
    return log[:n, :n] / dt, log[:n, n:] / dt
