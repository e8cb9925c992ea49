"""LinearPlant: a plant from matrices, open or closed, with noise, an actuator and its exact truth."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.modes import DELAY
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.loop import Loop
from excite.types.recording import Roles
from excite.types.truth import Truth
from plants.arguments import Parameter
from plants.linear.actuator import Backlash, Element, Quantiser, apart, elements_in_front
from plants.linear.loop import Dynamics, Feedback, interconnect, play, start
from plants.noise import draw, draw_start, steady_kalman
from plants.plant import Injection, Layout, Plant, Task

ENTRIES = {"input": "plant input", "plant_input": "plant input", "setpoint": "set-point"}


@dataclass(frozen=True, eq=False)
class LinearPlant(Plant):
    """A linear plant, its loop and its noise; what it records are u, y and r of the diagram in plants/linear/loop.py.

    inputs, outputs : channels of u and y; limits : (low, high) of each input; reference_limits : of each set-point;
    noise_sources : name -> Parameter, in the order of dynamics.sources; actuator : elements between u and the plant;
    make : what made the plant from a preset and parameters, by which it is made again for a recording with others.

    Open loop: injection "input", view "plant" (u -> y). Closed loop: injections "setpoint" (r2, channel r_<output>)
    and "plant_input" (r1, channel r_<input>); views "plant" (u -> y, closed) and "setpoint_response" or
    "input_response" (r -> y, free of feedback). With an actuator its output is recorded as <input>_actual, and is what
    "plant" takes for u; backlash and quantiser have no small-signal truth, so the response views are left out then.

    With an input_filter, in open loop, there is a second injection "filtered_input": what is played (channels w_<input>)
    goes through the filter, and u, which the filter colours, is recorded beside it.
    """

    name: str
    description: str
    dt: float
    dynamics: Dynamics
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    limits: tuple[tuple[float, float], ...]
    parameters: Mapping[str, Parameter]
    noise_sources: Mapping[str, Parameter]
    preset: str | None = None
    feedback: Feedback | None = None
    reference_limits: tuple[tuple[float, float], ...] = ()
    actuator: tuple[Element, ...] = ()
    input_filter: StateSpaceModel | None = None
    note: str = ""
    make: Callable[..., Plant] | None = None

    def __post_init__(self) -> None:
        try:
            interconnect(self.dynamics, self.feedback)
        except ExciteError as error:
            raise ExciteError(f"{self.name}: {error}") from None

    @cached_property
    def acting(self) -> tuple[Channel, ...]:
        """What acts on the plant: the inputs, or the actuator's outputs where there is one."""
        return tuple(Channel(f"{c.name}_actual", c.unit) for c in self.inputs) if self.actuator else self.inputs

    @cached_property
    def injections(self) -> dict[str, Injection]:
        """Places of entry."""
        u, y = ([c.name for c in channels] for channels in (self.acting, self.outputs))
        if self.feedback is None:
            views = {"plant": Roles(tuple(u), tuple(y))}
            found = {"input": Injection(self.inputs, self.limits, views, self.note)}
            if self.input_filter is not None:
                w = tuple(Channel(f"w_{c.name}", c.unit) for c in self.inputs)
                found["filtered_input"] = Injection(
                    w, self.limits, views, "played through the input filter, which gives u"
                )
            return found
        measured = [self.outputs[i] for i in self.feedback.measured]
        places = {
            "setpoint": ("setpoint_response", measured, self.reference_limits),
            "plant_input": ("input_response", self.inputs, self.limits),
        }
        found = {}
        for place, (response, channels, limits) in places.items():
            r = tuple(Channel(f"r_{c.name}", c.unit) for c in channels)
            names = tuple(c.name for c in r)
            views = {"plant": Roles(tuple(u), tuple(y), names, closed=True)}
            if not any(isinstance(element, Backlash | Quantiser) for element in self.actuator):
                views[response] = Roles(names, tuple(y))
            found[place] = Injection(r, limits, views, self.note)
        return found

    def records(self, inject: str | None = None) -> Layout:
        """What is played where it is none of u, then u, the actuator's output where there is one, and y."""
        inject = self._place(inject)
        channels = (*self.inputs, *(self.acting if self.actuator else ()), *self.outputs)
        if inject != "input":
            channels = (*self.injections[inject].channels, *channels)
        return Layout(channels, self.dt, self.injections[inject].views, "plant", self._loop(inject))

    def again(self, preset: str | None, parameters: Mapping[str, Any]) -> Plant:
        """Make this plant anew, with the actuator in front of it that the parameters describe."""
        if self.make is None:
            raise ExciteError(f"{self.name}: nothing says how it is made with other parameters; give the plant `make`")
        own, front = apart(parameters)
        return self.make(parameters=own, **({} if preset is None else {"preset": preset})).with_actuator(front)

    def with_actuator(self, given: Mapping[str, Any]) -> "LinearPlant":
        """Put the elements that parameters named as in `plants.linear.actuator.IN_FRONT` describe before the inputs."""
        elements, parameters = elements_in_front(self.name, given, len(self.inputs), self.dt)
        return replace(self, parameters={**self.parameters, **parameters}, actuator=elements + self.actuator)

    def derive_truth(self, view: str, levels: Mapping[str, float]) -> Truth:
        """Return the exact model of a view."""
        plant = self.dynamics.scaled(levels)
        n, nu = len(plant.A) - plant.noise_states, plant.B.shape[1]
        place = next(p for p in self.injections.values() if view in p.views)
        roles = place.views[view]
        known = {c.name: c for c in (*self.inputs, *self.acting, *place.channels, *self.outputs)}
        inputs, outputs = ([known[name] for name in names] for names in (roles.inputs, roles.outputs))
        if view == "plant":
            A, B, G, C, D, H = plant.A, plant.B, plant.G, plant.C, plant.D, plant.H
            own = plant.A[:n, :n]
        else:
            assert self.feedback is not None  # every other view is of a loop
            loop = interconnect(plant, self.feedback)
            m = len(self.feedback.measured)
            entering = slice(0, nu) if view == "input_response" else slice(nu, nu + m)
            A, C = loop.A, loop.C[nu:]
            B, D, G, H = loop.B[:, entering], loop.D[nu:, entering], loop.B[:, nu + m :], loop.D[nu:, nu + m :]
            keep = np.r_[:n, len(plant.A) : len(A)]
            own = A[np.ix_(keep, keep)]
        rows = [self.outputs.index(c) for c in outputs]
        C, D, H = C[rows], D[rows], H[rows]
        K, innovation_cov = steady_kalman(A, G, C, H)
        model = StateSpaceModel(A, B, C, D, self.dt, K, innovation_cov, inputs, outputs)
        kind, valid = "exact", "any: the plant is linear"
        if self.actuator and roles.inputs != tuple(c.name for c in self.acting):
            kind, valid = "linearised", "while the actuator passes commands unchanged"
        poles = la.eigvals(own)
        poles = poles[np.abs(poles) > DELAY]
        return Truth(model, kind, valid_amplitude=valid, poles=poles)

    def simulate(self, task: Task, seeds: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield [what is played, u, v, y] of each run, without what `records` leaves out."""
        u, v, y = self._play(self._reference(task), task.levels, seeds)
        for columns in zip(u, v, y, strict=True):
            shown = columns if self.actuator else (columns[0], columns[2])
            yield np.hstack(shown if task.inject == "input" else (task.u, *shown))

    def _reference(self, task: Task) -> np.ndarray:
        """Return [r1, r2] (N, ·) of the diagram."""
        r = task.u
        if task.inject == "filtered_input" and self.input_filter is not None:
            return self.input_filter.simulate(r)
        if self.feedback is None:
            return r
        other = np.zeros((len(r), len(self.inputs) + len(self.feedback.measured) - r.shape[1]))
        return np.hstack([r, other] if task.inject == "plant_input" else [other, r])

    def _loop(self, inject: str) -> Loop:
        if self.feedback is None:
            return Loop("open")
        return Loop("closed", self.feedback.controller, self.feedback.sign, ENTRIES[inject])

    def _play(self, reference: np.ndarray, levels: Mapping[str, float], seeds: Sequence[int]) -> tuple[np.ndarray, ...]:
        """Return u, v and y (R, N, ·) of one run per seed."""
        plant = self.dynamics.scaled(levels)
        loop = interconnect(plant, self.feedback)
        root = start(plant, loop)
        noise = self._noise(levels, seeds, len(reference))
        z = np.array([draw_start(plant.sources, seed, root.shape[1]) for seed in seeds])
        return play(plant, self.feedback, self.actuator, loop, reference, noise, z @ root.T)

    def _noise(self, levels: Mapping[str, float], seeds: Sequence[int], count: int) -> np.ndarray:
        """Return white noise of unit variance (R, count, nw) in the order of the sources."""
        drawn = (draw(self.dynamics.sources, levels, seed, count).values() for seed in seeds)
        return np.array([np.hstack([np.zeros((count, 0)), *each]) for each in drawn])
