"""Crest factor of sums of sines, and phases that make it small.

All functions share one signal model. Row r of R waveforms that share F phases is

    s_r(t) = Re sum_k weights[r, k] exp(j (phases[k] + 2 pi lines[k] t)),   0 <= t < 1 (one period),

lines : (F,) distinct positive integers; weights : (F,) or (R, F) or (B, R, F) real amplitudes or complex; phases : (F,) or
(B, F) in rad; a leading B is a batch of independent candidates, worked on in one array. One row is an ordinary multisine,
further rows are outputs of a model (weights = frequency response times amplitude) or rotated copies of the input. The
crest factor of a row is max|s_r| / rms_r with rms_r^2 = sum_k |weights[r, k]|^2 / 2; a row without power counts as 0.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
import scipy.fft as fft

GRID = 16  # points per period of the highest line: the grid on which crest factors are quoted
FINE = 128  # the grid of the bound, which then lies at most 0.03 % above the true peak
# The norm doubles from 4 to 1024. A grid that is too coarse lets peaks grow between its points, and that limits the
# result more than the norm does, so the grid is refined as the norm rises: (grid, log2 p of the 2p-norms on it).
STAGES = ((8, (1, 2, 3)), (16, (4, 5)), (32, (6, 7, 8, 9)))
POLISH_LINES = 200  # up to here a linear program costs less than another start and gains more
POLISH_GRID = 64
POOL = 8


def schroeder(lines: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Return phases (F,) whose group delay at a line is the fraction of power below it (Schroeder, 1970).

    Lines with a common spacing g repeat, up to a rotation, every g-th of the period; the sweep then takes that time.
    """
    gaps, below = _sweep(lines, amplitudes)
    return -2 * np.pi * np.cumsum(np.concatenate([[0.0], gaps * below])) % (2 * np.pi)


def newman(count: int) -> np.ndarray:
    """Return phases pi k^2 / F for k = 0 … F - 1 (Newman, 1965), for flat, equally spaced lines."""
    return np.pi * np.arange(count) ** 2 / count % (2 * np.pi)


def crest_factor(lines: np.ndarray, weights: np.ndarray, phases: np.ndarray, grid: int = GRID) -> np.ndarray:
    """Return the crest factors (R,), or (B, R), on at least `grid` points per period of the highest line."""
    synth = _Grid(lines, grid)
    return np.abs(synth.waves(_unit_rms(weights) * np.exp(1j * phases)[..., None, :])).max(-1)


def crest_bound(lines: np.ndarray, weights: np.ndarray, phases: np.ndarray, grid: int = FINE) -> np.ndarray:
    """Return upper bounds (R,) of the crest factors over continuous time.

    A trigonometric polynomial of degree K is at most max|s(t_m)| / cos(pi K / M) when sampled on M > 2 K equidistant
    points (Ehlich and Zeller, 1964).
    """
    return crest_factor(lines, weights, phases, grid) / np.cos(np.pi * lines.max() / _Grid(lines, grid).points)


