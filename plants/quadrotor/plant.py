"""The quadrotor plant: plays a signal on the flight controller in MuJoCo and records everything."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import Channel
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from plants.arguments import check_limits, held, injection_of, noise_levels, resolve, seed_of
from plants.plant import Injection, views_of
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


class Quadrotor:
    """A Crazyflie-class quadrotor near hover: MuJoCo rigid body, lagging motors, the firmware's cascaded PID.

    Axes x forward, y left, z up; roll, pitch, yaw are right-handed ZYX Euler angles, so positive pitch is nose down.

    Presets: "2013", the seed's: inertia and arm of crazyswarm2 at 27.5 g and the firmware gains of 2013. Its linearised
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
        self.values = {name: parameter.value for name, parameter in self.parameters.items()}
        hover_command(self.values)
        if self.values["hover_altitude"] <= MIN_ALTITUDE:
            raise ExciteError(
                f"quadrotor parameter 'hover_altitude': {self.values['hover_altitude']:g} m; a flight below {MIN_ALTITUDE:g} "
                "m is stopped, so give more"
            )
        self.model = build_model(self.values)

    def truth(self, recording: Recording | None, view: str) -> Truth:
        """Return the small-signal model of a view, with the parameters and noise levels of `recording`.

        Without a recording, this plant's parameters and the default noise levels are used.
        """
        views = views_of(self)
        if view not in views:
            raise ExciteError(f"quadrotor view '{view}' does not exist; {did_you_mean(view, views)}")
        origin = None if recording is None else recording.origin
        if origin is not None and origin.plant != self.name:
            raise ExciteError(f"quadrotor truth: the recording is of {origin.plant!r}; pass one of this plant")
        values = self.values if origin is None else origin.parameters
        levels = noise_levels(self.name, self.noise_sources, True) if origin is None else origin.noise
        known = (*SET_POINTS, *RATES_ADDED, *MOTORS_ADDED, *LOGGED, *DERIVED, YAW_RATE)
        roles, units = views[view], {c.name: c for c in known}
        channels = ([units[name] for name in names] for names in (roles.inputs, roles.outputs))
        return linear.truth(view, values, levels, *channels)

    def floor(self, recording: Recording, view: str) -> dict[str, float]:
        """Return the linearisation floor of an experiment: fit [%] of the truth's simulation to its noise-free twin.

        The twin is flown anew; both start from trim at the start of the excitation. No linear model can be expected to do
        much better.
        """
        origin = recording.origin
        names = _names(self.injections[origin.inject].channels)
        first = round(origin.start_s / self.dt)
        signal = Signal(recording.columns(names)[first::FRAME], ATTITUDE_DT)
        plant = Quadrotor(origin.preset, origin.parameters)
        twin = plant.run(signal, inject=origin.inject, noise=False).experiment(view)
        twin = twin.window(int(np.searchsorted(twin.time_s, origin.start_s - self.dt / 2)))
        error = twin.y - plant.truth(recording, view).model.simulate(twin.u)
        size = np.linalg.norm(twin.y - twin.y.mean(0), axis=0)
        fits = 100.0 * (1.0 - np.linalg.norm(error, axis=0) / np.where(size > 0, size, np.nan))
        return {channel.name: float(fit) for channel, fit in zip(twin.outputs, fits, strict=True)}

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play `signal` with zero-order hold and record every 2 ms."""
        played, levels, (seed,) = self._prepare(signal, inject, noise, [seed])
        log = fly_one(self.model, self.values, played, levels, seed)
        return self._recording(signal, played, levels, seed, log)

    def run_many(
        self,
        signal: Signal,
        *,
        seeds: Sequence[int],
        inject: str | None = None,
        noise: bool | Mapping[str, float] = True,
    ) -> list[Recording]:
        """Play `signal` once a seed, many flights at a time; one that is unsafe stops them all and is named by its seed."""
        played, levels, seeds = self._prepare(signal, inject, noise, seeds)
        at_once = max(1, MANY_SAMPLES // len(played.u))
        recordings = []
        for start in range(0, len(seeds), at_once):
            some = seeds[start : start + at_once]
            if len(some) < MANY:
                logs = [fly_one(self.model, self.values, played, levels, seed) for seed in some]
            else:
                logs = fly_many(self.model, self.values, played, levels, some)
            recordings += [self._recording(signal, played, levels, *each) for each in zip(some, logs, strict=True)]
        return recordings

    def _prepare(
        self, signal: Signal, inject: str | None, noise: bool | Mapping[str, float], seeds: Sequence[int]
    ) -> tuple[Excitation, dict[str, float], list[int]]:
        """Check what is asked for, and return what is played, noise levels and seeds."""
        inject = injection_of(self.name, self.injections, inject)
        seeds = [seed_of(self.name, seed) for seed in seeds]
        hold = FRAME * held(
            self.name, signal, ATTITUDE_DT, "the interval at which the attitude loop reads its set-points"
        )
        check_limits(self.name, signal, self.injections[inject])
        levels = noise_levels(self.name, self.noise_sources, noise)
        if levels["gust"] and not self.values["drag"]:
            raise ExciteError(
                f"quadrotor noise 'gust': {levels['gust']:g} m/s; wind acts through the drag, and parameter drag is 0; give it "
                "a value (0.0056 N s/m is a Crazyflie's), or use preset 'outdoors'"
            )
        linear.check_stability(self.values)
        wait = math.ceil(self.values["takeoff"] / signal.dt - 1e-9) * hold
        u = np.vstack([np.zeros((wait, signal.u.shape[1])), np.repeat(signal.u, hold, axis=0)])
        return Excitation(inject, u, wait), levels, seeds

    def _recording(
        self, signal: Signal, played: Excitation, levels: Mapping[str, float], seed: int, log: np.ndarray
    ) -> Recording:
        forces = thrust_map(self.values).thrust(log[:, _M1 : _M1 + 4])
        yaw_rate = np.degrees(log[:, _R : _R + 1])
        place = self.injections[played.inject]
        return Recording(
            time_s=np.arange(len(log)) * self.dt,
            values=np.hstack([played.u, log, forces @ SIGNS.T, yaw_rate]),
            channels=(*place.channels, *LOGGED, *DERIVED, YAW_RATE),
            dt=self.dt,
            views=place.views,
            default="rates",
            period=None if signal.period is None else int(signal.period) * round(signal.dt / self.dt),
            loop=Loop("closed", entry="plant input" if played.inject == "motor_command" else "set-point"),
            origin=Origin(
                self.name, self.preset, self.values, played.inject, levels, seed, start_s=played.takeoff * self.dt
            ),
            level="zero",
        )
