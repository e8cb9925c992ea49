"""The airframe in MuJoCo: the rigid body, its motors and the ground, set from parameter values."""

import math
from collections.abc import Mapping
from pathlib import Path

import mujoco

from excite.errors import ExciteError
from plants.quadrotor.parameters import SIGNS


def build_model(values: Mapping[str, float]) -> mujoco.MjModel:
    """Return the MuJoCo model with mass, inertia, arm, motor lag and reaction torque set from parameter values.

    The ground bears the vehicle only when it takes off from there; a flight that starts in hover never touches it.
    """
    _check_inertia(values)
    spec = mujoco.MjSpec.from_string(Path(__file__).with_name("model.xml").read_text(encoding="utf-8"))
    body = spec.body("quadrotor")
    body.mass = values["mass"]
    body.inertia = [values["ixx"], values["iyy"], values["izz"]]
    lever = values["arm"] / math.sqrt(2.0)
    for motor, (roll, pitch, yaw) in zip(spec.actuators, SIGNS.T, strict=True):
        spec.site(motor.name).pos = [-pitch * lever, roll * lever, 0.0]
        motor.dynprm[0] = values["motor_tau"]
        motor.gear = [0.0, 0.0, 1.0, 0.0, 0.0, yaw * values["torque_per_thrust"]]
    if values["takeoff"] > 0:
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    try:
        return spec.compile()
    except ValueError as error:
        raise ExciteError(f"quadrotor parameters: MuJoCo refuses them ({str(error).splitlines()[0]})") from error


def _check_inertia(values: Mapping[str, float]) -> None:
    """Refuse moments of inertia that no body has: each is at most the sum of the other two."""
    moments = {name: values[name] for name in ("ixx", "iyy", "izz")}
    largest = max(moments, key=moments.__getitem__)
    others = [name for name in moments if name != largest]
    most = sum(moments[name] for name in others)
    if moments[largest] > most:
        raise ExciteError(
            f"quadrotor parameter '{largest}': {moments[largest]:g} kg m2; no rigid body has a moment of inertia above the "
            f"sum of the other two, {' + '.join(others)} = {most:g} kg m2; lower {largest}, or raise {' and '.join(others)}"
        )
