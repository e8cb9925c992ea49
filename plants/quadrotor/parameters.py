"""What the quadrotor is made of: presets of parameters with their sources, noise levels, layout and thrust map."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.errors import ExciteError
from plants.plant import Parameter

GRAVITY = 9.81  # m/s2
FULL_COMMAND = 65535  # 16-bit motor command

# Rows: torque about x (roll), y (pitch), z (yaw); columns: M1 front right, M2 rear right, M3 rear left, M4 front left.
# A positive entry means that this motor's thrust accelerates that axis positively (x forward, y left, z up).
SIGNS = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0]])

CRAZYSWARM2 = "Crazyflie 2.x model of crazyswarm2"
THRUST_MAP = "Crazyflie 2.0 thrust measurement: f = a u^2 + b u + c"
FIRMWARE = "Crazyflie firmware of 2013"

PRESETS: dict[str, dict[str, Parameter]] = {
    "2013": {
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
        "attitude_kp": Parameter(3.5, "1/s", FIRMWARE, "non-negative"),
        "attitude_ki": Parameter(2.0, "1/s2", FIRMWARE, "non-negative"),
        "attitude_kd": Parameter(0.0, "1", FIRMWARE, "non-negative"),
        "attitude_integral_limit": Parameter(20.0, "deg s", FIRMWARE),
        "rate_kp": Parameter(70.0, "s/deg", FIRMWARE, "non-negative"),
        "rate_ki": Parameter(0.0, "1/deg", FIRMWARE, "non-negative"),
        "rate_kd": Parameter(0.0, "s2/deg", FIRMWARE, "non-negative"),
        "rate_integral_limit": Parameter(100.0, "deg", "assumption: without effect while rate_ki is 0"),
        "yaw_rate_kp": Parameter(50.0, "s/deg", FIRMWARE, "non-negative"),
        "yaw_rate_ki": Parameter(25.0, "1/deg", FIRMWARE, "non-negative"),
        "yaw_rate_kd": Parameter(0.0, "s2/deg", FIRMWARE, "non-negative"),
        "yaw_rate_integral_limit": Parameter(500.0, "deg", FIRMWARE),
        "altitude_kp": Parameter(4.0, "1/s2", "assumption: altitude hold of 2 rad/s, critically damped", "non-negative"),
        "altitude_kd": Parameter(4.0, "1/s", "assumption: altitude hold of 2 rad/s, critically damped", "non-negative"),
    },
}

NOISE_SOURCES: dict[str, Parameter] = {
    "thrust": Parameter(
        0.002, "N", "assumption: white on each motor's commanded thrust every 2 ms, 3 % of hover; 0.4 % behind the lag"
    ),
    "gyro": Parameter(
        0.0028, "rad/s", "assumption: 0.01 deg/s/sqrt(Hz), usual for MEMS gyroscopes, over the 250 Hz of 2 ms samples"
    ),
    "attitude": Parameter(0.05, "deg", "assumption: short-term noise of a complementary filter, white, roll and pitch"),
}


@dataclass(frozen=True)
class ThrustMap:
    """Thrust of one motor [N] from its 16-bit command u: f = a u^2 + b u + c."""

    a: float
    b: float
    c: float

    def thrust(self, command: float) -> float:
        """Thrust at a command; also elementwise on arrays."""
        return (self.a * command + self.b) * command + self.c

    def slope(self, command: float) -> float:
        """Return df/du in N per unit."""
        return 2.0 * self.a * command + self.b

    def command(self, thrust: float) -> float:
        """Return the (unrounded) command that gives a thrust, the inverse of `thrust`."""
        lift = thrust - self.c
        return 2.0 * lift / (self.b + math.sqrt(self.b * self.b + 4.0 * self.a * lift))


def thrust_map(values: Mapping[str, float]) -> ThrustMap:
    """Return the thrust map of a set of parameter values."""
    return ThrustMap(values["thrust_a"], values["thrust_b"], values["thrust_c"])


def hover_command(values: Mapping[str, float]) -> float:
    """Return the (unrounded) motor command that carries a quarter of the weight."""
    motor, needed = thrust_map(values), values["mass"] * GRAVITY / 4.0
    least, most = motor.thrust(0.0), motor.thrust(FULL_COMMAND)
    if not least < needed < most:
        raise ExciteError(
            f"quadrotor: mass {values['mass']:g} kg needs {needed:.4g} N per motor to hover, but the thrust map spans "
            f"{least:.4g} to {most:.4g} N; change mass, or thrust_a, thrust_b and thrust_c"
        )
    return motor.command(needed)
