"""A trim of a MuJoCo model, and the model's linearisation there."""

from dataclasses import dataclass

import mujoco
import numpy as np

from excite.errors import ExciteError
from excite.numerics.simulate import observability
from plants.linear.loop import Dynamics

RESTS = 1e-3  # of every state's rate, in the model's units: an equilibrium given with six digits passes
EPSILON = 1e-6  # of the central differences
CONTROL = "control"


@dataclass(frozen=True, eq=False)
class Trim:
    """An equilibrium: name, qpos, ctrl, act and what the sensors read there; velocities are zero.

    full : whether the states are outputs too, behind the sensors.
    """

    name: str
    qpos: np.ndarray
    ctrl: np.ndarray
    act: np.ndarray
    sensors: np.ndarray
    full: bool

    def start(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Return data at the trim, with everything computed."""
        data = mujoco.MjData(model)
        data.qpos[:], data.ctrl[:], data.act[:] = self.qpos, self.ctrl, self.act
        mujoco.mj_forward(model, data)
        return data

    def states(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """Return deviations of positions (in the tangent space), velocities and activations, (2 nv + na,)."""
        positions = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, positions, 1.0, self.qpos, data.qpos)
        return np.concatenate([positions, data.qvel, data.act - self.act])

    def outputs(self, data: mujoco.MjData, states: np.ndarray) -> np.ndarray:
        """Return deviations of the sensors, and the states where they are outputs."""
        sensors = data.sensordata - self.sensors
        return np.concatenate([sensors, states]) if self.full else sensors


def find_trim(model: mujoco.MjModel, keyframe: str | None, full: bool) -> Trim:
    """Return the trim of a keyframe, or the model's initial state without control; refuse one that is no equilibrium."""
    data = mujoco.MjData(model)
    if keyframe is not None:
        known = [model.key(i).name for i in range(model.nkey)]
        if keyframe not in known:
            raise ExciteError(f"'keyframe': {keyframe!r} is none of the model's: {', '.join(known) or 'it has none'}")
        mujoco.mj_resetDataKeyframe(model, data, known.index(keyframe))
    name = "the initial state" if keyframe is None else f"keyframe {keyframe}"
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    trim = Trim(name, data.qpos.copy(), data.ctrl.copy(), data.act.copy(), data.sensordata.copy(), full)
    mujoco.mj_step(model, data)
    rates = trim.states(model, data) / model.opt.timestep
    worst = int(np.argmax(np.abs(rates)))
    if not abs(rates[worst]) < RESTS:
        raise ExciteError(
            f"'keyframe': {name} is no equilibrium: {state_names(model)[worst][0]} changes by {rates[worst]:.4g} a second; give "
            "a keyframe whose qpos, act and ctrl balance all forces"
        )
    return trim


def linearise(model: mujoco.MjModel, trim: Trim, steps: int) -> Dynamics:
    """Return the linearised dynamics over `steps` steps of held control, by mjd_transitionFD.

    Noise: CONTROL on the controls, and each sensor's own. Sensors of positions and velocities have no feedthrough, and
    what rounding leaves there is removed.
    """
    data = trim.start(model)
    n, nu, ns = 2 * model.nv + model.na, model.nu, model.nsensordata
    A, B, C, D = np.zeros((n, n)), np.zeros((n, nu)), np.zeros((ns, n)), np.zeros((ns, nu))
    mujoco.mjd_transitionFD(model, data, EPSILON, True, A, B, C, D)
    D[~direct(model)] = 0.0
    powers = observability(A, np.eye(n), steps)
    A, B = A @ powers[-1], powers.sum(0) @ B
    if trim.full:
        C, D = np.vstack([C, np.eye(n)]), np.vstack([D, np.zeros((n, nu))])
    G, H = np.hstack([B, np.zeros((n, ns))]), np.hstack([D, np.eye(len(C), ns)])
    sources = {CONTROL: nu} | {name: int(model.sensor_dim[i]) for i, name in enumerate(sensor_names(model))}
    return Dynamics(A, B, C, D, G, H, sources)


def direct(model: mujoco.MjModel) -> np.ndarray:
    """Return which sensor values depend on the control of the same instant: those of forces and accelerations."""
    return np.repeat(model.sensor_needstage == mujoco.mjtStage.mjSTAGE_ACC, model.sensor_dim)


def sensor_names(model: mujoco.MjModel) -> list[str]:
    """Return the sensors' names, or their numbers where they have none."""
    return [model.sensor(i).name or f"sensor_{i}" for i in range(model.nsensor)]


def state_names(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Return name and unit of every position, velocity and activation."""
    dofs = []
    for i in range(model.njnt):
        name, kind = model.joint(i).name or f"joint_{i}", model.jnt_type[i]
        units = {0: ["m"] * 3 + ["rad"] * 3, 1: ["rad"] * 3, 2: ["m"], 3: ["rad"]}[
            int(kind)
        ]  # free, ball, slide, hinge
        dofs += [(f"{name}_{j}" if len(units) > 1 else name, unit) for j, unit in enumerate(units)]
    positions = [(f"q_{name}", unit) for name, unit in dofs]
    velocities = [(f"v_{name}", f"{unit}/s") for name, unit in dofs]
    return [*positions, *velocities, *((f"act_{i}", "1") for i in range(model.na))]


_S = mujoco.mjtSensor
SENSOR_UNITS = {
    _S.mjSENS_ACCELEROMETER: "m/s2",
    _S.mjSENS_FRAMELINACC: "m/s2",
    _S.mjSENS_VELOCIMETER: "m/s",
    _S.mjSENS_FRAMELINVEL: "m/s",
    _S.mjSENS_SUBTREELINVEL: "m/s",
    _S.mjSENS_GYRO: "rad/s",
    _S.mjSENS_FRAMEANGVEL: "rad/s",
    _S.mjSENS_BALLANGVEL: "rad/s",
    _S.mjSENS_FRAMEANGACC: "rad/s2",
    _S.mjSENS_FRAMEPOS: "m",
    _S.mjSENS_SUBTREECOM: "m",
    _S.mjSENS_RANGEFINDER: "m",
    _S.mjSENS_TENDONPOS: "m",
    _S.mjSENS_TENDONVEL: "m/s",
    _S.mjSENS_FORCE: "N",
    _S.mjSENS_TOUCH: "N",
    _S.mjSENS_TORQUE: "N m",
}
JOINT_SENSORS = {_S.mjSENS_JOINTPOS: "", _S.mjSENS_JOINTVEL: "/s"}


def sensor_channels(model: mujoco.MjModel) -> list[str]:
    """Return a name with its unit for every sensor value; "1" where the unit depends on the model's meaning."""
    channels = []
    for i, name in enumerate(sensor_names(model)):
        kind, count = _S(int(model.sensor_type[i])), int(model.sensor_dim[i])
        unit = SENSOR_UNITS.get(kind, "1")
        if kind in JOINT_SENSORS:
            slides = model.jnt_type[model.sensor_objid[i]] == mujoco.mjtJoint.mjJNT_SLIDE
            unit = ("m" if slides else "rad") + JOINT_SENSORS[kind]
        ends = [""] if count == 1 else [f"_{axis}" for axis in "xyz"] if count == 3 else [f"_{j}" for j in range(count)]
        channels += [f"{name}{end} [{unit}]" for end in ends]
    return channels
