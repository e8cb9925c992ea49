"""The flight controller: cascaded PID of the Crazyflie firmware, mixer, and an altitude hold."""

from collections.abc import Mapping
from typing import Any

from plants.quadrotor.arithmetic import Arithmetic
from plants.quadrotor.parameters import DEGREES, FULL_COMMAND, GRAVITY, thrust_map

RATE_DT = 0.002  # s, rate loops at 500 Hz
FRAME = 2  # rate steps in one step of the attitude loops, which run at 250 Hz
ATTITUDE_DT = FRAME * RATE_DT


class Pid:
    """PID as the firmware computes it: the integral includes the present error and is limited.

    I(k) = clip(I(k-1) + e(k) dt),   output = kp e(k) + ki I(k) + kd (e(k) - e(k-1)) / dt

    The derivative is that of the error, as in 2013; later firmware differentiates the measurement alone, which moves
    zeros but no poles.
    """

    __slots__ = ("clip", "dt", "error", "integral", "kd", "ki", "kp", "limit")

    def __init__(self, values: Mapping[str, float], name: str, dt: float, arithmetic: Arithmetic) -> None:
        self.kp, self.ki, self.kd = (values[f"{name}_{gain}"] for gain in ("kp", "ki", "kd"))
        self.limit = values[f"{name}_integral_limit"]
        self.dt, self.clip = dt, arithmetic.clip
        self.integral = 0.0
        self.error = 0.0

    def update(self, error: Any) -> Any:
        """Advance one step and return the output; what has no gain is not computed."""
        output = self.kp * error
        if self.ki:
            self.integral = self.clip(self.integral + error * self.dt, -self.limit, self.limit)
            output = output + self.ki * self.integral
        if self.kd:
            output = output + self.kd * ((error - self.error) / self.dt)
            self.error = error
        return output


class Controller:
    """Attitude PID (250 Hz) around rate PID (500 Hz), degrees to 16-bit units; altitude hold; mixer.

    Axes x forward, y left, z up; angles are right-handed, so positive pitch is nose DOWN and positive yaw is to the
    left. (The firmware's own mixer counts pitch nose up and yaw to the right; its signs are turned accordingly.)

    The altitude hold is idealised: a PD law on the true altitude and vertical speed with the true tilt,
    4 f = m (g + kp (z_ref - z) + kd (dz_ref/dt - dz/dt)) / cos(tilt), turned into a command by the inverse thrust map.
    It acts on the collective only, and to first order not at all on roll, pitch and yaw.
    """

    def __init__(self, values: Mapping[str, float], arithmetic: Arithmetic) -> None:
        self._attitude = [Pid(values, "attitude", ATTITUDE_DT, arithmetic) for _ in range(2)]
        self._rate = [Pid(values, name, RATE_DT, arithmetic) for name in ("rate", "rate", "yaw_rate")]
        self._motor = thrust_map(values)
        self._mass, self._kp, self._kd = (values[name] for name in ("mass", "altitude_kp", "altitude_kd"))
        self._range = self._motor.thrust(0.0), self._motor.thrust(FULL_COMMAND)
        self._outer: tuple[Any, Any] = 0.0, 0.0
        self._clip, self._floor, self._sqrt = arithmetic.clip, arithmetic.floor, arithmetic.sqrt

    def step(
        self,
        k: int,
        base: Any,
        rates: tuple,
        roll: Any,
        pitch: Any,
        set_point: tuple,
        rates_added: tuple,
        motors_added: tuple,
    ) -> tuple[Any, ...]:
        """Return the set-points of p and q [deg/s], the roll, pitch and yaw commands, and the four motors', at step k.

        base : collective command; rates [rad/s], roll, pitch [deg] : measured; set_point : roll, pitch [deg] and yaw rate
        [deg/s]; rates_added [deg/s] and motors_added [16-bit units] : what is played further inside.
        """
        if k % FRAME == 0:
            self._outer = self.attitude(set_point[0] - roll, set_point[1] - pitch)
        p_ref, q_ref = self._outer[0] + rates_added[0], self._outer[1] + rates_added[1]
        r_ref = set_point[2] + rates_added[2]
        p, q, r = rates
        commands = self.rate(p_ref - p * DEGREES, q_ref - q * DEGREES, r_ref - r * DEGREES)
        return p_ref, q_ref, *commands, *self.mix(base, *commands, motors_added)

    def attitude(self, roll_error: Any, pitch_error: Any) -> tuple[Any, Any]:
        """Roll and pitch rate set-points [deg/s] from attitude errors [deg]; call once per frame."""
        return self._attitude[0].update(roll_error), self._attitude[1].update(pitch_error)

    def rate(self, p_error: Any, q_error: Any, r_error: Any) -> tuple[Any, Any, Any]:
        """Roll, pitch and yaw commands [16-bit units] from body rate errors [deg/s]; call each step."""
        return self._rate[0].update(p_error), self._rate[1].update(q_error), self._rate[2].update(r_error)

    def collective(self, altitude_error: Any, climb_error: Any, cos_tilt: Any) -> Any:
        """Collective command [16-bit units] from errors of altitude [m] and climb rate [m/s] and the cosine of the tilt."""
        acceleration = GRAVITY + self._kp * altitude_error + self._kd * climb_error
        force = self._mass * acceleration / (4.0 * cos_tilt)
        return self._motor.command(self._clip(force, *self._range), self._sqrt)

    def mix(self, collective: Any, roll: Any, pitch: Any, yaw: Any, added: tuple) -> tuple[Any, Any, Any, Any]:
        """Motor commands M1..M4: collective with half of roll and pitch, all of yaw and what is added to each motor."""
        r, p, (a1, a2, a3, a4) = 0.5 * roll, 0.5 * pitch, added
        return (
            self._integer(collective - r - p - yaw + a1),
            self._integer(collective - r + p + yaw + a2),
            self._integer(collective + r + p - yaw + a3),
            self._integer(collective + r - p + yaw + a4),
        )

    def _integer(self, command: Any) -> Any:
        """Return the command clipped to 16 bits and rounded."""
        return self._floor(self._clip(command, 0.0, FULL_COMMAND) + 0.5)
