"""The quadrotor plant: plays a signal on the flight controller's set-points in MuJoCo and records everything."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from excite.errors import ExciteError, SimulationStopped, did_you_mean
from excite.types.channel import Channel
from excite.types.recording import Loop, Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from plants.given import check_limits, held, injection_of, noise_levels, resolve, seed_of
from plants.noise import streams
from plants.plant import Injection, settings_of
from plants.quadrotor import truth as linear
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT, Controller, mix
from plants.quadrotor.parameters import (
    GRAVITY,
    NOISE_SOURCES,
    PRESETS,
    SIGNS,
    hover_command,
    thrust_map,
)

HOVER_ALTITUDE = 10.0  # m
MIN_ALTITUDE = 0.1  # m, the ground is at 0
MAX_TILT_DEG = 60.0
MAX_RATE = math.radians(2000.0)  # rad/s, full scale of the usual MEMS gyroscopes

SET_POINTS = (Channel("roll_ref", "deg"), Channel("pitch_ref", "deg"), Channel("yaw_rate_ref", "deg/s"))
LOGGED = tuple(
    Channel.parse(text)
    for text in (
        "thrust_ref [count]", "p_ref [deg/s]", "q_ref [deg/s]",
        "control_roll [count]", "control_pitch [count]", "control_yaw [count]",
        "m1 [count]", "m2 [count]", "m3 [count]", "m4 [count]",
        "p [rad/s]", "q [rad/s]", "r [rad/s]", "roll [deg]", "pitch [deg]", "altitude [m]",
    )
)  # fmt: skip
DERIVED = (Channel("thrust_roll", "N"), Channel("thrust_pitch", "N"), Channel("thrust_yaw", "N"))
YAW_RATE = Channel("yaw_rate", "deg/s")
_M1, _R = 6, 12  # columns of LOGGED


class Quadrotor:
    """A Crazyflie-class quadrotor near hover: MuJoCo rigid body, lagging motors, the firmware's cascaded PID.

    Axes x forward, y left, z up; roll, pitch, yaw are right-handed ZYX Euler angles, so positive pitch is nose down.

    The default preset "2013" has the inertia and arm of crazyswarm2 at 27.5 g and the firmware gains of 2013. Its
    linearised closed loop has, from roll set-point to roll, poles at 27.5 rad/s (damping 0.27, a pair), 3.03 and
    0.71 rad/s, and from yaw-rate set-point to yaw rate 10.5 rad/s (0.91, a pair) and 0.55 rad/s.

    Row k of a recording holds the measurements y(k) taken at t_k = k 2 ms and the commands u(k) computed from them,
    which act over [t_k, t_k+1): there is no feed-through. thrust_roll, thrust_pitch and thrust_yaw are the signed
    sums of the four commanded thrusts f(m_i) [N], so that the path from them to the body rates is linear:

        roll = -f1 - f2 + f3 + f4,   pitch = -f1 + f2 + f3 - f4,   yaw = -f1 + f2 - f3 + f4

    Noise: "thrust" is added to each motor's commanded thrust before the lag, every 2 ms; "gyro" to each body rate and
    "attitude" to roll and pitch, as both the controller and the recording see them. Altitude is recorded as it is.

    A flight that tilts, spins or sinks too far stops with SimulationStopped.
    """

    name = "quadrotor"
    description = "Crazyflie-class quadrotor near hover: MuJoCo rigid body, motor lag, cascaded PID of the firmware"
    dt = RATE_DT
    injections: Mapping[str, Injection] = {
        "attitude_setpoint": Injection(
            SET_POINTS,
            ((-30.0, 30.0), (-30.0, 30.0), (-200.0, 200.0)),
            {
                "rates": Roles(
                    tuple(c.name for c in DERIVED), ("p", "q", "r"), tuple(c.name for c in SET_POINTS), closed=True
                ),
                "attitude": Roles(tuple(c.name for c in SET_POINTS), ("roll", "pitch", "yaw_rate"), every=FRAME),
            },
            "set-points of the attitude and yaw-rate loops, read every 4 ms, so the signal's dt is a multiple of 4 ms; "
            "limits are an assumption (usual settings of pilots' clients)",
        )
    }
    noise_sources = NOISE_SOURCES

    def __init__(self, preset: str = "2013", parameters: Mapping[str, float] | None = None) -> None:
        self.preset = preset
        self.parameters = resolve(self.name, PRESETS, preset, parameters or {})
        self.values = {name: parameter.value for name, parameter in self.parameters.items()}
        hover_command(self.values)  # refuses what cannot hover
        self.model = build_model(self.values)

    def truth(self, recording: Recording | None, setting: str) -> Truth:
        """Return the small-signal model of a setting, with the parameters and noise levels of `recording`.

        Without a recording, this plant's parameters and the default noise levels are used.
        """
        settings = settings_of(self)
        if setting not in settings:
            raise ExciteError(f"quadrotor setting '{setting}' does not exist; {did_you_mean(setting, settings)}")
        source = {} if recording is None else recording.source
        if recording is not None and source.get("plant") != self.name:
            raise ExciteError(f"quadrotor truth: the recording is of {source.get('plant')!r}; pass one of this plant")
        values = source.get("parameters", self.values)
        roles, units = settings[setting], {c.name: c for c in (*SET_POINTS, *LOGGED, *DERIVED, YAW_RATE)}
        channels = ([units[name] for name in names] for names in (roles.inputs, roles.outputs))
        return linear.truth(setting, values, source.get("noise", noise_levels(self.name, NOISE_SOURCES, True)), *channels)

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play `signal` with zero-order hold from hover at 10 m and record every 2 ms."""
        inject, seed = injection_of(self.name, self.injections, inject), seed_of(self.name, seed)
        hold = FRAME * held(self.name, signal, ATTITUDE_DT, "the interval at which the attitude loop reads its set-points")
        check_limits(self.name, signal, self.injections[inject])
        levels = noise_levels(self.name, NOISE_SOURCES, noise)
        set_points = np.repeat(signal.u, hold, axis=0)
        logged = np.array(self._fly(set_points, _noise(levels, seed, len(set_points))))
        forces = thrust_map(self.values).thrust(logged[:, _M1 : _M1 + 4])
        yaw_rate = np.degrees(logged[:, _R : _R + 1])
        return Recording(
            time_s=np.arange(len(logged)) * self.dt,
            values=np.hstack([set_points, logged, forces @ SIGNS.T, yaw_rate]),
            channels=(*SET_POINTS, *LOGGED, *DERIVED, YAW_RATE),
            dt=self.dt,
            settings=self.injections[inject].settings,
            default="rates",
            period=None if signal.period is None else int(signal.period) * hold,
            loop=Loop(closed=True, entry="set-point"),
            source={
                "plant": self.name,
                "preset": self.preset,
                "parameters": dict(self.values),
                "inject": inject,
                "noise": levels,
                "seed": seed,
            },
        )

    def run_many(
        self,
        signal: Signal,
        *,
        seeds: Sequence[int],
        inject: str | None = None,
        noise: bool | Mapping[str, float] = True,
    ) -> list[Recording]:
        """Play `signal` once a seed."""
        return [self.run(signal, inject=inject, noise=noise, seed=seed) for seed in seeds]

    def _fly(self, set_points: np.ndarray, noise: tuple[list, list, list]) -> list[tuple[float, ...]]:
        """Return one row of LOGGED a step; set_points (N, 3), noise rows a step: thrust (4), gyro (3), attitude (2)."""
        model, data = self.model, mujoco.MjData(self.model)
        data.act[:] = self.values["mass"] * GRAVITY / 4.0
        controller = Controller(self.values, HOVER_ALTITUDE)
        attitude, rate, collective = controller.attitude, controller.rate, controller.collective
        thrust, step = thrust_map(self.values).thrust, mujoco.mj_step
        qpos, qvel, ctrl = data.qpos, data.qvel, data.ctrl
        degrees, min_cos_tilt = math.degrees, math.cos(math.radians(MAX_TILT_DEG))
        p_ref = q_ref = 0.0
        log = []
        for k, (reference, w, gyro, angle) in enumerate(zip(set_points.tolist(), *noise, strict=True)):
            _, _, z, qw, qx, qy, qz = qpos.tolist()
            _, _, climb, p, q, r = qvel.tolist()
            cos_tilt = 1.0 - 2.0 * (qx * qx + qy * qy)
            fast = max(abs(p), abs(q), abs(r))
            if not (cos_tilt > min_cos_tilt and z > MIN_ALTITUDE and fast < MAX_RATE):
                raise _stopped(k * RATE_DT, cos_tilt, z, fast)
            roll = degrees(math.atan2(2.0 * (qw * qx + qy * qz), cos_tilt)) + angle[0]
            pitch = degrees(math.asin(2.0 * (qw * qy - qz * qx))) + angle[1]
            p, q, r = p + gyro[0], q + gyro[1], r + gyro[2]
            if k % FRAME == 0:
                p_ref, q_ref = attitude(reference[0] - roll, reference[1] - pitch)
            commands = rate(p_ref - degrees(p), q_ref - degrees(q), reference[2] - degrees(r))
            base = collective(z, climb, cos_tilt)
            m1, m2, m3, m4 = motors = mix(base, *commands)
            ctrl[0], ctrl[1] = thrust(m1) + w[0], thrust(m2) + w[1]
            ctrl[2], ctrl[3] = thrust(m3) + w[2], thrust(m4) + w[3]
            log.append((base, p_ref, q_ref, *commands, *motors, p, q, r, roll, pitch, z))
            step(model, data)
        return log


