"""The mjcf plant: any MuJoCo model's actuators as inputs and sensors as outputs, about a trim, in open or closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from excite.arguments import multiple, number, text
from excite.errors import ExciteError, SimulationStopped, placed
from excite.models.state_space import StateSpaceModel
from excite.plain import plain
from excite.types.channel import Channel
from excite.types.checked import NOT_GIVEN
from excite.types.truth import Truth
from plants.arguments import NONE, Parameter, is_there, resolve
from plants.linear.actuator import Saturation
from plants.linear.described import channels_of, feedback_of, limits_of, matrix_of
from plants.linear.loop import DIVERGED, Dynamics, Feedback
from plants.linear.plant import LinearPlant
from plants.mjcf.loading import files_of, load_model
from plants.mjcf.truth import CONTROL, Trim, direct, find_trim, linearise, sensor_channels, sensor_names, state_names

EXAMPLE = Path(__file__).with_name("example.xml")
DESCRIPTION = "any MuJoCo model file: actuators to sensors about an equilibrium, open or closed by a controller"
NOTE = "inputs and outputs are deviations from the trim"
FASTEST = 1e6  # of any velocity, in the model's units: long before MuJoCo resets what it calls unstable

PRESETS: dict[str, dict[str, Parameter]] = {
    "example": {
        "file": Parameter(NONE, "path", "an MJCF file; none: a pole that hangs from a cart, an example of our own"),
        "keyframe": Parameter(
            NONE, "name", "the trim, an equilibrium; none: the model's initial state without control"
        ),
        "dt": Parameter(NONE, "s", "a multiple of the model's timestep; none: the timestep"),
        "controller": Parameter(NONE, "1", "as that of lti: {kp, ki, kd}, {num, den} or {A, B, C, D}; measured, sign"),
        "state_feedback": Parameter(
            NONE, "1", "rows K of u = r - K x, x: deviations of positions, velocities, activations"
        ),
        "inputs": Parameter(NONE, "1", "names with units; none: those of the actuators, without unit"),
        "outputs": Parameter(NONE, "1", "names with units; none: those of the sensors"),
        "limits": Parameter(
            [1.0], "of input", "assumption: for actuators without ctrlrange; one number, or one per actuator"
        ),
        "setpoint_limits": Parameter([1.0], "of output", "assumption: one number, or one per set-point"),
    }
}


@dataclass(frozen=True, eq=False)
class Mjcf(LinearPlant):
    """A MuJoCo model about its trim; `dynamics` is its linearisation there, which judges loops and gives the truth.

    Inputs and outputs are deviations from the trim: ctrl = ctrl_trim + u, y = sensors - sensors_trim. Row k holds the
    sensors of the instant t_k with the control that acts from then on. Sensors that a controller reads are those that
    do not depend on the control of the same instant; forces and accelerations do.
    """

    model: mujoco.MjModel = NOT_GIVEN  # always given; a default, because the fields before have some
    trim: Trim = NOT_GIVEN
    steps: int = 1

    @property
    def files(self) -> tuple[Path, ...]:
        """The model file, where one was given, and all that it names."""
        given = self.values["file"]
        return files_of(Path(given)) if is_there(given) else ()

    def derive_truth(self, view: str, levels: Mapping[str, float]) -> Truth:
        """Return the truth of a view, good for small motions."""
        truth = super().derive_truth(view, levels)
        valid = f"small motions about {self.trim.name}; the linearisation of MuJoCo's own step by central differences"
        return replace(truth, kind="linearised", valid_amplitude=valid)

    def _play(self, reference: np.ndarray, levels: Mapping[str, float], seeds: Sequence[int]) -> tuple[np.ndarray, ...]:
        sources = self.dynamics.sources
        noise = self._noise(levels, seeds, len(reference))
        noise *= np.repeat([levels[name] for name in sources], list(sources.values()))
        silent = len(self.inputs) + len(self.outputs) - noise.shape[2]  # states that are outputs
        noise = np.pad(noise, ((0, 0), (0, 0), (0, silent)))
        return tuple(np.array(each) for each in zip(*(self._simulate(reference, one) for one in noise), strict=True))

    def _simulate(self, reference: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return u, v and y of one run; noise (N, nu + ny) is added to controls and outputs."""
        model, trim, nu, N = self.model, self.trim, len(self.inputs), len(reference)
        data, feedback = trim.start(model), self.feedback
        c = feedback and feedback.controller
        xc = np.zeros(c.order if c else 0)
        u, v, y = np.empty((N, nu)), np.empty((N, nu)), np.empty((N, len(self.outputs)))
        memory = [element.start((nu,)) for element in self.actuator]
        for k in range(N):
            r1, r2, w_u, w_y = reference[k, :nu], reference[k, nu:], noise[k, :nu], noise[k, nu:]
            mujoco.mj_step1(model, data)  # positions and velocities, so that the control can follow from them
            states = trim.states(model, data)
            given = r1
            if feedback and c:
                seen = trim.outputs(data, states) + w_y
                given = r1 + c.C @ xc + c.D @ (r2 + feedback.sign * seen[list(feedback.measured)])
            u[k] = given
            for i, element in enumerate(self.actuator):
                given, memory[i] = element.advance(given, memory[i])
            v[k] = given
            data.ctrl[:] = trim.ctrl + given + w_u
            mujoco.mj_step2(model, data)  # forces and accelerations, and on to the next step
            y[k] = trim.outputs(data, states) + w_y
            if feedback and c:
                xc = c.A @ xc + c.B @ (r2 + feedback.sign * y[k][list(feedback.measured)])
            self._check(data, y[k], k)
            for _ in range(self.steps - 1):
                mujoco.mj_step(model, data)
                self._check(data, y[k], k)
        return u, v, y

    def _check(self, data: mujoco.MjData, y: np.ndarray, k: int) -> None:
        if np.abs(data.qvel).max() < FASTEST and np.abs(y).max() < DIVERGED:
            return
        raise SimulationStopped(
            f"{self.name}: the motion diverged at {k * self.dt:.3f} s; reduce the excitation's amplitude, change the controller, "
            "or give the model a smaller timestep"
        )


