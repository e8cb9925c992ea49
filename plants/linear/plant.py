"""LinearPlant: a plant from matrices, open or closed, with noise, an actuator and its exact truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError, did_you_mean
from excite.models.modes import DELAY
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from plants.arguments import check_limits, held, injection_of, noise_levels, seed_of
from plants.linear.actuator import Backlash, Element, Quantiser
from plants.linear.loop import Dynamics, Feedback, interconnect, play, start
from plants.noise import steady_kalman
from plants.plant import Injection, Parameter, load_plant, views_of

ENTRIES = {"input": "plant input", "plant_input": "plant input", "setpoint": "set-point"}


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """A linear plant, its loop and its noise; what it records are u, y and r of the diagram in plants/loop.py.

    inputs, outputs : channels of u and y; limits : (low, high) of each input; reference_limits : of each set-point;
    noise_sources : name -> Parameter, in the order of dynamics.sources; actuator : elements between u and the plant.

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

    def truth(self, recording: Recording | None, view: str) -> Truth:
        """Return the exact model of a view, with the noise levels and parameters of `recording`."""
        views = views_of(self)
        if view not in views:
            raise ExciteError(f"{self.name} view '{view}' does not exist; {did_you_mean(view, views)}")
        if recording is None:
            return self._truth(view, noise_levels(self.name, self.noise_sources, True))
        origin = recording.origin
        if origin.plant != self.name:
            raise ExciteError(f"{self.name} truth: the recording is of {origin.plant!r}; pass one of this plant")
        if origin.parameters != self.values():
            same = load_plant(self.name, preset=origin.preset, parameters=origin.parameters)
            return same.truth(recording, view)
        return self._truth(view, origin.noise)

    def _truth(self, view: str, levels: Mapping[str, float]) -> Truth:
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

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play `signal` with zero-order hold."""
        return self.run_many(signal, seeds=[seed], inject=inject, noise=noise)[0]

    def run_many(
        self,
        signal: Signal,
        *,
        seeds: Sequence[int],
        inject: str | None = None,
        noise: bool | Mapping[str, float] = True,
    ) -> list[Recording]:
        """Play `signal` once a seed."""
        inject = injection_of(self.name, self.injections, inject)
        seeds = [seed_of(self.name, seed) for seed in seeds]
        hold = held(self.name, signal, self.dt, "the plant's sampling time")
        check_limits(self.name, signal, self.injections[inject])
        levels = noise_levels(self.name, self.noise_sources, noise)
        r = np.repeat(signal.u, hold, axis=0)
        if inject == "filtered_input":
            full = self.input_filter.simulate(r)
        elif self.feedback is not None:
            other = np.zeros((len(r), len(self.inputs) + len(self.feedback.measured) - r.shape[1]))
            full = np.hstack([r, other] if inject == "plant_input" else [other, r])
        else:
            full = r
        u, v, y = self._play(full, levels, seeds)
        period = None if signal.period is None else int(signal.period) * hold
        channels = (*self.inputs, *(self.acting if self.actuator else ()), *self.outputs)
        outside = inject != "input"  # what is played is none of the channels u and y
        if outside:
            channels = (*self.injections[inject].channels, *channels)
        recordings = []
        for seed, *columns in zip(seeds, u, v, y, strict=True):
            columns = [columns[0], columns[2]] if not self.actuator else columns
            columns = [r, *columns] if outside else columns
            recordings.append(
                Recording(
                    time_s=np.arange(len(r)) * self.dt,
                    values=np.hstack(columns),
                    channels=channels,
                    dt=self.dt,
                    views=self.injections[inject].views,
                    default="plant",
                    period=period,
                    loop=self._loop(inject),
                    origin=Origin(self.name, self.preset, self.values(), inject, levels, seed),
                    level="zero",
                )
            )
        return recordings

    def values(self) -> dict[str, Any]:
        """Return the parameters' values."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    def _loop(self, inject: str) -> Loop:
        if self.feedback is None:
            return Loop("open")
        return Loop("closed", self.feedback.controller, self.feedback.sign, ENTRIES[inject])

    def _play(self, reference: np.ndarray, levels: Mapping[str, float], seeds: list[int]) -> tuple[np.ndarray, ...]:
        plant = self.dynamics.scaled(levels)
        loop = interconnect(plant, self.feedback)
        root = start(plant, loop)
        noise, initial = draw(plant.sources, levels, seeds, len(reference), root.shape[1])
        return play(plant, self.feedback, self.actuator, loop, reference, noise, initial @ root.T)


def draw(
    sources: Mapping[str, int], levels: Mapping[str, float], seeds: Sequence[int], count: int, initial: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return white noise of unit variance (R, N, nw) and (R, initial), from a spawned stream a source and one for the start.

    Zeros for sources whose level is zero, where nobody would see it.
    """
    noise, start = np.empty((len(seeds), count, sum(sources.values()))), np.empty((len(seeds), initial))
    for i, seed in enumerate(seeds):
        *streams, last = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(sources) + 1))
        noise[i] = np.hstack(
            [
                np.zeros((count, 0)),
                *(
                    stream.standard_normal((count, width)) if levels[name] else np.zeros((count, width))
                    for stream, (name, width) in zip(streams, sources.items(), strict=True)
                ),
            ]
        )
        start[i] = last.standard_normal(initial)
    return noise, start
