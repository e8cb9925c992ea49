"""What a plant is, and the table of all plants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import Channel
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth


@dataclass(frozen=True)
class Parameter:
    """One plant parameter: value, unit, and where the number comes from ("assumption" when it is one)."""

    value: float
    unit: str
    source: str


@dataclass(frozen=True)
class Injection:
    """A place where an excitation signal enters: its channels, their limits (min, max) and whether it needs the loop."""

    channels: tuple[Channel, ...]
    limits: tuple[tuple[float, float], ...]
    note: str = ""


class Plant(Protocol):
    """A simulated plant: stateless, starts at trim, SI units or a unit in every channel.

    injections : name -> Injection, the first is the default; settings : name -> Roles on the recording;
    noise_sources : name -> Parameter (standard deviations); parameters : name -> Parameter.
    """

    name: str
    description: str
    dt: float
    injections: Mapping[str, Injection]
    settings: Mapping[str, Roles]
    parameters: Mapping[str, Parameter]
    noise_sources: Mapping[str, Parameter]

    def truth(self, recording: Recording, setting: str) -> Truth:
        """Return the model an ideal identification of this setting would find, from the plant's equations."""
        ...

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play the signal from trim and record everything; noise: on, off, or name -> standard deviation."""
        ...

    def run_many(
        self, signal: Signal, *, seeds: Sequence[int], inject: str | None = None, noise: bool | Mapping[str, float] = True
    ) -> list[Recording]:
        """Play the signal once a seed; each recording equals `run` with that seed."""
        ...


# One line adds a plant: name -> "module:class". The class takes (preset=..., parameters={...}) as keywords.
PLANTS: dict[str, str] = {
    "quadrotor": "plants.quadrotor.plant:Quadrotor",
}


def list_plants() -> list[str]:
    """Names of all plants."""
    return sorted(PLANTS)


def load_plant(name: str, *, preset: str | None = None, parameters: Mapping[str, float] | None = None) -> Plant:
    """Return a plant by name, with a preset and overridden parameters."""
    if name not in PLANTS:
        raise ExciteError(f"plant '{name}' does not exist; {did_you_mean(name, PLANTS)}")
    module, kind = PLANTS[name].split(":")
    options = {"preset": preset} if preset is not None else {}
    return getattr(import_module(module), kind)(parameters=parameters or {}, **options)
