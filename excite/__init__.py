"""Design the input of an identification experiment. `from excite import Signal, prbs, certify, …`."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from excite.files.load import load_experiment
    from excite.generators import multisine, multistep, noise, prbs, sweep
    from excite.models.fir import FirModel
    from excite.models.foster import FosterModel
    from excite.models.frequency_response import FrequencyResponse
    from excite.models.polynomial import PolynomialModel
    from excite.models.state_space import StateSpaceModel
    from excite.persistency.certificate import Certificate, certify
    from excite.types.channel import Channel
    from excite.types.experiment import Experiment
    from excite.types.level import Level
    from excite.types.loop import Loop
    from excite.types.recording import Recording, Roles
    from excite.types.signal import Signal
    from excite.types.truth import Truth

__all__ = [
    "Certificate",
    "Channel",
    "Experiment",
    "FirModel",
    "FosterModel",
    "FrequencyResponse",
    "Level",
    "Loop",
    "PolynomialModel",
    "Recording",
    "Roles",
    "Signal",
    "StateSpaceModel",
    "Truth",
    "certify",
    "load_experiment",
    "multisine",
    "multistep",
    "noise",
    "prbs",
    "sweep",
]
__getattr__, __dir__ = face(
    __name__,
    {
        "Certificate": "excite.persistency.certificate",
        "Channel": "excite.types.channel",
        "Experiment": "excite.types.experiment",
        "FirModel": "excite.models.fir",
        "FosterModel": "excite.models.foster",
        "FrequencyResponse": "excite.models.frequency_response",
        "Level": "excite.types.level",
        "Loop": "excite.types.loop",
        "PolynomialModel": "excite.models.polynomial",
        "Recording": "excite.types.recording",
        "Roles": "excite.types.recording",
        "Signal": "excite.types.signal",
        "StateSpaceModel": "excite.models.state_space",
        "Truth": "excite.types.truth",
        "certify": "excite.persistency.certificate",
        "load_experiment": "excite.files.load",
        "multisine": "excite.generators",
        "multistep": "excite.generators",
        "noise": "excite.generators",
        "prbs": "excite.generators",
        "sweep": "excite.generators",
    },
)
