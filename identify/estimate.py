"""Estimate: what a method returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from excite.types.frozen import Frozen
from identify.uncertainty.uncertainty import Uncertainty


class Status(Enum):
    """How far an estimate can be trusted; the value is the message."""

    OK = "ok"
    UNSTABLE = "the estimated model is unstable although the data were taken in open loop"
    SUSPECT = "the estimate was obtained, but its warnings should be read first"


@dataclass(frozen=True, eq=False)
class Estimate:
    """One identified model and how it came about.

    order : states, without those that only delay the inputs (lags for arx), None for a method without an order; x0 :
    initial state of the state-space form, (n,) per record (where samples are missing, at the first of its first gap-free
    part); singular_values : (k,) from which the order can be judged, or None; uncertainty : None where the method states
    none; settings : of the method, as plain values; preparation : what was done to the data before, in words; condition,
    route : condition number of the condensed data and the numerical route taken; seconds : wall time.
    """

    model: Model
    method: str
    order: int | None
    x0: tuple[np.ndarray, ...] = ()
    singular_values: np.ndarray | None = None
    uncertainty: Uncertainty | None = None
    status: Status = Status.OK
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=Frozen)
    preparation: tuple[str, ...] = ()
    condition: float | None = None
    route: str | None = None
    seconds: float = 0.0

    @property
    def dynamic(self) -> Dynamic:
        """The model, where it has poles and can be simulated; raises ExciteError where it is known by its response alone."""
        if not isinstance(self.model, Dynamic):
            raise ExciteError(
                f"{self.method}: a {type(self.model).__name__} has no poles; take a method that finds some"
            )
        return self.model
