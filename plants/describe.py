"""What can be told of a plant: places of entry, limits, views with their truths, parameters, noise."""

from typing import Any

from plants.plant import Plant


def describe_plant(plant: Plant) -> dict[str, Any]:
    """Return a description of a plant in plain values, poles (z plane) as complex numbers.

    Keys: description; dt, s; injections: name -> note, views, channels with their limits; views: name -> inputs, outputs,
    reference, dt (s), closed (whether the inputs depend on the outputs), truth (its kind), valid_amplitude, poles;
    parameters and noise: name -> value, unit, source, allowed.
    """
    views = {}
    for name, roles in plant.views.items():
        truth = plant.truth(None, name)
        views[name] = {
            "inputs": [str(c) for c in truth.model.inputs],
            "outputs": [str(c) for c in truth.model.outputs],
            "reference": roles.reference,
            "dt": truth.model.dt,
            "closed": roles.closed,
            "truth": truth.kind,
            "valid_amplitude": truth.valid_amplitude,
            "poles": list(truth.poles),
        }
    injections = {
        name: {
            "note": place.note,
            "views": list(place.views),
            "channels": [
                {"channel": str(channel), "limits": limits}
                for channel, limits in zip(place.channels, place.limits, strict=True)
            ],
        }
        for name, place in plant.injections.items()
    }
    return {
        "description": plant.description,
        "dt": plant.dt,
        "injections": injections,
        "views": views,
        "parameters": {name: vars(parameter) for name, parameter in plant.parameters.items()},
        "noise": {name: vars(parameter) for name, parameter in plant.noise_sources.items()},
    }
