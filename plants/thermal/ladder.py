"""The thermal ladder: electronics that heat up, as an RC network of any length seen at one or several nodes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arguments import numbers
from excite.errors import ExciteError, placed
from excite.generators.multistep import log_times
from excite.numerics.networks import cauer_to_foster, foster_to_cauer, response
from excite.numerics.simulate import states
from excite.types.channel import Channel
from plants.arguments import NONE, Parameter, is_there, resolve
from plants.linear.actuator import actuate
from plants.linear.loop import Dynamics
from plants.linear.plant import LinearPlant
from plants.noise import draw
from plants.plant import Layout, Task

FIVE = "assumption: five time constants over the range of Miller 2012, chapter 8"
LED = "Luminus SST-10 application note: LED, board, interface, heat sink"
LARGEST_POWER = 20.0  # W, an assumption
NAME = "thermal_ladder"

_COMMON = {
    "samples_per_decade": Parameter(
        0.0, "1/decade", "of multiples of dt, on a logarithmic scale; 0: all", "non-negative"
    ),
    "transient_time": Parameter(
        100e-6, "s", "assumption: decay of the electrical transient; JESD51-14 finds 1 to 1000 us"
    ),
}
PRESETS: dict[str, dict[str, Parameter]] = {
    "five": {
        "resistance": Parameter([0.5, 1.2, 1.8, 2.0, 1.5], "K/W", FIVE),
        "capacitance": Parameter(
            NONE, "J/K", "of a Cauer ladder, from source to ambient; the alternative to time_constant"
        ),
        "time_constant": Parameter([20e-6, 5e-4, 0.01, 0.25, 6.0], "s", FIVE),
        "nodes": Parameter([1], "1", "the source's own temperature"),
        "dt": Parameter(20e-6, "s", "Miller 2012, chapter 8"),
        **_COMMON,
    },
    "led": {
        "resistance": Parameter([5.3, 0.3, 0.6, 3.7], "K/W", LED),
        "capacitance": Parameter([0.0193, 0.253, 0.0204, 46.1], "J/K", LED),
        "time_constant": Parameter(NONE, "s", "of a Foster network; the alternative to capacitance"),
        "nodes": Parameter(
            [1, 2, 4], "1", "assumption: LED by its forward voltage, board and heat sink by thermocouples"
        ),
        "dt": Parameter(0.01, "s", "assumption"),
        **_COMMON,
    },
}
NOISE_SOURCES = {
    "measurement": Parameter(0.01, "K", "assumption: white, on each temperature; 0.03 and 0.1 K are usual too"),
    "transient": Parameter(
        0.0,
        "K/W",
        "no deviation but the size of the electrical transient at node 1 at each change of power, which decays with "
        "transient_time; off unless given",
    ),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalLadder(LinearPlant):
    """Power into node 1 -> temperature rises over ambient at the observed nodes, from thermal equilibrium.

    resistance (n, m) K/W and tau (n,) s of the network seen from the m nodes: T = sum_i R_i x_i, tau_i dx_i/dt = P - x_i,
    (8.1) of Miller (2012) with vectors R_i. It is solved exactly for power that is held: between samples where they are uniform,
    as a sum of exponentials where they are not. by_voltage (m,) : 1 for node 1, whose temperature is measured electrically and
    shows electrical transients, which are no part of the truth; 0 for other nodes.
    """

    resistance: np.ndarray
    tau: np.ndarray
    by_voltage: np.ndarray

    @property
    def logarithmic(self) -> bool:
        """Whether it samples at times that are even on a logarithmic scale."""
        return bool(self.values["samples_per_decade"])

    def records(self, inject: str | None = None) -> Layout:
        """Power and temperatures; at uneven times where they are logarithmic."""
        layout = super().records(inject)
        return replace(layout, dt=None) if self.logarithmic else layout

    def times(self, task: Task, count: int) -> np.ndarray:
        """Return when the samples are taken, on the grid of dt."""
        return self._log_times(task) if self.logarithmic else super().times(task, count)

    def simulate(self, task: Task, seeds: Sequence[int]) -> Iterator[np.ndarray]:
        """Yield [power, temperatures] of each run."""
        if not self.logarithmic:
            yield from super().simulate(task, seeds)
            return
        power, clean = self._logarithmic(task)
        for seed in seeds:
            noise = draw(self.dynamics.sources, task.levels, seed, len(clean))["measurement"]
            yield np.hstack([power, clean + task.levels["measurement"] * noise])

    def _play(self, reference: np.ndarray, levels: Mapping[str, float], seeds: Sequence[int]) -> tuple[np.ndarray, ...]:
        u, power, T = super()._play(reference, levels, seeds)
        settles = np.array([[-np.expm1(-self.dt / self.values["transient_time"])]])
        settled = states(1 - settles, settles, power[0])
        return u, power, T + levels["transient"] * (power[0] - settled) * self.by_voltage

    def _log_times(self, task: Task) -> np.ndarray:
        with placed(f"{self.name} parameter 'samples_per_decade'"):
            per_decade = int(self.values["samples_per_decade"])
            return log_times(first_s=self.dt, last_s=task.signal.duration_s, per_decade=per_decade, dt=self.dt)

    def _logarithmic(self, task: Task) -> tuple[np.ndarray, np.ndarray]:
        """Return the power (N, ·) at times evenly spaced on a logarithmic scale, and the temperatures (N, m) then."""
        time_s, signal = self._log_times(task), task.signal
        if self.actuator:
            signal = signal.sampled(self.dt)
        power = np.hstack([signal.u, actuate(self.actuator, signal.u)]) if self.actuator else signal.u
        starts = np.flatnonzero(np.append(True, (power[1:] != power[:-1]).any(axis=1)))
        starts_s = starts * signal.dt
        now = power[starts[np.searchsorted(starts_s, time_s, side="right") - 1]]
        # The electrical transient is what its own mode still lacks of the power.
        shown = task.levels["transient"] * self.by_voltage
        R, tau = np.vstack([self.resistance, -shown]), np.append(self.tau, self.values["transient_time"])
        return now, response(R, tau, power[starts, -1], starts_s, time_s) + shown * now[:, -1:]


def thermal_ladder(preset: str = "five", parameters: Mapping[str, Any] | None = None) -> ThermalLadder:
    """Return a ladder: power [W] -> temperature rises over ambient [K] of the observed nodes, 1 being the source.

    resistance with capacitance is a Cauer ladder from the source to ambient; with time_constant a Foster network as seen at
    the source, whose further nodes are those of the equivalent ladder. Either may have any length.
    """
    given = dict(parameters or {})
    for key, other in (("capacitance", "time_constant"), ("time_constant", "capacitance")):
        if is_there(given.get(key)):
            given = {other: NONE} | given
    found = resolve(NAME, PRESETS, preset, given)
    for name in ("resistance", "capacitance", "time_constant"):
        if is_there(found[name].value):
            found[name] = replace(found[name], value=numbers(found[name].value, f"{NAME} parameter '{name}'"))
    R, C, tau, nodes = (found[name].value for name in ("resistance", "capacitance", "time_constant", "nodes"))
    if is_there(C) == is_there(tau):
        raise ExciteError(
            f"{NAME} parameters 'capacitance', 'time_constant': give one of the two, \"{NONE}\" for the other"
        )
    with placed(f"{NAME} parameters"):
        seen, tau = cauer_to_foster(*((R, C) if is_there(C) else foster_to_cauer(R, tau)))
    known = range(1, len(tau) + 1)
    if (
        not isinstance(nodes, list)
        or not nodes
        or not all(type(k) is int and k in known and nodes.count(k) == 1 for k in nodes)
    ):
        raise ExciteError(
            f"{NAME} parameter 'nodes': {nodes!r}; give a list of different nodes from 1 (source) to {len(tau)}"
        )
    seen = seen[:, np.array(nodes) - 1]
    dt, m = found["dt"].value, len(nodes)
    decay = np.exp(-dt / tau)
    return ThermalLadder(
        name=NAME,
        description="thermal RC ladder (Cauer or Foster) of heated electronics: power to temperature rises at its nodes",
        dt=dt,
        dynamics=Dynamics(
            np.diag(decay),
            -np.expm1(-dt / tau)[:, None],
            seen.T,
            np.zeros((m, 1)),
            np.zeros((len(tau), m)),
            np.eye(m),
            {"measurement": m, "transient": 0},
        ),
        inputs=(Channel("power", "W"),),
        outputs=tuple(Channel("source" if k == 1 else f"node_{k}", "K") for k in nodes),
        limits=((0.0, LARGEST_POWER),),
        parameters=found,
        noise_sources=NOISE_SOURCES,
        preset=preset,
        resistance=seen,
        tau=tau,
        by_voltage=(np.array(nodes) == 1).astype(float),
        note="power into node 1, from thermal equilibrium; the limit is an assumption",
        make=thermal_ladder,
    )
