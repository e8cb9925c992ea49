"""Estimate: what a method returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from excite.models.model import Model


class Status(Enum):
    """How far an estimate can be trusted; the value is the message."""

    OK = "ok"
    UNSTABLE = "the estimated model is unstable although the data were taken in open loop"
    SUSPECT = "the estimate was obtained, but its warnings should be read first"


@dataclass(frozen=True, eq=False)
class Estimate:
    """One identified model and how it came about.

    order : states, without those that only delay the inputs (lags for arx); x0 : initial state of the state-space form, one
    (n,) array an experiment (where samples are missing, at the first of its first gap-free part);
    singular_values : (k,) from which the order can be judged, or None; uncertainty : None, or what the method states;
    condition, path : condition number of the compressed data and the numerical path taken; seconds : wall time.
    """

    model: Model
    method: str
    order: int
    x0: tuple[np.ndarray, ...] = ()
    singular_values: np.ndarray | None = None
    uncertainty: Mapping | None = None
    status: Status = Status.OK
    warnings: tuple[str, ...] = ()
    settings: Mapping = field(default_factory=dict)
    condition: float | None = None
    path: str | None = None
    seconds: float = 0.0
