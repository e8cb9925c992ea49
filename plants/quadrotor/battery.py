"""The battery: its voltage sags with charge drawn and with current, and thrust falls with the voltage squared."""

from collections.abc import Mapping
from typing import Any

from plants.quadrotor.arithmetic import Arithmetic
from plants.quadrotor.parameters import GRAVITY


class Battery:
    """V = V0 - slope Q - R (I - I_hover), I = I_hover (thrust / weight)^1.5, dQ/dt = I; thrust scales by (V / V0)^2.

    V0 is the voltage of the fresh battery in hover, where the thrust map holds. The exponent is momentum theory's for a
    hovering rotor; thrust goes with the square of rotor speed, and that with the voltage of a brushed motor.
    """

    def __init__(self, values: Mapping[str, float], dt: float, arithmetic: Arithmetic) -> None:
        names = ("battery_voltage", "battery_slope", "battery_resistance", "hover_current")
        self._fresh, self._slope, self._resistance, self._hover_current = (values[name] for name in names)
        self._weight, self._hours = values["mass"] * GRAVITY, dt / 3600.0
        self._clip, self._sqrt = arithmetic.clip, arithmetic.sqrt
        self._charge = 0.0  # A h
        self.voltage = self._fresh

    @staticmethod
    def sags(values: Mapping[str, float]) -> bool:
        """Whether the voltage moves at all."""
        return values["battery_slope"] > 0 or values["battery_resistance"] > 0

    def update(self, thrust: Any) -> Any:
        """Advance one step at a commanded total thrust [N]; return the factor on all thrusts."""
        load = thrust / self._weight
        current = self._hover_current * load * self._sqrt(load)
        drop = self._slope * self._charge + self._resistance * (current - self._hover_current)
        self.voltage = self._clip(self._fresh - drop, 0.0, float("inf"))
        self._charge = self._charge + current * self._hours
        ratio = self.voltage / self._fresh
        return ratio * ratio
