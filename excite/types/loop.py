"""Loop: how the plant was operated while it was recorded."""

from dataclasses import dataclass

from excite.errors import ExciteError, did_you_mean
from excite.models.state_space import StateSpaceModel

STATES = ("open", "closed", "unknown")
ENTRIES = ("set-point", "plant input")


@dataclass(frozen=True)
class Loop:
    """Whether the input depended on the output through feedback, and through which.

    state : "open", "closed", or "unknown" where nobody said; controller : state-space model from the measured outputs
    (error) to the plant input, None when open or unknown; sign : sign of the feedback; entry : where the reference enters
    (r1 "plant input", r2 "set-point" of the usual diagram; Van den Hof 1998).
    """

    state: str
    controller: StateSpaceModel | None = None
    sign: int = -1
    entry: str = "set-point"

    def __post_init__(self) -> None:
        if self.state not in STATES:
            raise ExciteError(f"Loop.state: {self.state!r}; {did_you_mean(str(self.state), STATES)}")
        if self.sign not in (-1, 1):
            raise ExciteError(f"Loop.sign: {self.sign!r}; use -1 or 1")
        if self.entry not in ENTRIES:
            raise ExciteError(f"Loop.entry: {self.entry!r}; {did_you_mean(str(self.entry), ENTRIES)}")
        if self.controller is not None and self.state != "closed":
            raise ExciteError(f'Loop.controller: a controller is given, but the loop is {self.state}; state = "closed"')

    @classmethod
    def of(cls, value: "Loop | str | None") -> "Loop":
        """Return the loop that a state names, "open" where there is none; a Loop as it is."""
        return value if isinstance(value, Loop) else cls("open" if value is None else value)

    @property
    def closed(self) -> bool:
        """Whether the loop is known to be closed."""
        return self.state == "closed"
