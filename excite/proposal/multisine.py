"""A proposal for a multisine."""

from math import ceil

from excite.proposal.frame import Choices, Frame


def multisine(frame: Frame) -> Choices:
    """Choose the period, the band, the lines and the periods of a multisine."""
    known = frame.known
    period = ceil(2 * frame.channels * known.settling_s / frame.dt) * frame.dt
    choices: Choices = {
        "period_s": (
            period,
            "twice the settling time per channel: each channel's lines are closer than the sharpest resonance",
        ),
        "band_hz": ([1 / period, known.bandwidth_hz], "from the first line to the bandwidth"),
        "spacing": ("odd", "odd lines: what appears on even ones is nonlinear distortion"),
        "periods": (frame.periods + 1, f"{frame.averaging}; one more, the first, is transient"),
    }
    if known.spectrum is not None:
        choices["spectrum"] = (
            [list(point) for point in known.spectrum],
            "noise over gain of the model: every line learns the response equally well",
        )
    return choices
