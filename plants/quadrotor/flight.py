"""One flight, or many at once: the controller and what surrounds it, around MuJoCo's rigid body, step by step."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import Any

import mujoco
import mujoco.batch
import numpy as np

from excite.errors import SimulationStopped
from excite.types.channel import Channel
from plants.noise import draw
from plants.quadrotor.air import wind
from plants.quadrotor.arithmetic import ARRAYS, FLOATS, Arithmetic
from plants.quadrotor.controller import RATE_DT, Controller
from plants.quadrotor.onboard import Motors, Sensors
from plants.quadrotor.parameters import GRAVITY, NOISE_CHANNELS

MIN_ALTITUDE = 0.1  # m, the ground is at 0
MAX_TILT_DEG = 60.0
MAX_RATE = math.radians(2000.0)  # rad/s, full scale of the usual MEMS gyroscopes
AT_REST = 0.008  # m, altitude on the ground: half the body's height in model.xml
ENTRIES = {"attitude_setpoint": 3, "rate_setpoint": 3, "motor_command": 4}  # places of entry and their channels

LOGGED = tuple(
    Channel.parse(text)
    for text in (
        "thrust_ref [count]",
        "p_ref [deg/s]",
        "q_ref [deg/s]",
        "control_roll [count]",
        "control_pitch [count]",
        "control_yaw [count]",
        "m1 [count]",
        "m2 [count]",
        "m3 [count]",
        "m4 [count]",
        "p [rad/s]",
        "q [rad/s]",
        "r [rad/s]",
        "roll [deg]",
        "pitch [deg]",
        "altitude [m]",
        "x [m]",
        "y [m]",
        "qw [1]",
        "qx [1]",
        "qy [1]",
        "qz [1]",
        "acc_x [m/s2]",
        "acc_y [m/s2]",
        "acc_z [m/s2]",
        "voltage [V]",
    )
)


@dataclass(frozen=True, eq=False)
class Excitation:
    """What is played at one of the ENTRIES, u (N, channels) step by step; takeoff : steps of it that pass on the way up."""

    inject: str
    u: np.ndarray
    takeoff: int = 0

    def rows(self) -> Iterator[Iterator]:
        """Rows of attitude set-points [deg, deg, deg/s], additions to rate set-points [deg/s] and to motors [16-bit units]."""
        return (iter(self.u.tolist()) if name == self.inject else repeat((0.0,) * n) for name, n in ENTRIES.items())


@dataclass(frozen=True, eq=False)
class Body:
    """MuJoCo's present state, live: (quantities,) of one flight or (quantities, flights) of many.

    read : a copy to compute with, floats or rows over flights; step : move all on by 2 ms.
    """

    position: np.ndarray
    velocity: np.ndarray
    thrust: np.ndarray
    command: np.ndarray
    force: np.ndarray
    read: Callable[[np.ndarray], Any]
    step: Callable[[], Any]
    arithmetic: Arithmetic

    @classmethod
    def one(cls, model: mujoco.MjModel) -> "Body":
        """Return a body whose quantities are floats."""
        data = mujoco.MjData(model)
        views = data.qpos, data.qvel, data.act, data.ctrl, data.qfrc_applied
        return cls(*views, np.ndarray.tolist, partial(mujoco.mj_step, model, data), FLOATS)

    @classmethod
    def many(cls, model: mujoco.MjModel, flights: int) -> "Body":
        """Return a body whose quantities are arrays over flights, stepped on one core."""
        batch = mujoco.batch.Batch(model, flights, nthread=1)
        qpos, qvel, act, ctrl, applied = (batch.bind(n).T for n in ("qpos", "qvel", "act", "ctrl", "qfrc_applied"))
        return cls(qpos, qvel, act, ctrl, applied, np.ndarray.copy, batch.step, ARRAYS)


def fly_one(
    model: mujoco.MjModel, values: Mapping[str, float], played: Excitation, levels: Mapping[str, float], seed: int
) -> np.ndarray:
    """Return the log (N, channels) of one flight."""
    noise = {name: each.tolist() for name, each in _noise(values, levels, seed, len(played.u)).items()}
    log: list[Sequence[float]] = []
    _fly(Body.one(model), values, played, noise, [seed], log.append)
    return np.array(log)


def fly_many(
    model: mujoco.MjModel,
    values: Mapping[str, float],
    played: Excitation,
    levels: Mapping[str, float],
    seeds: Sequence[int],
) -> np.ndarray:
    """Return the logs (flights, N, channels) of flights that differ in their noise."""
    each = [_noise(values, levels, seed, len(played.u)) for seed in seeds]
    noise = {name: np.stack([flight[name] for flight in each], axis=2) for name in each[0]}
    log = np.empty((len(played.u), len(LOGGED), len(seeds)))
    rows = iter(log)

    def record(quantities: tuple) -> None:
        row = next(rows)
        for i, quantity in enumerate(quantities):
            row[i] = quantity

    _fly(Body.many(model, len(seeds)), values, played, noise, seeds, record)
    return log.transpose(2, 0, 1)


def _noise(values: Mapping[str, float], levels: Mapping[str, float], seed: int, count: int) -> dict[str, np.ndarray]:
    """Return what disturbs each step, (count, width) per sensor or actuator; what is silent is left out."""
    drawn = {name: levels[name] * each for name, each in draw(NOISE_CHANNELS, levels, seed, count).items()}
    loud = {name: drawn[name] for name in ("thrust", "gyro", "attitude", "accelerometer") if levels[name]}
    for name in ("gyro", "accelerometer"):
        if levels[f"{name}_bias"]:
            loud[name] = drawn[name] + drawn[f"{name}_bias"][0]
    if levels["gust"]:
        loud["gust"] = wind(values, drawn["gust"])
    return loud


def _fly(
    body: Body,
    values: Mapping[str, float],
    played: Excitation,
    noise: Mapping[str, Sequence | np.ndarray],
    seeds: Sequence[int],
    record: Callable[[tuple], Any],
) -> None:
    """Fly from hover, or from the ground; `record` takes one row of LOGGED a step.

    Everything is read, computed and written at t_k; then MuJoCo moves on by 2 ms.
    """
    arithmetic, read, step = body.arithmetic, body.read, body.step
    body.position[2], body.thrust[:] = values["hover_altitude"], values["mass"] * GRAVITY / 4.0
    if played.takeoff:
        body.position[2], body.thrust[:] = AT_REST, 0.0
    controller = Controller(values, arithmetic)
    sense, command = Sensors(values, arithmetic, body.force).read, controller.step
    drive = Motors(values, arithmetic, body.command).drive
    min_cos_tilt, max_spin = math.cos(math.radians(MAX_TILT_DEG)), MAX_RATE * MAX_RATE
    disturbances = (
        noise.get(name, repeat((0.0,) * width)) for name, width in NOISE_CHANNELS.items() if not name.endswith("_bias")
    )
    everything = zip(
        range(len(played.u)), *played.rows(), _altitudes(values, played.takeoff), *disturbances, strict=False
    )
    for k, set_point, rates_added, motors_added, aim, push, gyro, angles, shake, air in everything:
        x, y, z, qw, qx, qy, qz = read(body.position)
        vx, vy, climb, p, q, r = read(body.velocity)
        altitude_ref, climb_ref, lowest = aim
        cos_tilt = 1.0 - 2.0 * (qx * qx + qy * qy)
        spin = p * p + q * q + r * r
        safe = (cos_tilt > min_cos_tilt) & (z > lowest) & (spin < max_spin)
        if not arithmetic.all(safe):
            raise _stopped(k, safe, seeds, cos_tilt, z, spin, lowest)
        p, q, r = rates = p + gyro[0], q + gyro[1], r + gyro[2]
        roll, pitch, ax, ay, az = sense(k, (qw, qx, qy, qz), (vx, vy, climb), cos_tilt, rates, angles, shake, air)
        base = controller.collective(altitude_ref - z, climb_ref - climb, cos_tilt)
        commanded = command(k, base, rates, roll, pitch, set_point, rates_added, motors_added)
        voltage = drive(commanded, push)
        record((base, *commanded, p, q, r, roll, pitch, z, x, y, qw, qx, qy, qz, ax, ay, az, voltage))
        step()


def _altitudes(values: Mapping[str, float], takeoff: int) -> Iterator[tuple[float, float, float]]:
    """Yield the set-points of altitude [m] and climb rate [m/s] and the least safe altitude of every step, endlessly.

    A take-off climbs over its first half along the path of least jerk, z = H s^3 (10 - 15 s + 6 s^2).
    """
    height, half = values["hover_altitude"], takeoff // 2
    for k in range(takeoff):
        s = min(k / max(half, 1), 1.0)
        speed = height * 30.0 * s * s * (1.0 - s) ** 2 / (max(half, 1) * RATE_DT)
        yield height * s**3 * (10.0 - 15.0 * s + 6.0 * s * s), speed, -math.inf
    yield from repeat((height, 0.0, MIN_ALTITUDE))


def _stopped(
    k: int, safe: Any, seeds: Sequence[int], cos_tilt: Any, altitude: Any, spin: Any, lowest: float
) -> SimulationStopped:
    """Say which flight is not safe, the first if several are, and why."""
    i = int(np.argmin(np.atleast_1d(safe)))
    cos_tilt, altitude, rate = (float(np.atleast_1d(each)[i]) for each in (cos_tilt, altitude, spin))
    tilt = math.degrees(math.acos(max(-1.0, min(1.0, cos_tilt)))) if math.isfinite(cos_tilt) else math.nan
    if not altitude > lowest:
        what = f"altitude {altitude:.4g} m is below {MIN_ALTITUDE:g} m"
    elif not tilt < MAX_TILT_DEG:
        what = f"tilt {tilt:.1f} deg exceeds {MAX_TILT_DEG:g} deg"
    else:
        what = f"body rate {math.degrees(math.sqrt(rate)):.3g} deg/s exceeds {math.degrees(MAX_RATE):g} deg/s"
    return SimulationStopped(
        f"quadrotor, seed {seeds[i]}: stopped at {k * RATE_DT:.3f} s: {what}; reduce the excitation's amplitude, or check "
        "the parameters"
    )
