"""The air: gusts, and the drag by which air that moves past the vehicle pushes and tilts it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from plants.quadrotor.controller import RATE_DT


def gust_pole(values: Mapping[str, float]) -> float:
    """Return the pole of the wind's first-order model at the rate loop's step."""
    return math.exp(-RATE_DT / values["gust_tau"])


def wind(values: Mapping[str, float], white: np.ndarray) -> np.ndarray:
    """Return the horizontal wind (N, 2) [m/s] from white noise of the wind's own standard deviation.

    Gauss-Markov, w(k+1) = a w(k) + sqrt(1 - a^2) n(k+1), stationary from the first sample: Dryden's longitudinal
    spectrum, with a time constant in place of length over airspeed, which hover does not have.
    """
    from scipy.signal import lfilter  # slow to import, and few flights have gusts

    pole = gust_pole(values)
    drive = white.copy()
    drive[1:] *= math.sqrt(1.0 - pole * pole)
    return lfilter([1.0], [1.0, -pole], drive, axis=0)


class Drag:
    """Rotor drag: linear in the air's velocity in the rotors' plane, which lies `drag_height` above the centre of mass.

    In body axes F = -d (vx, vy, 0), v = R^T (velocity - wind); moment = height e_z x F.
    """

    def __init__(self, values: Mapping[str, float]) -> None:
        self._drag, self._height, self._mass = values["drag"], values["drag_height"], values["mass"]

    def act(self, velocity: tuple, air: tuple, attitude: tuple, force: np.ndarray) -> tuple[Any, Any]:
        """Write MuJoCo's generalised force (force in world axes, moment in body axes); return specific force x, y [m/s2].

        velocity [m/s] and air (wind x, y [m/s]) in world axes; attitude is the quaternion.
        """
        (vx, vy, vz), (wx, wy), (qw, qx, qy, qz) = velocity, air, attitude
        vx, vy = vx - wx, vy - wy
        forward = 1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy + qw * qz), 2.0 * (qx * qz - qw * qy)
        left = 2.0 * (qx * qy - qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz + qw * qx)
        fx = -self._drag * (forward[0] * vx + forward[1] * vy + forward[2] * vz)
        fy = -self._drag * (left[0] * vx + left[1] * vy + left[2] * vz)
        force[0], force[1], force[2] = (fx * f + fy * l for f, l in zip(forward, left, strict=True))
        force[3], force[4] = -self._height * fy, self._height * fx
        return fx / self._mass, fy / self._mass
