"""What the proposals of all kinds share: the sampling time and the number of periods."""

from dataclasses import dataclass
from math import ceil, log10, sqrt
from typing import Any

import numpy as np

from excite.arguments import positive
from excite.errors import DesignRefused
from excite.proposal.knowledge import Knowledge

SAMPLES_PER_PERIOD = 10  # of the highest frequency of interest
RELATIVE_ERROR = 0.1  # of the frequency response that the noise may leave
MOST_PERIODS = 100

Choices = dict[
    str, tuple[Any, str | None]
]  # parameter of the generator -> its value, and why (None: as the kind demands)


@dataclass(frozen=True)
class Frame:
    """What every kind starts from: what is known, dt (s), channels, periods to average, and why so many."""

    known: Knowledge
    dt: float
    channels: int
    periods: int
    averaging: str


def sampling(known: Knowledge, dt: float | None) -> tuple[float, str, tuple[str, ...]]:
    """Return the sampling time (s), the reason for it, and warnings.

    A given dt is checked against aliasing (DesignRefused); None is chosen for ten samples per period of the bandwidth.
    """
    bandwidth = known.bandwidth_hz
    if dt is None:
        exact = 1 / (SAMPLES_PER_PERIOD * bandwidth)
        decade = 10.0 ** np.floor(log10(exact))
        dt = float(max(m * decade for m in (1, 2, 5) if m * decade <= exact * (1 + 1e-9)))
        return dt, f"{SAMPLES_PER_PERIOD} or more samples per period of the bandwidth, {bandwidth:g} Hz", ()
    dt = positive(dt, "propose: dt")
    nyquist = 0.5 / dt
    if nyquist <= bandwidth:
        raise DesignRefused(
            f"propose: dt {dt:g} s has its Nyquist frequency at {nyquist:g} Hz, not above the bandwidth {bandwidth:g} Hz: what "
            f"lies between would alias; sample at {1 / (SAMPLES_PER_PERIOD * bandwidth):.2g} s or faster"
        )
    if nyquist < 2.5 * bandwidth:
        warning = (
            f"the Nyquist frequency {nyquist:g} Hz is less than 2.5 times the bandwidth {bandwidth:g} Hz: put an anti-alias "
            "filter before the sampler and expect its phase in the model"
        )
        return dt, "as given", (warning,)
    return dt, "as given", ()


def averaging(known: Knowledge) -> tuple[int, str, tuple[str, ...]]:
    """Return the periods to average, the reason, and warnings: the error falls with the root of their number."""
    ratio = known.noise / (known.gain * known.limit)
    needed = max(2, ceil((ratio / RELATIVE_ERROR) ** 2))
    periods = min(needed, MOST_PERIODS)
    reason = f"{periods} periods: noise over response {ratio:.2g}, to be averaged below {RELATIVE_ERROR:g}"
    if known.noise == 0:
        reason = "two periods, to compare them: the noise is not known"
    if needed > MOST_PERIODS:
        left = ratio / sqrt(MOST_PERIODS)
        return (
            periods,
            reason,
            (f"{needed} periods would be needed; {periods} leave an error of {left:.2g}: raise the limit",),
        )
    return periods, reason, ()
