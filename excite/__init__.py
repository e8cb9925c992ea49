"""Design the input of an identification experiment. `from excite import Signal, prbs, certify, …`."""

from excite.generators import multisine, multistep, noise, prbs, sweep
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import Certificate, certify
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth

__all__ = [
    "Certificate",
    "Channel",
    "Experiment",
    "Loop",
    "PolynomialModel",
    "Recording",
    "Roles",
    "Signal",
    "StateSpaceModel",
    "Truth",
    "certify",
    "multisine",
    "multistep",
    "noise",
    "prbs",
    "sweep",
]
