"""What the quadrotor is made of: presets of parameters with their sources, noise levels, layout and thrust map."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from excite.errors import ExciteError
from plants.arguments import Parameter

GRAVITY = 9.81  # m/s2
DEGREES = 180.0 / math.pi  # in a radian
FULL_COMMAND = 65535  # 16-bit motor command

# Rows: torque about x (roll), y (pitch), z (yaw); columns: M1 front right, M2 rear right, M3 rear left, M4 front left.
# A positive entry means that this motor's thrust accelerates that axis positively (x forward, y left, z up).
SIGNS = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0]])

CRAZYSWARM2 = "Crazyflie 2.x model of crazyswarm2"
THRUST_MAP = "Crazyflie 2.0 thrust measurement: f = a u^2 + b u + c"
FIRMWARE_2013 = "Crazyflie firmware of 2013"
FIRMWARE = "Crazyflie 2.1 firmware, platform_defaults_cf2"
OFF = "off in this preset"

_VEHICLE_2013 = {
    "mass": Parameter(0.0275, "kg", "assumption: Crazyflie 2.x with battery and one deck; hover at command 36817"),
    "ixx": Parameter(16.57e-6, "kg m2", CRAZYSWARM2),
    "iyy": Parameter(16.66e-6, "kg m2", CRAZYSWARM2),
    "izz": Parameter(29.26e-6, "kg m2", CRAZYSWARM2),
    "arm": Parameter(0.046, "m", f"{CRAZYSWARM2}: centre to motor axis"),
    "motor_tau": Parameter(0.05, "s", "assumption: published values range from 5 to 114 ms"),
    "torque_per_thrust": Parameter(0.005964552, "m", THRUST_MAP),
    "thrust_a": Parameter(2.130295e-11, "N", THRUST_MAP),
    "thrust_b": Parameter(1.032633e-6, "N", THRUST_MAP),
    "thrust_c": Parameter(5.48456e-4, "N", THRUST_MAP, "non-negative"),
}
_GAINS_2013 = {
    "attitude_kp": Parameter(3.5, "1/s", FIRMWARE_2013, "non-negative"),
    "attitude_ki": Parameter(2.0, "1/s2", FIRMWARE_2013, "non-negative"),
    "attitude_kd": Parameter(0.0, "1", FIRMWARE_2013, "non-negative"),
    "attitude_integral_limit": Parameter(20.0, "deg s", FIRMWARE_2013),
    "rate_kp": Parameter(70.0, "s/deg", FIRMWARE_2013, "non-negative"),
    "rate_ki": Parameter(0.0, "1/deg", FIRMWARE_2013, "non-negative"),
    "rate_kd": Parameter(0.0, "s2/deg", FIRMWARE_2013, "non-negative"),
    "rate_integral_limit": Parameter(100.0, "deg", "assumption: without effect while rate_ki is 0"),
    "yaw_rate_kp": Parameter(50.0, "s/deg", FIRMWARE_2013, "non-negative"),
    "yaw_rate_ki": Parameter(25.0, "1/deg", FIRMWARE_2013, "non-negative"),
    "yaw_rate_kd": Parameter(0.0, "s2/deg", FIRMWARE_2013, "non-negative"),
    "yaw_rate_integral_limit": Parameter(500.0, "deg", FIRMWARE_2013),
    "altitude_kp": Parameter(4.0, "1/s2", "assumption: altitude hold of 2 rad/s, critically damped", "non-negative"),
    "altitude_kd": Parameter(4.0, "1/s", "assumption: altitude hold of 2 rad/s, critically damped", "non-negative"),
}
_FLIGHT = {
    "hover_altitude": Parameter(10.0, "m", "assumption: far from the ground"),
    "takeoff": Parameter(0.0, "s", "0 starts in hover; else half climbs from the ground, half hovers", "non-negative"),
}
_IDEAL = {
    "estimator_kp": Parameter(0.0, "1/s", f"{OFF}: 0 measures attitude directly", "non-negative"),
    "drag": Parameter(0.0, "N s/m", OFF, "non-negative"),
    "drag_height": Parameter(0.0, "m", OFF, "any"),
    "gust_tau": Parameter(1.0, "s", "assumption: eddies of metres at metres per second"),
    "battery_voltage": Parameter(3.9, "V", "assumption: one fresh lithium-polymer cell under load"),
    "battery_slope": Parameter(0.0, "V/(A h)", OFF, "non-negative"),
    "battery_resistance": Parameter(0.0, "ohm", OFF, "non-negative"),
    "hover_current": Parameter(1.46, "A", "170 mAh in 7 minutes of flight, the Crazyflie of 2013"),
}
_TODAY = {
    "mass": Parameter(0.034, "kg", CRAZYSWARM2),
    "attitude_kp": Parameter(6.0, "1/s", FIRMWARE, "non-negative"),
    "attitude_ki": Parameter(3.0, "1/s2", FIRMWARE, "non-negative"),
    "attitude_integral_limit": Parameter(20.0, "deg s", FIRMWARE),
    "rate_kp": Parameter(250.0, "s/deg", FIRMWARE, "non-negative"),
    "rate_ki": Parameter(500.0, "1/deg", FIRMWARE, "non-negative"),
    "rate_kd": Parameter(2.5, "s2/deg", FIRMWARE, "non-negative"),
    "rate_integral_limit": Parameter(33.3, "deg", FIRMWARE),
    "yaw_rate_kp": Parameter(120.0, "s/deg", FIRMWARE, "non-negative"),
    "yaw_rate_ki": Parameter(16.7, "1/deg", FIRMWARE, "non-negative"),
    "yaw_rate_integral_limit": Parameter(166.7, "deg", FIRMWARE),
    "hover_current": Parameter(2.14, "A", "assumption: 250 mAh in 7 minutes of flight, the Crazyflie 2.1"),
}
_OUTDOORS = {
    "estimator_kp": Parameter(0.4, "1/s", "Crazyflie firmware, sensfusion6", "non-negative"),
    "drag": Parameter(
        0.0056,
        "N s/m",
        "gym-pybullet-drones cf2x: 9.1785e-7 N s/m per rad/s, four rotors at 1516 rad/s",
        "non-negative",
    ),
    "drag_height": Parameter(0.005, "m", "assumption: rotors' plane above the centre of mass", "any"),
    "battery_slope": Parameter(2.8, "V/(A h)", "assumption: 0.7 V over 250 mAh", "non-negative"),
    "battery_resistance": Parameter(0.1, "ohm", "assumption: cell, leads and connector", "non-negative"),
}
_PRESET_2013 = _VEHICLE_2013 | _GAINS_2013 | _FLIGHT | _IDEAL

# 2013: the vehicle of Kee (2013); today: gains and mass of the present one; outdoors: today's with what the others idealise.
PRESETS: dict[str, dict[str, Parameter]] = {
    "2013": _PRESET_2013,
    "today": _PRESET_2013 | _TODAY,
    "outdoors": _PRESET_2013 | _TODAY | _OUTDOORS,
}

# The order is that of the random streams: new sources come last. Source -> channels it disturbs.
NOISE_CHANNELS = {
    "thrust": 4,
    "gyro": 3,
    "attitude": 2,
    "accelerometer": 3,
    "gyro_bias": 3,
    "accelerometer_bias": 3,
    "gust": 2,
}

_NOISE_INDOORS = {
    "thrust": Parameter(
        0.002, "N", "assumption: white on each motor's commanded thrust every 2 ms, 3 % of hover; 0.4 % behind the lag"
    ),
    "gyro": Parameter(
        0.0028, "rad/s", "assumption: 0.01 deg/s/sqrt(Hz), usual for MEMS gyroscopes, over the 250 Hz of 2 ms samples"
    ),
    "attitude": Parameter(0.05, "deg", "assumption: short-term noise of a complementary filter, white, roll and pitch"),
    "accelerometer": Parameter(0.0, "m/s2", OFF),
    "gyro_bias": Parameter(0.0, "rad/s", f"{OFF}; drawn once per flight"),
    "accelerometer_bias": Parameter(0.0, "m/s2", f"{OFF}; drawn once per flight"),
    "gust": Parameter(0.0, "m/s", f"{OFF}; horizontal wind, acts through the drag"),
}
_NOISE_OUTDOORS = _NOISE_INDOORS | {
    "attitude": Parameter(0.0, "deg", "the estimator makes its own"),
    "accelerometer": Parameter(0.03, "m/s2", "assumption: 190 ug/sqrt(Hz), usual for MEMS, over 250 Hz"),
    "gyro_bias": Parameter(
        0.002, "rad/s", "assumption: what calibration before take-off leaves; drawn once per flight"
    ),
    "accelerometer_bias": Parameter(0.1, "m/s2", "assumption: 10 mg after calibration; drawn once per flight"),
    "gust": Parameter(0.5, "m/s", "assumption: light air; horizontal wind, acts through the drag"),
}
NOISE_SOURCES: dict[str, dict[str, Parameter]] = {
    "2013": _NOISE_INDOORS,
    "today": _NOISE_INDOORS,
    "outdoors": _NOISE_OUTDOORS,
}

Quantity = TypeVar("Quantity", float, np.ndarray)


@dataclass(frozen=True)
class ThrustMap:
    """Thrust of one motor [N] from its 16-bit command u: f = a u^2 + b u + c."""

    a: float
    b: float
    c: float

    def thrust(self, command: Quantity) -> Quantity:
        """Thrust at a command; also elementwise on arrays."""
        return (self.a * command + self.b) * command + self.c

    def slope(self, command: float) -> float:
        """Return df/du in N per unit."""
        return 2.0 * self.a * command + self.b

    def command(self, thrust: float, sqrt: Callable = math.sqrt) -> float:
        """Return the (unrounded) command that gives a thrust, the inverse of `thrust`; sqrt for arrays: np.sqrt."""
        lift = thrust - self.c
        return 2.0 * lift / (self.b + sqrt(self.b * self.b + 4.0 * self.a * lift))


def thrust_map(values: Mapping[str, float]) -> ThrustMap:
    """Return the thrust map of a set of parameter values."""
    return ThrustMap(values["thrust_a"], values["thrust_b"], values["thrust_c"])


def hover_command(values: Mapping[str, float]) -> float:
    """Return the (unrounded) motor command that carries a quarter of the weight; refuse what cannot hover."""
    motor, needed = thrust_map(values), values["mass"] * GRAVITY / 4.0
    least, most = motor.thrust(0.0), motor.thrust(FULL_COMMAND)
    if not least < needed < most:
        raise ExciteError(
            f"quadrotor: mass {values['mass']:g} kg needs {needed:.4g} N per motor to hover, but the thrust map spans "
            f"{least:.4g} to {most:.4g} N; change mass, or thrust_a, thrust_b and thrust_c"
        )
    return motor.command(needed)
