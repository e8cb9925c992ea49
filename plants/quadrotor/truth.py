"""The quadrotor's small-signal truth for every view, and whether its loops are internally stable."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.matrices import spectral_radius
from excite.types.channel import Channel
from excite.types.truth import Truth
from plants.noise import steady_kalman
from plants.quadrotor.axes import Block, altitude_poles, axes, closed_axis, open_axis
from plants.quadrotor.battery import Battery
from plants.quadrotor.controller import ATTITUDE_DT, FRAME, RATE_DT
from plants.quadrotor.parameters import NOISE_CHANNELS, SIGNS, hover_command, thrust_map

TELEMETRY_DT = 0.01  # s
SAGGING = 0.02  # accuracy of a truth that takes a sagging battery as fresh
REPEATING = 0.1  # accuracy of the telemetry where every other sample repeats an estimate 2 ms old
GROWTH = 1e-5  # a pole beyond 1 + this grows within minutes; below, it is an integrator and rounding

COUPLING = "loops closed, but for gyroscopic coupling and the thrust map's curvature: 1 % of hover thrust, a few deg/s"
VALID = {
    "rates": "linear but for gyroscopic coupling, (Izz - Iyy)/Ixx q r in roll and alike in pitch; it is integrated, so "
    "a simulation over 60 s fits 99 % at +-1 deg and deg/s but drifts at +-10, where one-step prediction still holds",
    "attitude": "small set-points; noise-free fit 99.9 % for roll alone at +-10 deg, 99.3 % for roll and pitch, "
    "97 % with +-10 deg/s of yaw rate, 87 % with +-50 deg/s (random binary, 0.5 s chips): Euler-angle coupling",
    "telemetry": "as attitude, and exact at every second sample for set-points held over 20 ms, the period that the 4 ms "
    "frames and the 10 ms log have in common; in between it interpolates, since no time-invariant model is true at 10 ms",
    "rate_response": COUPLING,
    "motor_response": COUPLING,
}


def truth(
    view: str,
    values: Mapping[str, float],
    noise: Mapping[str, float],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> Truth:
    """Return the truth of a view for parameter values and noise standard deviations.

    "rates": commanded thrust differences to body rates, 6 states at 2 ms. The others hold with all loops closed, lifted
    over the two steps of a 4 ms frame, 11 states with the parameters of 2013; "attitude": set-points to roll, pitch and yaw
    rate; "rate_response", "motor_response": what is added there to body rates. Drag and estimator add states of their own,
    gusts a state of noise per axis. A sagging battery is taken as fresh: it scales all thrusts by the voltage squared.

    "telemetry" is "attitude" as a 10 ms log shows it. The log falls on frames and between frames in turn, so that the loop
    varies with a period of 20 ms. The model is the square root of the exact one over 20 ms, A10 = A4^(5/2) and
    (A10 + I) B10 = B20: right at every second sample for set-points held over 20 ms, its poles those of the loop. It has no
    noise part.

    K and innovation_cov belong to the Kalman filter that starts from the exactly known trim. In "attitude" the
    integrators of roll and pitch are driven by nothing but the recorded set-points and measurements, so nothing
    corrects them and A - K C has an eigenvalue at exactly 1 for each (and near 1 for yaw rate): integral action puts
    a zero of the noise model at z = 1. Predict that view from the start of a flight, where the state is zero.
    """
    build, dt = (open_axis, RATE_DT) if view == "rates" else (closed_axis, ATTITUDE_DT)
    blocks = [build(axis, values, noise) for axis in axes(values)]
    A, G = (la.block_diag(*(getattr(block, name) for block in blocks)) for name in "AG")
    output = 0 if view in ("rates", "attitude", "telemetry") else 1
    C, H = (la.block_diag(*(getattr(block, name)[[output]] for block in blocks)) for name in "CH")
    entry = {"rate_response": 1, "motor_response": 2}.get(view, 0)
    B = la.block_diag(*(block.B[:, [entry]] for block in blocks))
    if view == "motor_response":
        B = B @ (thrust_map(values).slope(hover_command(values)) * SIGNS)
    if view == "telemetry":
        A, B, dt, K, innovation_cov = *_at_telemetry(A, B), TELEMETRY_DT, None, None
    else:
        K, innovation_cov = steady_kalman(A, G, C, H)
    model = StateSpaceModel(A, B, C, np.zeros((len(C), B.shape[1])), dt, K, innovation_cov, inputs, outputs)
    parameters = {"motor_pole": (math.exp(-RATE_DT / values["motor_tau"]), "per 2 ms")}
    for axis in axes(values):
        parameters[f"{axis.name}_acceleration"] = (axis.acceleration, "rad/s2/N")
        parameters[f"{axis.name}_thrust_per_unit"] = (axis.thrust_per_unit, "N")
    if K is not None:
        parameters["predictor_spectral_radius"] = (spectral_radius(A - K @ C), "1")
    kind = "periodically time-varying" if view == "telemetry" else "linearised"
    poles = np.concatenate([_own_poles(block) for block in blocks]) ** (
        dt / (RATE_DT if view == "rates" else ATTITUDE_DT)
    )
    return Truth(model, kind, parameters, VALID[view], poles, _accuracy(view, values))


def _accuracy(view: str, values: Mapping[str, float]) -> float:
    if view == "telemetry" and values["estimator_kp"] > 0:
        return REPEATING
    return SAGGING if Battery.sags(values) else Truth.accuracy


def _own_poles(block: Block) -> np.ndarray:
    """Return the poles but for those of the wind, which shapes noise alone."""
    n = len(block.A) - block.noise_states
    return la.eigvals(block.A[:n, :n]).astype(complex)


def _at_telemetry(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B at 10 ms from those at 4 ms, such that two steps are five of them under a held input."""
    powers = [np.linalg.matrix_power(A, i) for i in range(5)]
    root = la.fractional_matrix_power(A, 2.5)
    if np.iscomplexobj(root) and np.abs(root.imag).max() > 1e-9 * np.abs(root).max():
        raise ExciteError(
            "quadrotor view 'telemetry': the loop has a pole on the negative real axis, so no model at 10 ms is right at "
            "every second sample; use view 'attitude', or a longer motor_tau"
        )
    A10 = np.real(root)
    return A10, la.solve(A10 + np.eye(len(A)), sum(powers) @ B)


def check_stability(values: Mapping[str, float]) -> None:
    """Refuse loops that are not internally stable at hover: roll, pitch, yaw and altitude, all states.

    Integrators are let pass: a vehicle without altitude or yaw gains drifts, but slowly.
    """
    silent = dict.fromkeys(NOISE_CHANNELS, 0.0)
    poles = {axis.name: la.eigvals(closed_axis(axis, values, silent).A) for axis in axes(values)}
    steps = {**dict.fromkeys(poles, FRAME), "altitude": 1}
    poles["altitude"] = altitude_poles(values)
    for name, found in poles.items():
        worst = found[np.argmax(np.abs(found))]
        if abs(worst) > 1.0 + GROWTH:
            s = np.log(complex(worst)) / (steps[name] * RATE_DT)
            raise ExciteError(
                f"quadrotor: the {name} loop is not internally stable: pole {worst:.6g} per {steps[name] * 2} ms, growing by "
                f"exp({s.real:.3g} t) at {abs(s.imag):.3g} rad/s; lower the gains of that loop, or shorten motor_tau"
            )