def relative_peak_factor(lines: np.ndarray, weights: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Return (max - min) / (2 sqrt(2) rms) of every row, (R,), on the fine grid: 1 for a sine (Morelli, 2012)."""
    synth = _Grid(lines, FINE)
    return np.ptp(synth.waves(_unit_rms(weights) * np.exp(1j * phases)[..., None, :]), axis=-1) / (2 * np.sqrt(2))


def clipping(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray, iterations: int = 300) -> np.ndarray:
    """Return phases after repeated clipping in time and restoring the amplitudes (van der Ouderaa, 1988).

    The level rises from 75 % to 99 % of the peak; amplitudes : (F,), one row.
    """
    grid = _Grid(lines, GRID)
    for level in np.linspace(0.75, 0.99, iterations):
        s = grid.waves(amplitudes * np.exp(1j * phases))
        limit = level * np.abs(s).max()
        phases = np.angle(grid.lines_of(np.clip(s, -limit, limit)))
    return phases


def l2p(
    lines: np.ndarray,
    weights: np.ndarray,
    phases: np.ndarray,
    *,
    skip: int = 0,
    iterations: int = 30,
    deadline: float = np.inf,
) -> np.ndarray:
    """Return phases (B, F) that minimise the 2p-norm over all rows and times, p doubling (Guillaume, 1991).

    With J = ds/dphases the Hessian of sum s^2p / 2p is (2p - 1) J^T diag(s^(2p-2)) J plus a diagonal. Its product with
    a vector takes two FFTs, so a damped Newton step is solved by conjugate gradients without forming a matrix:
    O(N log N) in time and memory for any number of lines. The candidates of a batch step together.

    skip : leading entries of the p schedule to leave out (for phases that are good already); iterations : Newton steps
    for each p at most; deadline : time.perf_counter() at which to return what there is.
    """
    weights, phases = _unit_rms(weights), np.array(np.atleast_2d(phases))
    schedule = [(grid, k) for grid, exponents in STAGES for k in exponents]
    for points, k in schedule[skip:]:
        grid = _Grid(lines, points)
        damping = np.full((len(phases), 1), 0.1)
        c = weights * np.exp(1j * phases)[:, None, :]
        s = grid.waves(c)
        norm = _log_norm(s, k)
        for _ in range(iterations):
            if perf_counter() > deadline:
                return phases
            step = _newton_step(grid, c, s, k, damping)
            trial = phases + step
            c_trial = weights * np.exp(1j * trial)[:, None, :]
            s_trial = grid.waves(c_trial)
            gain = norm - _log_norm(s_trial, k)
            better = gain > 0
            phases[better], c[better], s[better] = trial[better], c_trial[better], s_trial[better]
            norm = np.where(better, norm - gain, norm)
            damping = np.clip(np.where(better[:, None], 0.3, 8.0) * damping, 1e-6, 1e4)
            if better.any() and gain.max() < 1e-4:
                break
    return phases


def _newton_step(
    grid: "_Grid", c: np.ndarray, s: np.ndarray, k: int, damping: np.ndarray, products: int = 15
) -> np.ndarray:
    """Return the damped Newton step (B, F) of the 2p-norm, p = 2^k, by preconditioned conjugate gradients."""
    peak = np.abs(s).max((1, 2), keepdims=True)
    y, c = s / peak, c / peak
    w = _power(y, k)
    w /= w.sum((1, 2), keepdims=True)
    w /= np.maximum(y * y, np.finfo(float).tiny)
    slope = c.conj() * grid.lines_of(w * y)
    gradient, curvature = slope.imag.sum(1), -slope.real.sum(1)
    factor = 2.0 ** (k + 1) - 1
    gauss = factor / 2 * (w.sum(2)[..., None] * np.abs(c) ** 2).sum(1)
    damped = damping * gauss.mean(1, keepdims=True)
    scale = 1 / (np.maximum(gauss + curvature, 0.1 * gauss) + damped)
    jc = 1j * c

    step, r = np.zeros_like(gradient), -gradient
    z = scale * r
    direction, rz = z, (r * z).sum(1)
    enough = 1e-3 * rz
    alive = rz > 0
    for _ in range(products):
        wave = w * grid.waves(jc * direction[:, None, :])
        product = factor * (jc.conj() * grid.lines_of(wave)).real.sum(1) + (curvature + damped) * direction
        bend = (direction * product).sum(1)
        alive = alive & (bend > 0)  # negative curvature: keep the step reached so far
        length = np.where(alive, rz / np.where(alive, bend, 1), 0)[:, None]
        step, r = step + length * direction, r - length * product
        z = scale * r
        rz, last = (r * z).sum(1), rz
        alive = alive & (rz > enough)
        if not alive.any():
            break
        direction = z + np.where(alive, rz / np.where(alive, last, 1), 0)[:, None] * direction
    stuck = ~step.any(1)
    step[stuck] = -(gradient * scale)[stuck]
    return step * np.minimum(1, 0.5 / np.maximum(np.abs(step).max(1, keepdims=True), 1e-300))


def minimax(
    lines: np.ndarray, weights: np.ndarray, phases: np.ndarray, *, iterations: int = 40, deadline: float = np.inf
) -> np.ndarray:
    """Return phases (F,) after sequential linear programs on the peaks: min max |s| to first order in a trust region.

    Guillaume et al. (1991) show that the minimax solution is what the 2p-norm tends to; the linear program reaches it.
    """
    from scipy.optimize import linprog  # it costs a fifth of the time of importing excite, and few designs need it

    weights, grid = _unit_rms(weights), _Grid(lines, POLISH_GRID)
    count, radius = len(phases), 0.1
    c = weights * np.exp(1j * phases)
    s = grid.waves(c)
    best = np.abs(s).max()
    for _ in range(iterations):
        if perf_counter() > deadline:
            break
        size = np.abs(s)
        near = size > best * (1 - max(0.02, 4 * radius))
        row, at = np.nonzero(near & (size >= np.roll(size, 1, 1)) & (size >= np.roll(size, -1, 1)))
        turn = np.exp(2j * np.pi / grid.points * (at[:, None] * lines % grid.points))
        slopes = np.sign(s[row, at])[:, None] * (1j * c[row] * turn).real
        program = linprog(
            np.append(np.zeros(count), 1),
            A_ub=np.column_stack([slopes, -np.ones(len(at))]),
            b_ub=-size[row, at],
            bounds=[(-radius, radius)] * count + [(None, None)],
            method="highs",
        )
        if program.status != 0:
            break
        promised = best - program.x[-1]
        trial = phases + program.x[:-1]
        c_trial = weights * np.exp(1j * trial)
        s_trial = grid.waves(c_trial)
        gain = best - np.abs(s_trial).max()
        if gain > 0:
            phases, c, s, best = trial, c_trial, s_trial, best - gain
        radius *= 1.5 if gain > 0.5 * promised else 0.5 if gain > 0 else 0.3
        if promised < 1e-5 or radius < 1e-6:
            break
    return phases


@dataclass(frozen=True, eq=False)
class Optimised:
    """Phases (F,) in rad, the crest factors (R,) on the quoted grid, starts made, seconds of wall time taken."""

    phases: np.ndarray
    crest: np.ndarray
    starts: int
    seconds: float


def optimise(
    lines: np.ndarray,
    weights: np.ndarray,
    *,
    seed: int | np.random.SeedSequence = 0,
    starts: int | None = None,
    time_limit_s: float | None = None,
    target: float | None = None,
    initial: np.ndarray | None = None,
) -> Optimised:
    """Return phases that minimise the largest crest factor of all rows.

    Batches alternate between random phases and perturbed copies of the best so far; each goes through `l2p`, and for up
    to `POLISH_LINES` lines the best of a batch through `minimax`. The search ends after `starts` starts, at
    `time_limit_s`, or once every row meets `target`. With neither starts nor a time limit, `default_starts` are made.
    Deterministic for a seed unless the time limit ends it. initial : (F,) phases to begin from.
    """
    began = perf_counter()
    deadline = began + (np.inf if time_limit_s is None else time_limit_s)
    asked = starts if starts is not None else default_starts(lines) if time_limit_s is None else np.inf
    rows = np.atleast_2d(weights).shape[0]
    rng, count = np.random.default_rng(seed), len(lines)
    batch = max(1, min(16, 800 // (count * rows)))
    pool = schroeder(lines, np.abs(np.atleast_2d(weights)[0]))[None]  # what a time limit of no time returns
    values, made, rounds, took = crest_factor(lines, weights, pool, POLISH_GRID).max(1), 0, 0, 0.0
    unpolished = np.inf  # only what is near the best before polishing is worth the linear programs
    while made < asked and (not rounds or perf_counter() + took / 2 < deadline):
        round_began, size = perf_counter(), int(min(batch, asked - made))
        hop = rounds % 2 == 1 or (rounds == 0 and initial is not None)
        if hop:
            near = pool[values < 1.03 * values[0]]
            parents = np.atleast_2d(initial) if rounds == 0 and initial is not None else near
            phases = parents[rng.integers(len(parents), size=size)]
            phases = phases + rng.uniform(0.2, 1.5, (size, 1)) * rng.standard_normal((size, count))
            if rounds == 0:
                phases[0] = initial
        else:
            phases = rng.uniform(0, 2 * np.pi, (size, count))
        phases = l2p(lines, weights, phases, skip=2 if hop else 0, deadline=deadline)
        crest = crest_factor(lines, weights, phases, POLISH_GRID).max(1)
        first = crest.argmin()
        unpolished = min(unpolished, crest[first])
        if count <= POLISH_LINES and crest[first] < 1.003 * unpolished:
            phases[first] = minimax(lines, weights, phases[first], deadline=deadline)
            crest[first] = crest_factor(lines, weights, phases[first], POLISH_GRID).max()
        pool, values = np.concatenate([pool, phases]), np.concatenate([values, crest])
        keep = np.unique(values.round(6), return_index=True)[1][:POOL]
        pool, values = pool[keep], values[keep]
        made, rounds, took = made + size, rounds + 1, perf_counter() - round_began
        if target is not None and values[0] <= target:
            break
    phases = pool[0] % (2 * np.pi)
    return Optimised(phases, crest_factor(lines, weights, phases), made, perf_counter() - began)


def default_starts(lines: np.ndarray) -> int:
    """Return how many starts take about a second: 96 for 31 lines, 30 for 100, 1 from 1500 on; fewer for sparse lines."""
    return int(np.clip(3000 / np.sqrt(len(lines) * float(lines.max())), 1, 96))


def chirp_likeness(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray) -> float | None:
    """Return how much the signal is one sweep through its band: 1 for Schroeder's, about 1/sqrt(F) for random phases.

    A sweep that dwells in proportion to power has the group delay d + a P(f), P being the fraction of power below f and
    |a| about 1. Compared with that, the phase steps e_k = exp(-j (phases[k+1] - phases[k])) of gap g_k = lines[k+1] -
    lines[k] give the score max over a, d of |mean_k e_k exp(-2 pi j g_k (d + a P_k))|, |a| in [0.5, 1.5]. None when
    there are fewer than four lines.
    """
    if len(lines) < 4:
        return None
    gaps, below = _sweep(lines, amplitudes)
    e = np.exp(-1j * np.diff(phases))
    kinds, which = np.unique(gaps, return_inverse=True)
    delays = np.exp(-2j * np.pi * np.outer(np.arange(64) / 64, kinds)) if len(kinds) > 1 else np.ones((1, 1))
    best = 0.0
    for a in np.linspace(0.5, 1.5, 21):
        for sign in (-a, a):
            matched = e * np.exp(-2j * np.pi * sign * gaps * below)
            sums = np.bincount(which, matched.real) + 1j * np.bincount(which, matched.imag)
            best = max(best, float(np.abs(delays @ sums).max()))
    return best / len(gaps)


def zero_shift(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Return phases of the same waveform moved in time so that s(0) = 0, at the gentlest of its zero crossings."""
    grid = _Grid(lines, GRID)
    c = amplitudes * np.exp(1j * phases)
    s = grid.waves(c)
    rise = np.roll(s, -1) - s
    crossing = np.flatnonzero((s <= 0) != (np.roll(s, -1) <= 0))
    at = crossing[np.abs(rise[crossing]).argmin()]
    low, high = at / grid.points, (at + 1) / grid.points
    sign = np.sign(rise[at])
    for _ in range(60):  # bisection to the last bit: cannot leave the bracket, and costs F sines a step
        middle = (low + high) / 2
        value = (c * np.exp(2j * np.pi * lines * middle)).real.sum()
        low, high = (low, middle) if sign * value > 0 else (middle, high)
    return (phases + 2 * np.pi * lines * low) % (2 * np.pi)


class _Grid:
    """Equidistant points over one period and the two transforms between lines and waveforms."""

    def __init__(self, lines: np.ndarray, per_period: int) -> None:
        self.lines = lines
        self.points = fft.next_fast_len(per_period * int(lines.max()), real=True)

    def waves(self, c: np.ndarray) -> np.ndarray:
        """Re sum_k c[..., k] exp(2 pi j lines[k] m / M) as (..., M)."""
        spectrum = np.zeros((*c.shape[:-1], self.points // 2 + 1), complex)
        spectrum[..., self.lines] = c * (self.points / 2)
        return fft.irfft(spectrum, self.points)

    def lines_of(self, x: np.ndarray) -> np.ndarray:
        """sum_m x[..., m] exp(-2 pi j lines[k] m / M) as (..., F)."""
        return fft.rfft(x)[..., self.lines]


def _sweep(lines: np.ndarray, amplitudes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gaps (F-1,) between lines in units of their common spacing, and the fraction of power below each gap (F-1,)."""
    gaps, power = np.diff(lines), (amplitudes / amplitudes.max()) ** 2
    return gaps // max(np.gcd.reduce(gaps), 1), np.cumsum(power)[:-1] / np.sum(power)


def _unit_rms(weights: np.ndarray) -> np.ndarray:
    """Weights (..., R, F) with every row scaled to unit rms; rows without power stay zero."""
    weights = np.atleast_2d(weights)
    weights = weights / np.maximum(np.abs(weights).max(-1, keepdims=True), np.finfo(float).tiny)
    power = (np.abs(weights) ** 2).sum(-1, keepdims=True) / 2
    return weights / np.sqrt(np.where(power > 0, power, 1))


def _power(y: np.ndarray, k: int) -> np.ndarray:
    """y^(2p) for p = 2^k by squaring."""
    power = y * y
    for _ in range(k):
        power *= power
    return power


def _log_norm(s: np.ndarray, k: int) -> np.ndarray:
    """log of the 2p-norm (mean over rows and times) of each candidate, (B,), p = 2^k."""
    peak = np.abs(s).max((1, 2), keepdims=True)
    return np.log(peak[:, 0, 0]) + np.log(_power(s / peak, k).mean((1, 2))) / 2 ** (k + 1)
