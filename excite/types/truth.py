"""Truth: what a simulated plant really is, made from its equations and never by identifying its output."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from excite.errors import ExciteError, did_you_mean
from excite.types.models import StateSpaceModel

KINDS = ("exact", "linearised", "best linear approximation")


@dataclass(frozen=True, eq=False)
class Truth:
    """The model that an ideal identification of one setting would find.

    model : state space, with K and innovation covariance when the noise has a state-space description;
    kind : exact, linearised (small signals), or best linear approximation;
    parameters : name -> (value, unit); valid_amplitude : text, where the linearisation holds.
    """

    model: StateSpaceModel
    kind: str
    parameters: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    valid_amplitude: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ExciteError(f"Truth.kind: {self.kind!r}; {did_you_mean(str(self.kind), KINDS)}")
