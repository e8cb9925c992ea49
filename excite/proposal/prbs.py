"""A proposal for a pseudo-random binary sequence."""

from excite.errors import ExciteError
from excite.proposal.frame import Choices, Frame


def prbs(frame: Frame) -> Choices:
    """Choose the order, the clock and the periods of a PRBS."""
    return {
        "order": (
            _order(frame),
            f"the shortest sequence whose {frame.channels} shifted copies stay apart for the settling time",
        ),
        "highest_hz": (
            frame.known.bandwidth_hz,
            "the bandwidth; the clock follows at 2.5 times it, where the spectrum has lost 2.3 dB",
        ),
        "periods": (frame.periods, frame.averaging),
    }


def _order(frame: Frame) -> int:
    clock, settling_s = 2.5 * frame.known.bandwidth_hz, frame.known.settling_s
    for order in range(4, 33):
        if (2**order - 1) / clock >= 1.2 * frame.channels * settling_s:
            return order
    raise ExciteError(
        f"propose: no sequence up to order 32 lasts {frame.channels} settling times of {settling_s:g} s at a clock of "
        f"{clock:g} Hz; lower the bandwidth"
    )
