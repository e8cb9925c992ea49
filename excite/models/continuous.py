"""Between continuous time and samples, for an input held between them."""

import warnings

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.types.channel import positive, time_axis

ON_AXIS = 1e-9  # relative distance to the negative real axis at which a pole has no continuous-time counterpart
AT_ORIGIN = 1e-12  # modulus of a pole that is a delay
ROUND_TRIP = 1e-8  # relative error of sampling the result again, beyond which it is no result
UNIFORM = 1e-9  # relative difference of the steps below which instants count as uniform


def hold(A: np.ndarray, B: np.ndarray, dt: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A, B sampled at dt s with a zero-order hold; for steps dt (S,), stacks (S, n, n) and (S, n, nu).

    exp(dt [[A_c, B_c], [0, 0]]) = [[A, B], [0, I]] (Van Loan, IEEE Trans. Autom. Control 23, 1978).
    """
    n, nu = B.shape
    M = np.zeros((n + nu, n + nu))
    M[:n, :n], M[:n, n:] = A, B
    sampled = la.expm(np.multiply.outer(dt, M))
    return sampled[..., :n, :n], sampled[..., :n, n:]


def uniform_step(time_s: np.ndarray) -> float | None:
    """Return the step of uniform instants (N,), or None where they are not uniform."""
    steps = np.diff(time_s)
    if len(steps) == 0:
        return None
    step = (time_s[-1] - time_s[0]) / len(steps)
    # the instants themselves are rounded, so that late steps are less exact
    return float(step) if np.abs(steps - step).max() <= UNIFORM * step + 4 * np.spacing(np.abs(time_s).max()) else None


def instants(time_s: np.ndarray | None, count: int, kind: str) -> np.ndarray:
    """Return the instants (count,) at which a model in continuous time is simulated; without them it cannot be."""
    if time_s is None:
        raise ExciteError(f"{kind}.simulate: no instants; give time_s, one per sample of u")
    return time_axis(time_s, count, f"{kind}.simulate: time_s")


def sampling_time(dt: float | None, kind: str) -> float:
    """Return the sampling time, s, that a model in continuous time is asked for; it has none of its own."""
    if dt is None:
        raise ExciteError(f"{kind}: a model in continuous time has no sampling time of its own; give dt in s")
    return positive(dt, f"{kind}: dt")


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
