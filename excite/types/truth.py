"""Truth: what a simulated plant really is, made from its equations and never by identifying its output."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.models.state_space import StateSpaceModel
from excite.types.checked import NOT_GIVEN, ArrayByDefault

KINDS = ("exact", "linearised", "periodically time-varying", "best linear approximation")


@dataclass(frozen=True, eq=False)
class Truth:
    """The model that an ideal identification of one view would find.

    model : state space, with K and innovation covariance when the noise has a state-space description;
    kind : exact, linearised (small signals), periodically time-varying (no time-invariant model is true at this dt; the
    plant says what `model` is then), or best linear approximation;
    accuracy : relative error of the frequency response that small noise-free runs may show against it, more than the
    default only for a reason that the plant states;
    parameters : name -> (value, unit); valid_amplitude : text, where the linearisation holds;
    poles : (z-plane) those of the path from inputs to outputs, by which an estimate is judged; all of the model's, unless
    some of its states shape noise alone.
    """

    model: StateSpaceModel
    kind: str
    parameters: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    valid_amplitude: str = ""
    poles: ArrayByDefault = NOT_GIVEN
    accuracy: float = 0.005

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ExciteError(f"Truth.kind: {self.kind!r}; {did_you_mean(str(self.kind), KINDS)}")
        poles = self.model.poles() if self.poles is None else np.asarray(self.poles, complex)
        object.__setattr__(self, "poles", poles)

    def lift(self, every: int) -> "Truth":
        """Return the truth at dt * every, for an input held over each longer interval."""
        return replace(self, model=self.model.lift(every), poles=self.poles**every)

    def select(self, outputs: Sequence[str]) -> "Truth":
        """Return the truth of the named outputs alone."""
        return replace(self, model=self.model.select(outputs))
