"""What the vehicle carries besides its controller: sensors with the estimate of attitude, and motors on a battery."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plants.quadrotor.air import Drag
from plants.quadrotor.arithmetic import Arithmetic
from plants.quadrotor.battery import Battery
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT
from plants.quadrotor.estimator import Mahony, roll_and_pitch
from plants.quadrotor.parameters import DEGREES, GRAVITY, thrust_map


class Sensors:
    """Accelerometer and attitude, measured or estimated; the drag, which the accelerometer feels, acts here.

    force : MuJoCo's generalised force on the body, into which the drag is written.
    """

    def __init__(self, values: Mapping[str, float], arithmetic: Arithmetic, force: np.ndarray) -> None:
        self._arithmetic, self._force = arithmetic, force
        self._estimator = Mahony(values["estimator_kp"], ATTITUDE_DT, arithmetic) if values["estimator_kp"] else None
        self._drag = Drag(values) if values["drag"] else None
        self._last_climb = 0.0
        self._angles: tuple[Any, Any] = 0.0, 0.0

    def read(
        self,
        k: int,
        attitude: tuple,
        velocity: tuple,
        cos_tilt: Any,
        rates: tuple,
        angles: tuple,
        shake: tuple,
        air: tuple,
    ) -> tuple[Any, Any, Any, Any, Any]:
        """Return roll, pitch [deg] and specific force x, y, z [m/s2] as they are measured at step k.

        attitude : the true quaternion, and cos_tilt its 1 - 2 (qx^2 + qy^2); velocity : true, in world axes [m/s]; rates :
        as the gyroscope shows them [rad/s]; angles, shake : noise of attitude and accelerometer; air : wind [m/s].
        """
        climb = velocity[2]
        push_x = push_y = 0.0
        if self._drag:
            push_x, push_y = self._drag.act(velocity, air, attitude, self._force)
        lift = (GRAVITY + (climb - self._last_climb) / RATE_DT) / cos_tilt
        ax, ay, az = push_x + shake[0], push_y + shake[1], lift + shake[2]
        self._last_climb = climb
        if not self._estimator:
            qw, qx, qy, qz = attitude
            self._angles = roll_and_pitch(self._arithmetic, qw, qx, qy, qz, cos_tilt)
        elif k % FRAME == 0:
            self._angles = self._estimator.update(rates, (ax, ay, az))
        roll, pitch = self._angles
        return roll * DEGREES + angles[0], pitch * DEGREES + angles[1], ax, ay, az


class Motors:
    """Four motors by the thrust map, on a battery that may sag; command : MuJoCo's, commanded thrusts [N]."""

    def __init__(self, values: Mapping[str, float], arithmetic: Arithmetic, command: np.ndarray) -> None:
        self._thrust, self._command = thrust_map(values).thrust, command
        self._battery = Battery(values, RATE_DT, arithmetic) if Battery.sags(values) else None
        self._voltage = values["battery_voltage"]

    def drive(self, commanded: tuple, noise: tuple) -> Any:
        """Write the thrusts of the 16-bit motor commands, the last four of `commanded`, with noise [N]; return the voltage."""
        *_, m1, m2, m3, m4 = commanded
        thrust, command = self._thrust, self._command
        f1, f2, f3, f4 = thrust(m1), thrust(m2), thrust(m3), thrust(m4)
        if self._battery:
            strength, self._voltage = self._battery.update(f1 + f2 + f3 + f4), self._battery.voltage
            f1, f2, f3, f4 = strength * f1, strength * f2, strength * f3, strength * f4
        command[0], command[1], command[2], command[3] = f1 + noise[0], f2 + noise[1], f3 + noise[2], f4 + noise[3]
        return self._voltage
