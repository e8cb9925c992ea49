"""The quadrotor's small-signal truth: MuJoCo's step, the thrust map's slope and the controller, linearised at hover.

MuJoCo's semi-implicit Euler step of h = 2 ms applies the present motor thrusts, then moves with the new velocity. Per
axis, with thrust difference f [N], commanded difference u [N], thrust noise w [N] and acceleration a per newton:

    rate(k+1) = rate(k) + h a f(k),   angle(k+1) = angle(k) + h rate(k+1),
    f(k+1) = z f(k) + (1 - z) (u(k) + w(k)),   z = exp(-h / tau)

Everything here is built in the form x(k+1) = A x + B u + G n, y = C x + H n with white n of unit variance.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from excite.types.channel import Channel
from excite.types.models import StateSpaceModel
from excite.types.truth import Truth
from plants.noise import steady_kalman
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT
from plants.quadrotor.parameters import hover_command, thrust_map

VALID = {
    "rates": "linear but for gyroscopic coupling, (Izz - Iyy)/Ixx q r in roll and alike in pitch; it is integrated, so "
    "a simulation over 60 s fits 99 % at +-1 deg and deg/s but drifts at +-10, where one-step prediction still holds",
    "attitude": "small set-points; noise-free fit 99.9 % for roll alone at +-10 deg, 99.3 % for roll and pitch, "
    "97 % with +-10 deg/s of yaw rate, 87 % with +-50 deg/s (random binary, 0.5 s chips): Euler-angle coupling",
}


@dataclass(frozen=True)
class Axis:
    """One axis at hover: angular acceleration per thrust difference, thrust difference per controller unit."""

    name: str
    acceleration: float  # rad/s2 per N
    thrust_per_unit: float  # N per 16-bit unit


def axes(values: Mapping[str, float]) -> tuple[Axis, Axis, Axis]:
    """Return roll, pitch and yaw; roll and pitch commands enter each motor by half, yaw as a whole."""
    slope = thrust_map(values).slope(hover_command(values))
    lever = values["arm"] / math.sqrt(2.0)
    return (
        Axis("roll", lever / values["ixx"], 2.0 * slope),
        Axis("pitch", lever / values["iyy"], 2.0 * slope),
        Axis("yaw", values["torque_per_thrust"] / values["izz"], 4.0 * slope),
    )


def truth(
    setting: str,
    values: Mapping[str, float],
    noise: Mapping[str, float],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> Truth:
    """Return the truth of setting "rates" or "attitude" for parameter values and noise standard deviations.

    "rates": commanded thrust differences to body rates, 6 states at 2 ms. "attitude": set-points to roll, pitch and
    yaw rate with the loop closed, lifted over the two steps of a 4 ms frame, 11 states with the gains of 2013.

    K and innovation_cov belong to the Kalman filter that starts from the exactly known trim. In "attitude" the
    integrators of roll and pitch are driven by nothing but the recorded set-points and measurements, so nothing
    corrects them and A - K C has an eigenvalue at exactly 1 for each (and near 1 for yaw rate): integral action puts
    a zero of the noise model at z = 1. Predict that setting from the start of a flight, where the state is zero.
    """
    build, dt = (_rates, RATE_DT) if setting == "rates" else (_attitude, ATTITUDE_DT)
    blocks = [build(axis, values, noise) for axis in axes(values)]
    A, B, G, C, H = (la.block_diag(*parts) for parts in zip(*blocks, strict=True))
    K, innovation_cov = steady_kalman(A, G, C, H)
    D = np.zeros((len(C), B.shape[1]))
    model = StateSpaceModel(A, B, C, D, dt, K, innovation_cov, inputs, outputs)
    parameters = {"motor_pole": (math.exp(-RATE_DT / values["motor_tau"]), "per 2 ms")}
    for axis in axes(values):
        parameters[f"{axis.name}_acceleration"] = (axis.acceleration, "rad/s2/N")
        parameters[f"{axis.name}_thrust_per_unit"] = (axis.thrust_per_unit, "N")
    if K is not None:
        parameters["predictor_spectral_radius"] = (float(abs(la.eigvals(A - K @ C)).max()), "1")
    return Truth(model, "linearised", parameters, VALID[setting])


def _rates(axis: Axis, values: Mapping[str, float], noise: Mapping[str, float]) -> tuple[np.ndarray, ...]:
    """Blocks A, B, G, C, H of one axis: state (rate, f), input u, noises (thrust, gyro)."""
    z = math.exp(-RATE_DT / values["motor_tau"])
    A = np.array([[1.0, RATE_DT * axis.acceleration], [0.0, z]])
    B = np.array([[0.0], [1.0 - z]])
    G = np.hstack([B * 2.0 * noise["thrust"], np.zeros((2, 1))])  # four independent motors: standard deviation doubles
    return A, B, G, np.array([[1.0, 0.0]]), np.array([[0.0, noise["gyro"]]])


def _attitude(axis: Axis, values: Mapping[str, float], noise: Mapping[str, float]) -> tuple[np.ndarray, ...]:
    """Blocks A, B, G, C, H of one closed-loop axis over a frame, in degrees.

    The frame's equations run on rows of coefficients with respect to (state, set-point, noises): each quantity is the
    row vector that says how it depends on them. Noises: thrust and gyro at each step, attitude once (not for yaw).
    """
    yaw = axis.name == "yaw"
    loops = ["yaw_rate"] if yaw else ["attitude", "rate"]
    states = ["rate", "f"] if yaw else ["angle", "rate", "f"]
    states += [f"{name}_integral" for name in loops if values[f"{name}_ki"]]
    states += [f"{name}_error" for name in loops if values[f"{name}_kd"]]
    n, noises = len(states), 2 * FRAME + (not yaw)
    basis = np.eye(n + 1 + noises)
    x = dict(zip(states, basis, strict=False))
    set_point, n_thrust, n_gyro = basis[n], basis[n + 1 :][:FRAME], basis[n + 1 + FRAME :][:FRAME]
    w, v = 2.0 * noise["thrust"] * n_thrust, math.degrees(noise["gyro"]) * n_gyro

    def pid(name: str, error: np.ndarray, dt: float) -> np.ndarray:
        output = values[f"{name}_kp"] * error
        if ki := values[f"{name}_ki"]:
            x[f"{name}_integral"] = x[f"{name}_integral"] + error * dt
            output = output + ki * x[f"{name}_integral"]
        if kd := values[f"{name}_kd"]:
            output = output + kd * (error - x[f"{name}_error"]) / dt
            x[f"{name}_error"] = error
        return output

    if yaw:
        y = x["rate"] + v[0]
        rate_ref = set_point
    else:
        y = x["angle"] + noise["attitude"] * basis[-1]
        rate_ref = pid("attitude", set_point - y, ATTITUDE_DT)
    z = math.exp(-RATE_DT / values["motor_tau"])
    for i in range(FRAME):
        u = axis.thrust_per_unit * pid(loops[-1], rate_ref - x["rate"] - v[i], RATE_DT)
        x["rate"] = x["rate"] + RATE_DT * math.degrees(axis.acceleration) * x["f"]
        x["f"] = z * x["f"] + (1.0 - z) * (u + w[i])
        if not yaw:
            x["angle"] = x["angle"] + RATE_DT * x["rate"]
    step = np.array([x[name] for name in states])
    return step[:, :n], step[:, n : n + 1], step[:, n + 1 :], y[None, :n], y[None, n + 1 :]
