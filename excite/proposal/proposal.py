"""The design loop: parameters of a signal from what is known of a plant, each with its reason."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from excite.errors import ExciteError, did_you_mean
from excite.proposal.frame import Choices, Frame, averaging, sampling
from excite.proposal.knowledge import Knowledge
from excite.proposal.multisine import multisine
from excite.proposal.prbs import prbs
from excite.proposal.sweep import sweep

# One line adds a kind: name of the generator -> what chooses its parameters.
KINDS: Mapping[str, Callable[[Frame], Choices]] = {"prbs": prbs, "multisine": multisine, "sweep": sweep}


@dataclass(frozen=True)
class Proposal:
    """A generator's name, its parameters, the reason for each, and what to beware of."""

    kind: str
    parameters: Mapping[str, Any]
    reasons: Mapping[str, str]
    warnings: tuple[str, ...] = ()


def propose(kind: str, known: Knowledge, dt: float | None = None, channels: int = 1) -> Proposal:
    """Propose a signal for what is known of a plant.

    Parameters
    ----------
    kind : one of KINDS.
    known : see `Knowledge`; `knowledge_of` reads it from a model.
    dt : sampling time, s, where it is given; None: chosen for the bandwidth.
    channels : number of inputs.

    Raises
    ------
    DesignRefused where the given sampling cannot show the bandwidth; ExciteError for an unknown kind, and where what is
    known leaves nothing to play.

    Examples
    --------
    >>> propose("prbs", Knowledge(bandwidth_hz=5.0, settling_s=2.0, limit=1.0)).parameters["order"]
    5
    """
    if kind not in KINDS:
        raise ExciteError(f"propose: kind '{kind}'; {did_you_mean(kind, KINDS)}")
    dt, reason, warnings = sampling(known, dt)
    periods, average, more = averaging(known)
    choices: Choices = {
        "dt": (dt, reason),
        "amplitude": (known.limit, "the limit: the information grows with the square of the amplitude"),
        "channels": (channels, None),
    }
    choices |= KINDS[kind](Frame(known, dt, channels, periods, average))
    parameters = {name: value for name, (value, _) in choices.items()}
    reasons = {name: why for name, (_, why) in choices.items() if why is not None}
    return Proposal(kind, parameters, reasons, (*warnings, *more))
