"""The table of all plants, ours and those of installed packages (entry points `excite.plants`)."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from excite.errors import ExciteError
from excite.registry import Registry
from plants.linear.actuator import apart
from plants.plant import Plant


def _accepts(make: Any) -> str | None:
    """Return why something in an entry point makes no plant, or None."""
    try:
        inspect.signature(make).bind(preset="a name", parameters={})
    except TypeError as error:
        return f"it cannot be called with preset and parameters ({error}); give the class or a function that can"
    except ValueError:  # a callable whose signature cannot be read
        return None
    return None


# One line adds a plant: name -> "module:class". The class (or function) takes (preset=..., parameters={...}) as keywords.
PLANTS: Registry[Callable[..., Plant]] = Registry(
    "plant",
    {
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
    },
    _accepts,
)


def list_plants() -> list[str]:
    """Return the names of all plants.

    Example
    -------
    >>> "quadrotor" in list_plants()
    True
    """
    return list(PLANTS)


def load_plant(name: str, *, preset: str | None = None, parameters: Mapping[str, Any] | None = None) -> Plant:
    """Return a plant by name.

    Parameters
    ----------
    name : one of `list_plants`.
    preset : a set of parameters that the plant knows by name; None: its default.
    parameters : overrides by name, those of an actuator in front of it (`plants.linear.actuator.IN_FRONT`) among them.

    Raises
    ------
    ExciteError naming the plant, preset or parameter that does not exist, or the value that it cannot take.
    """
    own, front = apart(parameters or {})
    plant = PLANTS[name](parameters=own, **({} if preset is None else {"preset": preset}))
    if not isinstance(plant, Plant):
        raise ExciteError(
            f"plant '{name}': makes a {type(plant).__name__}; a plant is a subclass of plants.plant.Plant"
        )
    return plant.with_actuator(front)