def mjcf(preset: str = "example", parameters: Mapping[str, Any] | None = None) -> Mjcf:
    """Return the plant of a model file."""
    given = plain(dict(parameters or {}), "mjcf", finite=False)
    if is_there(given.get("file")):
        file = text(given["file"], "mjcf parameter 'file'")
        given["file"] = str(Path(file).resolve())  # a recording must find it from any folder
    resolved = resolve("mjcf", PRESETS, preset, given)
    values = {name: parameter.value for name, parameter in resolved.items() if is_there(parameter.value)}
    with placed("mjcf parameter 'file'"):
        model = load_model(Path(values["file"])) if "file" in values else mujoco.MjModel.from_xml_path(str(EXAMPLE))
    try:
        fields = _fields(values, model)
    except ExciteError as error:
        raise ExciteError(f"mjcf parameter {error}") from None
    return Mjcf(
        name="mjcf", description=DESCRIPTION, parameters=resolved, preset=preset, note=NOTE, make=mjcf, **fields
    )


def _fields(values: Mapping[str, Any], model: mujoco.MjModel) -> dict[str, Any]:
    keyframe = text(values["keyframe"], "'keyframe'") if "keyframe" in values else None
    trim = find_trim(model, keyframe, "state_feedback" in values)
    step = model.opt.timestep
    dt = number(values.get("dt", step), "'dt'")
    steps = multiple(dt, step)
    if steps is None:
        near = max(round(dt / step), 1) * step
        raise ExciteError(f"'dt': {dt:g} s is no whole multiple of the model's timestep; give {near:g} s")
    dynamics = linearise(model, trim, steps)
    actuators = [f"{model.actuator(i).name or f'actuator_{i}'} [1]" for i in range(model.nu)]
    sensors = sensor_channels(model)
    inputs = channels_of({"inputs": actuators, **values}, "inputs", model.nu, "u")
    outputs = channels_of({"outputs": sensors, **values}, "outputs", len(sensors), "y")
    states = tuple(Channel(*each) for each in state_names(model)) if trim.full else ()
    limited = model.actuator_ctrllimited.astype(bool)
    bounds = np.where(limited[:, None], model.actuator_ctrlrange - trim.ctrl[:, None], np.inf * np.array([-1.0, 1.0]))
    if (bounds[:, 0] >= 0).any() or (bounds[:, 1] <= 0).any():
        raise ExciteError(
            f"'keyframe': {trim.name} has a control at the end of its ctrlrange; leave room on both sides"
        )
    free = limits_of(values, "limits", model.nu)
    limits = tuple(
        tuple(b.tolist()) if is_limited else f for b, f, is_limited in zip(bounds, free, limited, strict=True)
    )
    noise = {CONTROL: Parameter(0.0, "of input", "assumption: white on every control, off unless given")}
    source = "the sensor's noise in the model file, white"
    noise |= {
        name: Parameter(float(model.sensor_noise[i]), "of sensor", source) for i, name in enumerate(sensor_names(model))
    }
    fields = {
        "dt": dt,
        "dynamics": dynamics,
        "inputs": inputs,
        "outputs": (*outputs, *states),
        "limits": limits,
        "noise_sources": noise,
        "model": model,
        "trim": trim,
        "steps": steps,
    }
    feedback = _feedback(values, [c.name for c in outputs], dynamics, dt)
    if feedback is None:
        return fields
    seen = np.zeros(len(dynamics.C), bool)
    seen[: model.nsensordata] = direct(model)
    if feedback.controller.D[:, seen[list(feedback.measured)]].any():
        raise ExciteError(
            "'controller': reads a force or an acceleration without delay, an algebraic loop; give it a delay"
        )
    return fields | {
        "feedback": feedback,
        "reference_limits": limits_of(values, "setpoint_limits", len(feedback.measured)),
        "actuator": (Saturation(*bounds.T),) if limited.any() else (),
    }


def _feedback(values: Mapping[str, Any], sensors: list[str], dynamics: Dynamics, dt: float) -> Feedback | None:
    """Return the feedback of a controller on sensors, or of gains on the states, which are then the last outputs."""
    n, nu = dynamics.B.shape
    if "state_feedback" not in values:
        return feedback_of(values["controller"], sensors, nu, dt) if "controller" in values else None
    if "controller" in values:
        raise ExciteError("'state_feedback': a controller is given too; give one of the two")
    K = matrix_of(values["state_feedback"], "state_feedback", (nu, n))
    static = StateSpaceModel(np.zeros((0, 0)), np.zeros((0, n)), np.zeros((nu, 0)), K, dt)
    return Feedback(static, tuple(range(len(sensors), len(sensors) + n)))
