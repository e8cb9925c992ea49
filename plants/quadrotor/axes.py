"""The small-signal equations of the quadrotor at hover, axis by axis: MuJoCo's step, the thrust map's slope, the loops.

MuJoCo's semi-implicit Euler step of h = 2 ms applies the present forces, then moves with the new velocity. Per axis,
with thrust difference f [N], commanded difference u [N], thrust noise n [N] and acceleration a per newton:

    rate(k+1) = rate(k) + h (a f(k) - b air(k)),   angle(k+1) = angle(k) + h rate(k+1),
    f(k+1) = z f(k) + (1 - z) (u(k) + n(k)),   z = exp(-h / tau)
    speed(k+1) = speed(k) + h (g angle(k) - d air(k)),   air = speed - wind

speed [m/s] is sideways, in the direction to which a positive angle tilts the thrust; drag and its moment, d and b, couple
it to the rest. The accelerometer shows the angle d air / g, all that it senses sideways.

An equation is a row of coefficients with respect to (state, inputs, white noises of unit variance): running the firmware's
own statements on such rows for a step, or for a frame of two, gives the matrices of

    x+ = A x + B u + G n,   y = C x + H n
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.quadrotor.air import gust_pole
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT
from plants.quadrotor.parameters import DEGREES, GRAVITY, hover_command, thrust_map


@dataclass(frozen=True)
class Axis:
    """One axis at hover: angular acceleration per thrust difference, thrust difference per controller unit."""

    name: str
    inertia: float  # kg m2
    acceleration: float  # rad/s2 per N
    thrust_per_unit: float  # N per 16-bit unit


@dataclass(frozen=True, eq=False)
class Block:
    """Matrices of one axis; outputs angle and rate (rows of C and H); noise_states : how many states, the last, are wind."""

    A: np.ndarray
    B: np.ndarray
    G: np.ndarray
    C: np.ndarray
    H: np.ndarray
    noise_states: int


def axes(values: Mapping[str, float]) -> tuple[Axis, Axis, Axis]:
    """Return roll, pitch and yaw; roll and pitch commands enter each motor by half, yaw as a whole."""
    slope = thrust_map(values).slope(hover_command(values))
    lever = values["arm"] / math.sqrt(2.0)
    return (
        Axis("roll", values["ixx"], lever / values["ixx"], 2.0 * slope),
        Axis("pitch", values["iyy"], lever / values["iyy"], 2.0 * slope),
        Axis("yaw", values["izz"], values["torque_per_thrust"] / values["izz"], 4.0 * slope),
    )


class _Rows:
    """Named states, inputs and noises as rows of coefficients, and the physics that moves them."""

    def __init__(
        self,
        axis: Axis,
        values: Mapping[str, float],
        noise: Mapping[str, float],
        *,
        states: list[str],
        inputs: int,
        noises: Mapping[str, int],
        drifts: bool,
    ) -> None:
        """noises : source -> how many independent values of it act in the period; drifts : the speed is a state."""
        self.axis, self.values, self.drifts = axis, values, drifts
        self.windy = drifts and noise["gust"] > 0
        states = [*states, *["speed"] * drifts, *["wind"] * self.windy]
        noises = {**noises, **({"gust": noises["thrust"]} if self.windy else {})}
        n, white = len(states), sum(noises.values())
        basis = np.eye(n + inputs + white)
        self.names, self.inputs = states, basis[n : n + inputs]
        self.x = dict(zip(states, basis, strict=False))
        self.nothing = np.zeros(len(basis))
        ends = np.cumsum([n + inputs, *noises.values()])
        scales = {**noise, "thrust": 2.0 * noise["thrust"]}  # four independent motors: their standard deviation doubles
        self.noise = {name: scales[name] * basis[a:b] for name, a, b in zip(noises, ends[:-1], ends[1:], strict=True)}

    def air(self) -> np.ndarray:
        """Velocity of the vehicle through the air, sideways [m/s]."""
        if not self.drifts:
            return self.nothing
        return self.x["speed"] - self.x.get("wind", self.nothing)

    def move(self, u: np.ndarray, i: int) -> None:
        """Advance by 2 ms with commanded thrust difference u, the i-th step of the period."""
        x, axis, values = self.x, self.axis, self.values
        z = math.exp(-RATE_DT / values["motor_tau"])
        air = self.air()
        spin = axis.acceleration * x["f"] - values["drag"] * values["drag_height"] / axis.inertia * air
        if self.drifts:
            x["speed"] = x["speed"] + RATE_DT * (GRAVITY * x["angle"] - values["drag"] / values["mass"] * air)
        if self.windy:
            pole = gust_pole(values)
            x["wind"] = pole * x["wind"] + math.sqrt(1.0 - pole * pole) * self.noise["gust"][i]
        x["rate"] = x["rate"] + RATE_DT * spin
        x["f"] = z * x["f"] + (1.0 - z) * (u + self.noise["thrust"][i])
        if "angle" in x:
            x["angle"] = x["angle"] + RATE_DT * x["rate"]

    def block(self, outputs: list[np.ndarray]) -> Block:
        """Return the matrices, with the rows as they are now for the next state."""
        n, m = len(self.names), len(self.inputs)
        step, y = np.array([self.x[name] for name in self.names]), np.array(outputs)
        return Block(step[:, :n], step[:, n : n + m], step[:, n + m :], y[:, :n], y[:, n + m :], int(self.windy))


def open_axis(axis: Axis, values: Mapping[str, float], noise: Mapping[str, float]) -> Block:
    """Return one axis without its loops over 2 ms: commanded thrust difference [N] to body rate [rad/s]."""
    drifts = axis.name != "yaw" and values["drag"] * values["drag_height"] != 0
    states = ["rate", "f", *["angle"] * drifts]
    rows = _Rows(axis, values, noise, states=states, inputs=1, noises={"thrust": 1, "gyro": 1}, drifts=drifts)
    y = rows.x["rate"] + rows.noise["gyro"][0]
    rows.move(rows.inputs[0], 0)
    return rows.block([y])


def closed_axis(axis: Axis, values: Mapping[str, float], noise: Mapping[str, float]) -> Block:
    """Return one axis with its loops closed over a frame of 4 ms.

    Inputs: set-point of the outer loop (angle [deg], for yaw the rate [deg/s]), what is added to the rate set-point [deg/s]
    and to the thrust difference [N]; outputs as measured at the frame's start: angle [deg] (for yaw the rate [deg/s]),
    and rate [rad/s].
    """
    yaw = axis.name == "yaw"
    loops = ["yaw_rate"] if yaw else ["attitude", "rate"]
    estimates = not yaw and values["estimator_kp"] > 0
    states = ["rate", "f"] if yaw else ["angle", "rate", "f"]
    states += [*["estimate"] * estimates, *(f"{name}_integral" for name in loops if values[f"{name}_ki"])]
    states += [f"{name}_error" for name in loops if values[f"{name}_kd"]]
    noises = {"thrust": FRAME, "gyro": FRAME, **({} if yaw else {"attitude": 1, "accelerometer": 1})}
    drifts = not yaw and values["drag"] > 0
    rows = _Rows(axis, values, noise, states=states, inputs=3, noises=noises, drifts=drifts)
    x, (set_point, rate_added, thrust_added), gyro = rows.x, rows.inputs, rows.noise["gyro"]

    def pid(name: str, error: np.ndarray, dt: float) -> np.ndarray:
        output = values[f"{name}_kp"] * error
        if ki := values[f"{name}_ki"]:
            x[f"{name}_integral"] = x[f"{name}_integral"] + error * dt
            output = output + ki * x[f"{name}_integral"]
        if kd := values[f"{name}_kd"]:
            output = output + kd * (error - x[f"{name}_error"]) / dt
            x[f"{name}_error"] = error
        return output

    rate = x["rate"] + gyro[0]
    if yaw:
        y, rate_ref = rate * DEGREES, set_point
    else:
        angle = x["angle"]
        if estimates:
            shown = (values["drag"] / values["mass"] * rows.air() + rows.noise["accelerometer"][0]) / GRAVITY
            correction = values["estimator_kp"] * (shown - x["estimate"])
            angle = x["estimate"] = x["estimate"] + ATTITUDE_DT * (rate + correction)
        y = angle * DEGREES + rows.noise["attitude"][0]
        rate_ref = pid("attitude", set_point - y, ATTITUDE_DT)
    for i in range(FRAME):
        error = rate_ref + rate_added - (x["rate"] + gyro[i]) * DEGREES
        rows.move(axis.thrust_per_unit * pid(loops[-1], error, RATE_DT) + thrust_added, i)
    return rows.block([y, rate])


def altitude_poles(values: Mapping[str, float]) -> np.ndarray:
    """Return the poles of the altitude hold over 2 ms: altitude, climb rate and total thrust."""
    z = math.exp(-RATE_DT / values["motor_tau"])
    climb = np.array([0.0, 1.0, RATE_DT / values["mass"]])
    gain = (1.0 - z) * values["mass"]
    thrust = np.array([-gain * values["altitude_kp"], -gain * values["altitude_kd"], z])
    return np.linalg.eigvals([np.eye(3)[0] + RATE_DT * climb, climb, thrust])
