"""Stabilisation diagram: which modes stay from order to order."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.models.modes import Mode
from excite.models.state_space import StateSpaceModel


@dataclass(frozen=True)
class StablePole:
    """One mode of one order in a stabilisation diagram, and whether the next lower order has it too."""

    order: int
    mode: Mode
    frequency: bool
    damping: bool
    shape: bool


def stabilisation(
    models: Mapping[int, StateSpaceModel], frequency: float = 0.01, damping: float = 0.05, mac: float = 0.98
) -> tuple[StablePole, ...]:
    """Return the modes of models, given by their order, each compared with the nearest mode of the next lower order.

    frequency, damping : relative changes up to which a mode is stable in them; mac : least modal assurance criterion
    |a^H b|^2 / (a^H a b^H b) of stable shapes (Peeters and De Roeck, Mech. Syst. Signal Process. 13, 1999). The modes of
    the first model are not stable in anything.
    """
    found: list[StablePole] = []
    before: tuple[Mode, ...] = ()
    for order in sorted(models):
        modes = models[order].modes()
        for mode in modes:
            if not before:
                found.append(StablePole(order, mode, False, False, False))
                continue
            near = min(before, key=lambda other: abs(other.pole - mode.pole))
            same_frequency = bool(abs(mode.f_hz - near.f_hz) <= frequency * near.f_hz)
            same_damping = bool(abs(mode.damping - near.damping) <= damping * abs(near.damping))
            found.append(StablePole(order, mode, same_frequency, same_damping, _mac(mode.shape, near.shape) >= mac))
        before = modes
    return tuple(found)


def _mac(a: np.ndarray, b: np.ndarray) -> float:
    size = np.vdot(a, a).real * np.vdot(b, b).real
    return float(abs(np.vdot(a, b)) ** 2 / size) if size > 0 else 0.0
