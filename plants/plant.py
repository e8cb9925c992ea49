"""What a plant is, and the table of all plants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Protocol

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import Channel
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth

ALLOWED = ("positive", "non-negative", "any")
NONE = "none"  # a parameter that is not there; files have no other word for it


@dataclass(frozen=True)
class Parameter:
    """One plant parameter: value, unit, where the number comes from ("assumption" when it is one), what is allowed.

    value : a number; a matrix as nested lists, or a text, where a plant is described by such.
    """

    value: Any
    unit: str
    source: str
    allowed: str = "positive"


@dataclass(frozen=True)
class Injection:
    """A place where an excitation enters: its channels, their limits (low, high), and what can be identified from there.

    views : name -> Roles on the recording; a view of the same name at another injection has the same truth.
    """

    channels: tuple[Channel, ...]
    limits: tuple[tuple[float, float], ...]
    views: Mapping[str, Roles] = field(default_factory=dict)
    note: str = ""


class Plant(Protocol):
    """A simulated plant: stateless, starts at trim, SI units or a unit in every channel.

    injections : name -> Injection, the first is the default; noise_sources : name -> Parameter (standard deviations);
    parameters : name -> Parameter.
    """

    name: str
    description: str
    dt: float
    injections: Mapping[str, Injection]
    parameters: Mapping[str, Parameter]
    noise_sources: Mapping[str, Parameter]

    def truth(self, recording: Recording | None, view: str) -> Truth:
        """Return the model an ideal identification of this view would find, from the plant's equations."""
        ...

    def run(
        self, signal: Signal, *, inject: str | None = None, noise: bool | Mapping[str, float] = True, seed: int = 0
    ) -> Recording:
        """Play the signal from trim and record everything; noise: on, off, or name -> standard deviation."""
        ...

    def run_many(
        self,
        signal: Signal,
        *,
        seeds: Sequence[int],
        inject: str | None = None,
        noise: bool | Mapping[str, float] = True,
    ) -> list[Recording]:
        """Play the signal once a seed; each recording equals `run` with that seed."""
        ...


# One line adds a plant: name -> "module:class". The class (or function) takes (preset=..., parameters={...}) as keywords.
PLANTS: dict[str, str] = {
    "aeroelastic": "plants.aeroelastic.modal:aeroelastic",
    "arx_bias": "plants.linear.textbook:arx_bias",
    "delay_process": "plants.linear.textbook:delay_process",
    "etfe_transient": "plants.linear.textbook:etfe_transient",
    "goland": "plants.aeroelastic.goland:goland",
    "inverted_pendulum": "plants.linear.textbook:inverted_pendulum",
    "lti": "plants.linear.lti:lti",
    "mjcf": "plants.mjcf.plant:mjcf",
    "mercere_closed": "plants.linear.textbook:mercere_closed",
    "mercere_open": "plants.linear.textbook:mercere_open",
    "miller_31": "plants.linear.textbook:miller_31",
    "miller_41": "plants.linear.textbook:miller_41",
    "miller_51": "plants.linear.textbook:miller_51",
    "quadrotor": "plants.quadrotor.plant:Quadrotor",
    "thermal_ladder": "plants.thermal.ladder:thermal_ladder",
    "two_mass_spring": "plants.linear.textbook:two_mass_spring",
}


def list_plants() -> list[str]:
    """Names of all plants."""
    return sorted(PLANTS)


def load_plant(name: str, *, preset: str | None = None, parameters: Mapping[str, Any] | None = None) -> Plant:
    """Return a plant by name, with a preset and overridden parameters, those of an actuator in front of it among them."""
    if name not in PLANTS:
        raise ExciteError(f"plant '{name}' does not exist; {did_you_mean(name, PLANTS)}")
    from plants.linear.actuator import IN_FRONT, in_front

    module, kind = PLANTS[name].split(":")
    options = {"preset": preset} if preset is not None else {}
    own = dict(parameters or {})
    actuator = {key: own.pop(key) for key in IN_FRONT if key in own}
    return in_front(getattr(import_module(module), kind)(parameters=own, **options), actuator)


def views_of(plant: Plant) -> dict[str, Roles]:
    """Return all views of a plant by name, with their roles at the first injection that knows them."""
    places = reversed(plant.injections.values())
    found = {name: roles for place in places for name, roles in place.views.items()}
    return {name: found[name] for place in plant.injections.values() for name in place.views}
