"""The flight controller: cascaded PID of the Crazyflie firmware, mixer, and an altitude hold."""

import math
from collections.abc import Mapping

from plants.quadrotor.parameters import FULL_COMMAND, GRAVITY, thrust_map

RATE_DT = 0.002  # s, rate loops at 500 Hz
FRAME = 2  # rate steps in one step of the attitude loops, which run at 250 Hz
ATTITUDE_DT = FRAME * RATE_DT


class Pid:
    """PID as the firmware computes it: the integral includes the present error and is limited.

    I(k) = clip(I(k-1) + e(k) dt),   output = kp e(k) + ki I(k) + kd (e(k) - e(k-1)) / dt
    """

    __slots__ = ("dt", "error", "integral", "kd", "ki", "kp", "limit")

    def __init__(self, values: Mapping[str, float], name: str, dt: float) -> None:
        self.kp, self.ki, self.kd = (values[f"{name}_{gain}"] for gain in ("kp", "ki", "kd"))
        self.limit = values[f"{name}_integral_limit"]
        self.dt = dt
        self.integral = 0.0
        self.error = 0.0

    def update(self, error: float) -> float:
        """Advance one step and return the output."""
        integral, slope = self.integral + error * self.dt, (error - self.error) / self.dt
        if not -self.limit < integral < self.limit:
            integral = math.copysign(self.limit, integral)
        self.integral, self.error = integral, error
        return self.kp * error + self.ki * integral + self.kd * slope


class Controller:
    """Attitude PID (250 Hz) around rate PID (500 Hz), degrees to 16-bit units; altitude hold; mixer.

    Axes x forward, y left, z up; angles are right-handed, so positive pitch is nose DOWN and positive yaw is to the
    left. (The firmware's own mixer counts pitch nose up and yaw to the right; its signs are turned accordingly.)

    The altitude hold is idealised: a PD law on the true altitude and vertical speed with the true tilt,
    4 f = m (g + kp (z_ref - z) - kd dz/dt) / cos(tilt), turned into a command by the inverse thrust map. It acts on
    the collective only, and to first order not at all on roll, pitch and yaw.
    """

    def __init__(self, values: Mapping[str, float], altitude_ref: float) -> None:
        self._attitude = [Pid(values, "attitude", ATTITUDE_DT) for _ in range(2)]
        self._rate = [Pid(values, name, RATE_DT) for name in ("rate", "rate", "yaw_rate")]
        self._motor = thrust_map(values)
        self._mass, self._altitude_ref = values["mass"], altitude_ref
        self._kp, self._kd = values["altitude_kp"], values["altitude_kd"]
        self._range = self._motor.thrust(0.0), self._motor.thrust(FULL_COMMAND)

    def attitude(self, roll_error: float, pitch_error: float) -> tuple[float, float]:
        """Roll and pitch rate set-points [deg/s] from attitude errors [deg]; call once a frame."""
        return self._attitude[0].update(roll_error), self._attitude[1].update(pitch_error)

    def rate(self, p_error: float, q_error: float, r_error: float) -> tuple[float, float, float]:
        """Roll, pitch and yaw commands [16-bit units] from body rate errors [deg/s]; call each step."""
        return self._rate[0].update(p_error), self._rate[1].update(q_error), self._rate[2].update(r_error)

    def collective(self, altitude: float, climb: float, cos_tilt: float) -> float:
        """Collective command [16-bit units] from true altitude [m], climb rate [m/s] and cosine of the tilt."""
        acceleration = GRAVITY + self._kp * (self._altitude_ref - altitude) - self._kd * climb
        force = self._mass * acceleration / (4.0 * cos_tilt)
        return self._motor.command(min(max(force, self._range[0]), self._range[1]))


def mix(collective: float, roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Motor commands M1..M4: collective with half of roll and pitch and all of yaw, clipped to 16 bits and rounded."""
    r, p = 0.5 * roll, 0.5 * pitch
    return (
        _integer(collective - r - p - yaw),
        _integer(collective - r + p + yaw),
        _integer(collective + r + p - yaw),
        _integer(collective + r - p + yaw),
    )


def _integer(command: float) -> float:
    if 0.0 < command < FULL_COMMAND:
        return float(int(command + 0.5))
    return 0.0 if command <= 0.0 else float(FULL_COMMAND)
