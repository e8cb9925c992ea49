"""Generators: functions that return a Signal; one line in `excite.generators.registry` adds one everywhere."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from excite.generators.compose import in_sequence, rest, side_by_side, with_ramps
    from excite.generators.multisine import multisine
    from excite.generators.multistep import log_times, multistep
    from excite.generators.noise import noise
    from excite.generators.prbs import prbs
    from excite.generators.registry import GENERATORS, regenerate
    from excite.generators.sweep import sweep

__all__ = [
    "GENERATORS",
    "in_sequence",
    "log_times",
    "multisine",
    "multistep",
    "noise",
    "prbs",
    "regenerate",
    "rest",
    "side_by_side",
    "sweep",
    "with_ramps",
]
__getattr__, __dir__ = face(
    __name__,
    {
        "GENERATORS": "excite.generators.registry",
        "in_sequence": "excite.generators.compose",
        "log_times": "excite.generators.multistep",
        "multisine": "excite.generators.multisine",
        "multistep": "excite.generators.multistep",
        "noise": "excite.generators.noise",
        "prbs": "excite.generators.prbs",
        "regenerate": "excite.generators.registry",
        "rest": "excite.generators.compose",
        "side_by_side": "excite.generators.compose",
        "sweep": "excite.generators.sweep",
        "with_ramps": "excite.generators.compose",
    },
)
