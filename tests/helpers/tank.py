"""A plant written against `plants.plant.Plant` alone, as another package would, and some faults to be found in it."""

from typing import ClassVar

import numpy as np

from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.loop import Loop
from excite.types.recording import Roles
from excite.types.truth import Truth
from plants.arguments import Parameter, resolve
from plants.noise import draw
from plants.plant import Injection, Layout, Plant

PRESETS = {"small": {"decay": Parameter(0.9, "1", "assumption"), "dt": Parameter(0.5, "s", "assumption")}}


class Tank(Plant):
    """Level of a tank behind a valve: x+ = a x + (1 - a) (u + n), y = x."""

    name, description, fault = "tank", "a tank behind a valve", None
    injections: ClassVar = {
        "valve": Injection((Channel("valve", "1"),), ((0.0, 2.0),), {"level": Roles(("valve",), ("level",))})
    }
    outputs = (Channel("level", "m"),)
    noise_sources: ClassVar = {"inflow": Parameter(0.1, "1", "assumption")}

    def __init__(self, preset="small", parameters=None):
        self.preset, self.parameters = preset, resolve(self.name, PRESETS, preset, parameters or {})
        self.dt = self.values["dt"]

    def records(self, inject=None):
        unit = "l" if self.fault == "another unit" else "m"
        return Layout((Channel("valve", "1"), Channel("level", unit)), self.dt, self.views, "level", Loop("open"))

    def simulate(self, task, seeds):
        a, u = self.values["decay"], task.u
        for seed in seeds:
            noise = draw({"inflow": 1}, task.levels, seed, len(u))["inflow"] * task.levels["inflow"]
            if self.fault == "unseeded":
                noise = task.levels["inflow"] * np.random.default_rng().standard_normal(u.shape)
            x = np.zeros((len(u) + 1, 1))
            for k in range(len(u)):
                x[k + 1] = a * x[k] + (1 - a) * (u[k] + noise[k])
            shown = u + noise if self.fault == "shows what acts" else u
            yield np.hstack([shown, x[:-1] * (np.nan if self.fault == "not finite" else 1.0)])

    def derive_truth(self, view, levels):
        a = 0.8 if self.fault == "wrong truth" else self.values["decay"]
        noise = levels["inflow"] * (1 - a)
        model = StateSpaceModel(
            [[a]], [[1 - a]], [[1.0]], [[0.0]], self.dt, inputs=["valve [1]"], outputs=["level [m]"]
        )
        return Truth(model, "exact", {"noise": (noise, "m")})


def tank(fault=None, **options):
    plant = Tank(**options)
    plant.fault = fault
    return plant
