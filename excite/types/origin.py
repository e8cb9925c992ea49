"""Origin: where a recording comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from excite.errors import ExciteError
from excite.plain import plain
from excite.types.frozen import Frozen


@dataclass(frozen=True)
class Origin:
    """The simulated plant that made a recording, or the file that it was read from.

    plant, preset, parameters : which plant, in `plants.registry`; inject : where the signal entered it; noise : standard
    deviation of every source; seed : of the noise; start_s : when the excitation begins; file : the data file of a
    measurement; preparation : what was done to the data before they came here, in words.
    """

    plant: str | None = None
    preset: str | None = None
    parameters: Mapping[str, Any] = field(default_factory=Frozen)
    inject: str | None = None
    noise: Mapping[str, float] = field(default_factory=Frozen)
    seed: int | None = None
    start_s: float = 0.0
    file: str | None = None
    preparation: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ("parameters", "noise"):
            object.__setattr__(self, key, Frozen(getattr(self, key)))
        object.__setattr__(self, "preparation", tuple(self.preparation))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for files."""
        return plain({f.name: getattr(self, f.name) for f in fields(self)}, finite=False)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Origin":
        """Read what `to_dict` gave; raises ExciteError for unknown keys."""
        try:
            return cls(**data)
        except TypeError as error:
            raise ExciteError(f"origin: {error}; write the recording again") from None