def build_model(values: Mapping[str, float]) -> mujoco.MjModel:
    """Return the MuJoCo model with mass, inertia, arm, motor lag and reaction torque set from parameter values."""
    spec = mujoco.MjSpec.from_string(Path(__file__).with_name("model.xml").read_text(encoding="utf-8"))
    body = spec.body("quadrotor")
    body.mass = values["mass"]
    body.inertia = [values["ixx"], values["iyy"], values["izz"]]
    lever = values["arm"] / math.sqrt(2.0)
    for motor, (roll, pitch, yaw) in zip(spec.actuators, SIGNS.T, strict=True):
        spec.site(motor.name).pos = [-pitch * lever, roll * lever, 0.0]
        motor.dynprm[0] = values["motor_tau"]
        motor.gear = [0.0, 0.0, 1.0, 0.0, 0.0, yaw * values["torque_per_thrust"]]
    try:
        return spec.compile()
    except ValueError as error:
        raise ExciteError(f"quadrotor parameters: MuJoCo refuses them ({str(error).splitlines()[0]})") from error


def _noise(levels: Mapping[str, float], seed: int, count: int) -> tuple[list, list, list]:
    """Return thrust (N, 4), gyro (N, 3) and attitude (N, 2) noise as lists."""
    return tuple(each.tolist() for each in streams(levels, {"thrust": 4, "gyro": 3, "attitude": 2}, seed, count).values())


def _stopped(time_s: float, cos_tilt: float, altitude: float, rate: float) -> SimulationStopped:
    tilt = math.degrees(math.acos(max(-1.0, min(1.0, cos_tilt)))) if math.isfinite(cos_tilt) else math.nan
    if not altitude > MIN_ALTITUDE:
        what = f"altitude {altitude:.2f} m is below {MIN_ALTITUDE:g} m"
    elif not tilt < MAX_TILT_DEG:
        what = f"tilt {tilt:.1f} deg exceeds {MAX_TILT_DEG:g} deg"
    else:
        what = f"body rate {math.degrees(rate):.3g} deg/s exceeds {math.degrees(MAX_RATE):g} deg/s"
    return SimulationStopped(
        f"quadrotor: stopped at {time_s:.3f} s: {what}; reduce the excitation's amplitude, or check the parameters"
    )
