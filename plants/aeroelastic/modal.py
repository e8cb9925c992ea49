"""An aircraft of elastic modes after the F/A-18 Active Aeroelastic Wing experiments of Miller (2012), chapter 6."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.models.state_space import StateSpaceModel
from excite.numerics.matrices import zero_order_hold
from excite.types.channel import Channel
from excite.types.recording import Roles
from excite.types.truth import Truth
from plants.aeroelastic.equations import ALL, DT, dynamics, servo, strongest
from plants.aeroelastic.parameters import DESCRIPTIONS, FAMILIES, NOISE, PRESETS
from plants.aeroelastic.sensors import ACCELEROMETERS, PRESSURES
from plants.arguments import resolve
from plants.linear.actuator import RamRate, Saturation
from plants.linear.loop import Feedback
from plants.linear.plant import LinearPlant
from plants.plant import Injection

NAME = "aeroelastic"
SENSORS = (*(Channel(name, "m/s2") for name in ACCELEROMETERS), *(Channel(name, "Pa") for name in PRESSURES))
ROLL_RATE = Channel("roll_rate", "deg/s")


def aeroelastic(preset: str = "flap", parameters: Mapping[str, Any] | None = None) -> "ModalAircraft":
    """Return the aircraft of preset "flap", "aileron", or "combined": both inputs and both references (Miller 2012, 6.3)."""
    resolved = resolve(NAME, PRESETS, preset, parameters or {})
    values = {name: parameter.value for name, parameter in resolved.items()}
    surfaces = [s for s in FAMILIES if f"{s}_travel" in values]
    sensors = strongest(dynamics(values, surfaces, ALL), surfaces, values["outputs"])
    plant = dynamics(values, surfaces, sensors)
    feedback = _feedback(values, surfaces, len(sensors)) if "aileron" in surfaces else None
    positions = tuple(Channel(f"{s}_position", "deg") for s in surfaces)
    travel, rate = (np.array([values[f"{s}_{limit}"] for s in surfaces]) for limit in ("travel", "rate"))
    return ModalAircraft(
        name=NAME,
        description=DESCRIPTIONS[preset],
        dt=DT,
        dynamics=plant,
        preset=preset,
        parameters=resolved,
        inputs=tuple(Channel(f"{s}_command", "deg") for s in surfaces),
        outputs=(*(SENSORS[i] for i in sensors), *((ROLL_RATE,) if feedback else ()), *positions),
        limits=tuple((-most, most) for most in travel.tolist()),
        reference_limits=((-60.0, 60.0),) if feedback else (),
        noise_sources={name: NOISE[name] for name in plant.sources},
        feedback=feedback,
        actuator=(Saturation(-travel, travel), RamRate(*_rams(values, surfaces), rate)),
        note="sampled at 100 Hz; <surface>_command_actual is what the limits of travel and rate leave of the command",
        make=aeroelastic,
    )


def _rams(values: Mapping[str, float], surfaces: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the sampled servos of the surfaces, A (ns, 2, 2) and B (ns, 2)."""
    rams = []
    for surface in surfaces:
        a0, a1 = servo(values, surface)
        rams.append(zero_order_hold(np.array([[0.0, 1.0], [-a0, -a1]]), np.array([[0.0], [a0]]), DT))
    A, B = (np.array(each) for each in zip(*rams, strict=True))
    return A, B[:, :, 0]


def _feedback(values: Mapping[str, float], surfaces: Sequence[str], gyro: int) -> Feedback:
    """Return the roll-rate controller: gain / (lag s + 1) from the rate's error to the aileron's command, held."""
    lag = values["feedback_lag"]
    A, B = zero_order_hold(np.array([[-1.0 / lag]]), np.array([[values["feedback_gain"] / lag]]), DT)
    C = np.array([[float(s == "aileron")] for s in surfaces])
    return Feedback(StateSpaceModel(A, B, C, np.zeros_like(C), DT), measured=(gyro,))


@dataclass(frozen=True, eq=False)
class ModalAircraft(LinearPlant):
    """The aircraft as it is flown; its outputs are the sensors, the gyro in closed loop, and the measured positions.

    Views: "plant", from commands to sensors and gyro (the controller sees the gyro; without it no predictor from the
    commands would be right in closed loop); "position", from measured positions to sensors, Miller's case: noise on the
    input, correlated with that on the outputs; in closed loop "input_response" and "setpoint_response" as well.
    The limits of travel and rate act on what the servos are told; what a gust pushes a surface comes on top.
    """

    @cached_property
    def injections(self) -> dict[str, Injection]:
        """Those of a linear plant, the plant input first, with the views' outputs sorted out."""
        surfaces, names = len(self.inputs), tuple(c.name for c in self.outputs)
        sensors = tuple(c.name for c in self.outputs if c in SENSORS)
        found = {}
        for place, entry in sorted(super().injections.items()):
            views = {key: replace(roles, outputs=names[:-surfaces]) for key, roles in entry.views.items()}
            views["plant"] = replace(views["plant"], inputs=tuple(c.name for c in self.inputs))
            views["position"] = Roles(
                names[-surfaces:], sensors, tuple(c.name for c in entry.channels), closed=self.feedback is not None
            )
            found[place] = replace(entry, views=views)
        return found

    def derive_truth(self, view: str, levels: Mapping[str, float]) -> Truth:
        """Return the truth of a view; that of "position" is derived here.

        Between samples a surface moves as its servo does, so that samples of its position do not hold all that moves the
        structure. Yet they tell the command: without noise x+ = A x + B v, d = S x, so that d(k+1) gives v(k), and

            x(k+1) = (I - P S) A x(k) + P d(k+1),   P = B (S B)^-1;   with z = x - P d, for which S z = 0:
            z(k+1) = (I - P S) A (z(k) + P d(k)),   y(k) = C (z(k) + P d(k)).

        This is exact for every held command, in closed loop and beyond the limits too. Its poles are the structure's and,
        for each surface, the zero of the sampled servo: a pole at negative real z that stands for the motion between
        samples. `poles` are the structure's; models of their order can come within 0.16 % (flap) and 0.05 % (aileron) of the
        accelerometers' response from 3 to 35 Hz. There is no K: the gust enters input and output alike, so that a predictor
        of y from measured positions would see the noise twice.
        """
        if view != "position":
            return super().derive_truth(view, levels)
        roles = next(iter(self.injections.values())).views[view]
        surfaces, sensors = len(roles.inputs), len(roles.outputs)
        n = len(self.dynamics.A) - self.dynamics.noise_states - (self.feedback is not None)  # without gust and roll
        A, B, C = self.dynamics.A[:n, :n], self.dynamics.B[:n], self.dynamics.C[:sensors, :n]
        P = B @ la.inv(B[:surfaces])  # the positions are the first states
        step = (A - P @ A[:surfaces])[surfaces:]
        model = StateSpaceModel(
            step[:, surfaces:],
            step @ P,
            C[:, surfaces:],
            C @ P,
            self.dt,
            inputs=self.outputs[-surfaces:],
            outputs=self.outputs[:sensors],
        )
        return Truth(model, "exact", valid_amplitude="any", poles=la.eigvals(A[2 * surfaces :, 2 * surfaces :]))
