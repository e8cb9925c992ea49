"""A proposal for a frequency sweep."""

from math import ceil

from excite.errors import ExciteError
from excite.proposal.frame import Choices, Frame


def sweep(frame: Frame) -> Choices:
    """Choose the frequencies, the duration and the fades of a logarithmic sweep."""
    known, low = frame.known, 1 / frame.known.settling_s
    if low >= known.bandwidth_hz:
        raise ExciteError(
            f"propose: settling_s {known.settling_s:g} s and bandwidth_hz {known.bandwidth_hz:g} Hz leave no band to sweep; "
            "a slower plant settles later than one period of its bandwidth"
        )
    duration = ceil(max(5 * known.settling_s, 5 / low) * max(1, frame.periods / 2) / frame.dt) * frame.dt
    fade = (known.settling_s / 4, "a soft start and end, a quarter of the settling time")
    return {
        "form": ("log", None),
        "start_hz": (low, "one cycle in the settling time"),
        "stop_hz": (known.bandwidth_hz, "the bandwidth"),
        "duration_s": (
            duration,
            f"at least five times the longest period (Tischler and Remple 2012); {frame.averaging}",
        ),
        "dwell_cycles": (1, "one cycle at the first frequency, after which its response has settled"),
        "fade_in_s": fade,
        "fade_out_s": fade,
    }
