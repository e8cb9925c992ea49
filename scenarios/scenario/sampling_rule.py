"""The design rule: decimation and horizons from the poles of what is to be identified."""

from dataclasses import dataclass
from math import ceil, log

import numpy as np

from excite.models.modes import continuous_poles
from excite.types.truth import Truth
from identify.method import Method
from identify.metrics.poles import INTEGRATOR
from identify.steps.kalman import spectral_radius

SAMPLES_PER_CYCLE = 8  # of the fastest pole, after decimation
HORIZON = 0.5  # time constants of the slowest pole; longer horizons cost variance faster than they gain on slow poles
LEAST_ROWS = 20
PREDICTOR_DECAY = 0.01  # what (A - KC)^past should have fallen to
MOST_PAST = 3  # times the future: a longer past costs more variance than the bias it removes


@dataclass(frozen=True)
class Horizons:
    """every : decimation; past, future : block rows; notes : how they follow, for the reader."""

    every: int
    past: int
    future: int
    notes: tuple[str, ...]

    def fill(self, method: type[Method]) -> dict[str, int]:
        """Return the horizon settings of a method class that has them."""
        names = {"past": self.past, "future": self.future, "block_rows": self.future}
        return {name: value for name, value in names.items() if name in method.setting_names()}


def horizons(truth: Truth, hold: int | None, decimate: int | str) -> Horizons:
    """Return decimation and horizons for data like `truth`'s.

    hold : samples over which u is constant, None when it moves every sample (then nothing is decimated: only an input
    held over whole decimated intervals keeps the decimated model exact); decimate : a number, or "auto".
    """
    dt = truth.model.dt
    s = np.abs(continuous_poles(truth.poles, dt))
    moving = s[s * dt > INTEGRATOR] if (s * dt > INTEGRATOR).any() else np.array([1 / dt])
    slow, fast = moving.min(), moving.max()
    notes = [
        f"slowest pole {slow:.3g} rad/s, fastest {fast:.3g} rad/s"
        + (", integrators aside" if len(moving) < len(s) else "")
    ]
    if isinstance(decimate, int):
        every = decimate
        notes.append(f"decimation {every}, as the scenario says: dt {_ms(every * dt)}")
    elif hold is None:
        every = 1
        notes.append(f"no decimation: the input moves every sample; dt {_ms(dt)}")
    else:
        most = 2 * np.pi / fast / SAMPLES_PER_CYCLE / dt
        every = max(q for q in range(1, hold + 1) if hold % q == 0 and q <= max(most, 1))
        notes.append(
            f"decimation {every}: the largest divisor of the input's hold ({hold} samples) with {SAMPLES_PER_CYCLE} or "
            f"more samples per cycle of the fastest pole; dt {_ms(every * dt)}"
        )
    lifted = truth.model.lift(every)
    rows = HORIZON / (slow * lifted.dt)
    future = max(LEAST_ROWS, ceil(rows))
    notes.append(
        f"future {future} rows = {future * lifted.dt:.3g} s: "
        + (
            f"{HORIZON:g} time constants of the slowest pole"
            if future > LEAST_ROWS
            else f"the least, {LEAST_ROWS} rows"
        )
    )
    past = future
    if lifted.K is not None:
        radius = spectral_radius(lifted.A - lifted.K @ lifted.C)
        needed = ceil(log(PREDICTOR_DECAY) / log(radius)) if 0 < radius < 1 - 1e-9 else None
        within = needed is not None and needed <= MOST_PAST * future
        past = max(future, needed) if within else future
        decay = f"decays to {PREDICTOR_DECAY:g} in {needed} rows" if needed else "does not decay"
        notes.append(
            f"past {past} rows: the truth's predictor A - KC (spectral radius {radius:.4f}) {decay}"
            + ("" if within else f", beyond {MOST_PAST} x future, so past = future: predictor forms keep a bias")
        )
    else:
        notes.append(f"past {past} rows, as future: the truth has no noise model")
    return Horizons(every, past, future, tuple(notes))


def _ms(dt: float) -> str:
    return f"{dt * 1e3:g} ms"
