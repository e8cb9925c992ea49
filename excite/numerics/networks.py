"""Thermal RC networks: Cauer ladders, Foster networks, accurate conversion both ways, and their exact response.

A Cauer ladder has its heat source at node 1: C_k from node k to ambient, R_k from node k to node k + 1, R_n to ambient.
A Foster network is the sum of modes R_i / (1 + s tau_i), the form (8.1) of Miller (2012). Temperatures are rises above ambient.
"""

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError


def cauer_to_foster(resistance: np.ndarray, capacitance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the modes of a ladder seen from every node: R (n, n), K/W, and tau (n,), s, fastest first.

    resistance, capacitance : (n,) K/W and J/K. R[i, k] is mode i's share of the temperature of node k + 1 for power into
    node 1: column 0, all positive, is the Foster network of the source; column k sums to R_k+1 + … + R_n of the ladder.

    With scaled temperatures C^(1/2) T the conductances become the tridiagonal B^T B = L D L^T, B upper bidiagonal with
    1/sqrt(R_k C_k) and -1/sqrt(R_k C_k+1), D_k = 1/(R_k C_k). It is never formed: the singular values of B have full
    relative accuracy however far apart they are (Demmel and Kahan 1990), and so have the components of the vectors from
    the twisted factorisation (Dhillon and Parlett 2004, section 3), even where a mode hardly shows at the source: a share is
    0 only where it leaves the range of double precision.

    Raises ExciteError unless all elements are positive.
    """
    R, C = _positive(resistance, "resistance"), _positive(capacitance, "capacitance")
    n = len(R)
    if len(C) != n:
        raise ExciteError(f"cauer_to_foster: {n} resistances and {len(C)} capacitances; give one of each per stage")
    q, e = 1 / (R * C), 1 / (R[:-1] * C[1:])
    rate = la.svd(np.diag(np.sqrt(q)) - np.diag(np.sqrt(e), 1), compute_uv=False, lapack_driver="gesvd") ** 2
    # Pivots of B^T B - rate from the top (s) and from the bottom (p), all modes at once; a vector is read off both ways
    # from where they meet best. A pivot that vanishes is moved by one unit in its last place.
    s, p = np.empty((n, n)), np.empty((n, n))
    from_below, from_above = np.empty((n, n)), np.empty((n, n))  # component k from k + 1, and k + 1 from k
    eps = np.finfo(float).eps
    s[0], p[-1] = -rate, q[-1] - rate
    for k in range(n - 1):
        pivot = q[k] + s[k]
        pivot[pivot == 0] = eps * q[k]
        from_below[k] = np.sqrt(q[k] * e[k]) / pivot
        s[k + 1] = e[k] * (s[k] / pivot) - rate
    for k in range(n - 2, -1, -1):
        pivot = e[k] + p[k + 1]
        pivot[pivot == 0] = eps * e[k]
        from_above[k] = np.sqrt(q[k] * e[k]) / pivot
        p[k] = q[k] * (p[k + 1] / pivot) - rate
    twist = np.argmin(np.abs(s + p + rate), axis=0)
    v = np.zeros((n, n))
    v[twist, np.arange(n)] = 1
    for k in range(n - 2, -1, -1):
        v[k] = np.where(k < twist, from_below[k] * v[k + 1], v[k])
    for k in range(n - 1):
        v[k + 1] = np.where(k >= twist, from_above[k] * v[k], v[k + 1])
    v /= la.norm(v, axis=0)
    return (v[0] / rate * v / np.sqrt(C[0] * C)[:, None]).T, 1 / rate


def foster_to_cauer(resistance: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return resistance and capacitance (n,) of the ladder with the modes R_i / (1 + s tau_i) at its source.

    resistance, tau : (n,) K/W and s, in any order. Modes are inserted slowest last into the factors q, e of the ladder's
    tridiagonal matrix less the rate of the slowest mode so far, by additions, products and quotients of positive numbers
    (pftoqd of Laurie 1999, J. Comput. Appl. Math. 112). Only differences of the given time constants are formed, so
    that every element is accurate to a few units in its last place, whatever their ratios.

    Raises ExciteError unless all values are positive and all time constants different.
    """
    R, tau = _positive(resistance, "resistance"), _positive(tau, "tau")
    if len(R) != len(tau):
        raise ExciteError(
            f"foster_to_cauer: {len(R)} resistances and {len(tau)} time constants; give one of each per mode"
        )
    order = np.argsort(tau)
    R, tau = R[order], tau[order]
    if (twins := np.flatnonzero(np.diff(tau) == 0)).size:
        raise ExciteError(f"foster_to_cauer: time constant {tau[twins[0]]:g} s is given twice; add the two resistances")
    try:
        ladder = _ladder((R / tau).tolist(), (np.diff(tau) / tau[1:] / tau[:-1]).tolist(), 1 / float(tau[-1]))
    except ZeroDivisionError:
        ladder = np.zeros((2, 1))
    if not (np.isfinite(ladder) & (ladder > 0)).all():
        raise ExciteError("foster_to_cauer: an element leaves the range of double precision; drop the smallest modes")
    return ladder[0], ladder[1]


def _ladder(weight: list[float], slower: list[float], slowest: float) -> np.ndarray:
    """Return [resistance, capacitance] (2, n) for the residues of the modes, fastest first, and how rates 1 / tau fall."""
    q: list[float] = [0.0]
    e: list[float] = []
    mass = weight[0]
    for shift, w in zip(slower, weight[1:], strict=True):
        q, e = _shifted(q, e, shift)
        q, e = _with_mode_at_zero(q, e, mass / (mass + w), w / (mass + w))
        mass += w
    q, e = _shifted(q, e, slowest)
    C, elements = 1 / mass, []
    for q_k, e_k in zip(q, [*e, 1.0], strict=True):
        R = 1 / (q_k * C)
        elements.append((R, C))
        C = 1 / (R * e_k)
    return np.array(elements).T


def _shifted(q: list[float], e: list[float], shift: float) -> tuple[list[float], list[float]]:
    """Return the factors of L D L^T + shift: D_k = q_k, L_k+1,k^2 D_k = e_k (stationary qd, Dhillon and Parlett 2004)."""
    new_q, new_e, s = [], [], shift
    for q_k, e_k in zip(q, [*e, 0.0], strict=True):
        new_q.append(q_k + s)
        ratio = e_k / new_q[-1]
        new_e.append(ratio * q_k)
        s = ratio * s + shift
    return new_q, new_e[:-1]


def _with_mode_at_zero(q: list[float], e: list[float], kept: float, share: float) -> tuple[list[float], list[float]]:
    """Return the factors of the measure with a mass at 0 that is `share` of the new whole, the rest `kept`.

    x d(measure) stays as it is, so that q_k + e_k and e_k q_k+1 do.
    """
    new_q, new_e, d = [q[0] * kept], [], q[0] * share
    for e_k, next_q in zip([*e, 0.0], [*q[1:], 0.0], strict=True):
        new_e.append(e_k + d)
        new_q.append(next_q * (e_k / new_e[-1]))
        d = next_q * (d / new_e[-1])
    return new_q, new_e


def response(
    resistance: np.ndarray, tau: np.ndarray, power: np.ndarray, starts_s: np.ndarray, time_s: np.ndarray
) -> np.ndarray:
    """Return the temperatures (N, m) at times (N,) of a network at rest before its power.

    T(t) = sum_i R_i x_i(t), tau_i dx_i/dt = power - x_i: sums of exponentials, exact at any times.
    resistance : (n, m) K/W; tau : (n,) s; power : (M,) W, each held from its start in starts_s (M,), s, increasing, to
    the next one; time_s : none before the first start.
    """
    held = np.diff(starts_s)[:, None] / tau
    x = _states(np.exp(-held), -np.expm1(-held) * power[:-1, None])
    k = np.searchsorted(starts_s, time_s, side="right") - 1
    since = (time_s - starts_s[k])[:, None] / tau
    return (np.exp(-since) * x[k] - np.expm1(-since) * power[k, None]) @ resistance


def _states(decay: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Return x (M + 1, n) from x_0 = 0 by x_k+1 = decay_k x_k + drive_k, for decay and drive (M, n).

    Two steps are one step of the same kind, so that half as many give every other state.
    """
    M, n = decay.shape
    x = np.zeros((M + 1, n))
    if M:
        first, second = slice(0, M - M % 2, 2), slice(1, None, 2)
        x[::2] = _states(decay[second] * decay[first], decay[second] * drive[first] + drive[second])
        x[1::2] = decay[::2] * x[:M:2] + drive[::2]
    return x


def _positive(values: np.ndarray, place: str) -> np.ndarray:
    array = np.asarray(values, float)
    if array.ndim != 1 or not array.size:
        raise ExciteError(f"{place}: shape {array.shape}; give a list of numbers, one per stage")
    bad = np.flatnonzero(~(np.isfinite(array) & (array > 0)))
    if bad.size:
        raise ExciteError(f"{place}[{bad[0]}]: {array[bad[0]]:g}; every value must be positive and finite")
    return array
