"""The attitude estimate of the firmware: Mahony's complementary filter on gyroscope and accelerometer."""

from typing import Any

from plants.quadrotor.arithmetic import Arithmetic


class Mahony:
    """Quaternion integration of the gyro, corrected towards the vertical that the accelerometer shows.

    e = a/|a| x v,   w = gyro + kp e,   q <- q + dt/2 q (0, w), normalised

    v is the vertical by the present estimate, in body axes; kp [1/s], so that 1/kp is the time constant with which the
    estimate follows the accelerometer. The accelerometer shows specific force, not tilt: without drag it sees none of
    the tilt of a freely flying rotorcraft. Mahony, Hamel and Pflimlin (2008), Nonlinear complementary filters on the
    special orthogonal group, explicit form, as in the firmware's sensfusion6 without its integral term.
    """

    def __init__(self, kp: float, dt: float, arithmetic: Arithmetic) -> None:
        self._kp, self._dt, self._arithmetic = kp, dt, arithmetic
        self._q = 1.0, 0.0, 0.0, 0.0

    def update(self, gyro: tuple, accelerometer: tuple) -> tuple[Any, Any]:
        """Advance by body rates [rad/s] and specific force [m/s2]; return roll and pitch [rad]."""
        a, (qw, qx, qy, qz) = self._arithmetic, self._q
        (p, q, r), (ax, ay, az) = gyro, accelerometer
        vx, vy, vz = 2.0 * (qx * qz - qw * qy), 2.0 * (qw * qx + qy * qz), 1.0 - 2.0 * (qx * qx + qy * qy)
        gain = self._kp / a.sqrt(ax * ax + ay * ay + az * az)
        half = 0.5 * self._dt
        p = half * (p + gain * (ay * vz - az * vy))
        q = half * (q + gain * (az * vx - ax * vz))
        r = half * (r + gain * (ax * vy - ay * vx))
        qw, qx, qy, qz = (
            qw - qx * p - qy * q - qz * r,
            qx + qw * p + qy * r - qz * q,
            qy + qw * q - qx * r + qz * p,
            qz + qw * r + qx * q - qy * p,
        )
        size = 1.0 / a.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        self._q = qw, qx, qy, qz = qw * size, qx * size, qy * size, qz * size
        return roll_and_pitch(a, qw, qx, qy, qz, 1.0 - 2.0 * (qx * qx + qy * qy))


def roll_and_pitch(arithmetic: Arithmetic, qw: Any, qx: Any, qy: Any, qz: Any, cos_tilt: Any) -> tuple[Any, Any]:
    """Return the right-handed ZYX Euler angles roll and pitch [rad] of a unit quaternion and its 1 - 2 (qx^2 + qy^2)."""
    return arithmetic.atan2(2.0 * (qw * qx + qy * qz), cos_tilt), arithmetic.asin(2.0 * (qw * qy - qz * qx))
