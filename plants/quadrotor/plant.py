"""The quadrotor plant: plays a signal on the flight controller in MuJoCo and records everything."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from excite.errors import ExciteError
from excite.types.channel import Channel
from excite.types.loop import Loop
from excite.types.recording import Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from plants.arguments import resolve
from plants.plant import Injection, Layout, Plant, Task
from plants.quadrotor import truth as linear
from plants.quadrotor.airframe import build_model
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT
from plants.quadrotor.flight import LOGGED, MIN_ALTITUDE, Excitation, fly_many, fly_one
from plants.quadrotor.parameters import NOISE_SOURCES, PRESETS, SIGNS, hover_command, thrust_map

SET_POINTS = (Channel("roll_ref", "deg"), Channel("pitch_ref", "deg"), Channel("yaw_rate_ref", "deg/s"))
RATES_ADDED = tuple(Channel(f"{axis}_ref_added", "deg/s") for axis in "pqr")
MOTORS_ADDED = tuple(Channel(f"m{i}_added", "count") for i in (1, 2, 3, 4))
DERIVED = (Channel("thrust_roll", "N"), Channel("thrust_pitch", "N"), Channel("thrust_yaw", "N"))
YAW_RATE = Channel("yaw_rate", "deg/s")
TELEMETRY = 5  # rate steps in one step of the telemetry: 100 Hz, the fastest log of the real vehicle
MANY_SAMPLES = 2_000_000  # flown at once by run_many, which bounds the memory of noise and log
MANY = 12  # flights from which flying them at once is faster than one after the other
_M1, _R = 6, 12  # columns of LOGGED
_READ = "read every 4 ms, so the signal's dt is a multiple of 4 ms"


def _names(channels: tuple[Channel, ...]) -> tuple[str, ...]:
    return tuple(channel.name for channel in channels)


def _rates(reference: tuple[Channel, ...]) -> Roles:
    """Return the roles from commanded thrust differences to body rates, in closed loop."""
    return Roles(_names(DERIVED), ("p", "q", "r"), _names(reference), closed=True)


class Quadrotor(Plant):
    """A Crazyflie-class quadrotor near hover: MuJoCo rigid body, lagging motors, the firmware's cascaded PID.

    Axes x forward, y left, z up; roll, pitch, yaw are right-handed ZYX Euler angles, so positive pitch is nose down.

    Presets: "2013", that of Kee (2013): inertia and arm of crazyswarm2 at 27.5 g and the firmware gains of 2013. Its linearised
    closed loop has, from roll set-point to roll, poles at 27.5 rad/s (damping 0.27, a pair), 3.03 and 0.71 rad/s, and
    from yaw-rate set-point to yaw rate 10.5 rad/s (0.91, a pair) and 0.55 rad/s. "today": gains of the present firmware,
    34 g. "outdoors": today's, with a battery that sags, rotor drag, gusts, sensor biases, and the attitude estimated by
    Mahony's filter; the others measure the attitude directly.

    Row k of a recording holds the measurements y(k) taken at t_k = k 2 ms and the commands u(k) computed from them,
    which act over [t_k, t_k+1): there is no feed-through. thrust_roll, thrust_pitch and thrust_yaw are the signed
    sums of the four commanded thrusts f(m_i) [N], so that the path from them to the body rates is linear:

        roll = -f1 - f2 + f3 + f4,   pitch = -f1 + f2 + f3 - f4,   yaw = -f1 + f2 - f3 + f4

    f is the thrust map of the fresh battery; a sagging one gives less. Position, quaternion and altitude are true.

    Views: "rates", thrust differences to body rates, in closed loop, at every injection; "attitude", set-points to
    roll, pitch and yaw rate every 4 ms, and "telemetry", the same as the vehicle's 100 Hz log has it; "rate_response" and
    "motor_response", what is added to rate set-points or motor commands to body rates, every 4 ms, the loops closed.

    Noise: "thrust" is added to each motor's commanded thrust before the lag, every 2 ms; "gyro" and "accelerometer" to
    their sensors, with a bias of each flight's own; "attitude" to roll and pitch, all as both the controller and the
    recording see them; "gust" is horizontal wind.

    A flight starts in hover, or with parameter `takeoff` on the ground: then the signal, preceded by zeros, begins at
    `start_s` of the recording's origin. A loop that is not internally stable is not flown; a flight that
    tilts, spins or sinks too far stops with SimulationStopped.
    """

    name = "quadrotor"
    description = "Crazyflie-class quadrotor near hover: MuJoCo rigid body, motor lag, cascaded PID of the firmware"
    dt = RATE_DT
    outputs = (*LOGGED, *DERIVED, YAW_RATE)
    injections: Mapping[str, Injection] = {
        "attitude_setpoint": Injection(
            SET_POINTS,
            ((-30.0, 30.0), (-30.0, 30.0), (-200.0, 200.0)),
            {
                "rates": _rates(SET_POINTS),
                "attitude": Roles(_names(SET_POINTS), ("roll", "pitch", "yaw_rate"), every=FRAME),
                "telemetry": Roles(_names(SET_POINTS), ("roll", "pitch", "yaw_rate"), every=TELEMETRY),
            },
            f"set-points of the attitude and yaw-rate loops, {_READ}; limits are an assumption (usual settings of pilots' "
            "clients)",
        ),
        "rate_setpoint": Injection(
            RATES_ADDED,
            ((-200.0, 200.0),) * 3,
            {"rates": _rates(RATES_ADDED), "rate_response": Roles(_names(RATES_ADDED), ("p", "q", "r"), every=FRAME)},
            f"added to the set-points of the rate loops while the attitude loops hold level; {_READ}; limits are an assumption",
        ),
        "motor_command": Injection(
            MOTORS_ADDED,
            ((-20000.0, 20000.0),) * 4,
            {
                "rates": _rates(MOTORS_ADDED),
                "motor_response": Roles(_names(MOTORS_ADDED), ("p", "q", "r"), every=FRAME),
            },
            f"added to the four motor commands while all loops hold level; {_READ}; limits are an assumption (about what hover "
            "leaves)",
        ),
    }

    def __init__(self, preset: str = "2013", parameters: Mapping[str, float] | None = None) -> None:
        self.preset = preset
        self.parameters = resolve(self.name, PRESETS, preset, parameters or {})
        self.noise_sources = NOISE_SOURCES[preset]
        hover_command(self.values)
        if self.values["hover_altitude"] <= MIN_ALTITUDE:
            raise ExciteError(
                f"quadrotor parameter 'hover_altitude': {self.values['hover_altitude']:g} m; a flight below {MIN_ALTITUDE:g} "
                "m is stopped, so give more"
            )
        self.model = build_model(self.values)

    def records(self, inject: str | None = None) -> Layout:
        """What is played, the log of the flight, thrust differences and yaw rate."""
        inject = self._place(inject)
        place = self.injections[inject]
        loop = Loop("closed", entry="plant input" if inject == "motor_command" else "set-point")
        return Layout((*place.channels, *self.outputs), self.dt, place.views, "rates", loop)

    def derive_truth(self, view: str, levels: Mapping[str, float]) -> Truth:
        """Return the small-signal model of a view."""
        known = {c.name: c for c in (*SET_POINTS, *RATES_ADDED, *MOTORS_ADDED, *self.outputs)}
        roles = self.views[view]
        channels = ([known[name] for name in names] for names in (roles.inputs, roles.outputs))
        return linear.truth(view, self.values, levels, *channels)

    def prepare(self, signal: Signal, inject: str | None = None, noise: bool | Mapping[str, float] = True) -> Task:
        """Refuse also wind that would not act, and loops that are not internally stable."""
        task = super().prepare(signal, inject, noise)
        if task.levels["gust"] and not self.values["drag"]:
            raise ExciteError(
                f"quadrotor noise 'gust': {task.levels['gust']:g} m/s; wind acts through the drag, and parameter drag is 0; "
                "give it a value (0.0056 N s/m is a Crazyflie's), or use preset 'outdoors'"
            )
        linear.check_stability(self.values)
        return task

    def hold(self, signal: Signal) -> int:
        """Return the steps of the rate loop in one of the signal's samples; the attitude loop reads every second."""
        why = "the interval at which the attitude loop reads its set-points"
        return FRAME * self.whole_multiple(signal, ATTITUDE_DT, why)

    def start_s(self, task: Task) -> float:
        """Return when the excitation begins: after the take-off, if there is one."""
        return self._takeoff(task) * self.dt

    def simulate(self, task: Task, seeds: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield the values of each flight, many flown at a time; an unsafe one stops them all and is named by its seed."""
        wait = self._takeoff(task)
        u = np.vstack([np.zeros((wait, task.signal.u.shape[1])), task.u])
        played = Excitation(task.inject, u, wait)
        at_once = max(1, MANY_SAMPLES // len(u))
        for first in range(0, len(seeds), at_once):
            some = seeds[first : first + at_once]
            if len(some) < MANY:
                for seed in some:
                    yield self._shown(u, fly_one(self.model, self.values, played, task.levels, seed))
            else:
                for log in fly_many(self.model, self.values, played, task.levels, some):
                    yield self._shown(u, log)

    def _takeoff(self, task: Task) -> int:
        """Return the steps of the take-off, whole samples of the signal."""
        return math.ceil(self.values["takeoff"] / task.signal.dt - 1e-9) * task.hold

    def _shown(self, u: np.ndarray, log: np.ndarray) -> np.ndarray:
        """Return what is recorded of a flight: what was played, its log, and what follows from that."""
        forces = thrust_map(self.values).thrust(log[:, _M1 : _M1 + 4])
        return np.hstack([u, log, forces @ SIGNS.T, np.degrees(log[:, _R : _R + 1])])
