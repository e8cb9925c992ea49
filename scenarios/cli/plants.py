"""excite plants."""

import math
from typing import Any

import click

from excite.errors import ExciteError
from excite.types.channel import listed
from plants.describe import describe_plant
from plants.plant import Plant
from plants.registry import PLANTS, load_plant
from scenarios.cli.common import assignments, json_option, plot_option_of
from scenarios.cli.output import print_json, print_lines, save_plot


@click.command()
@click.argument("name", required=False)
@click.option("--preset", metavar="NAME", help="A preset of the plant's parameters.")
@click.option("--set", "parameters", metavar="KEY=VALUE", multiple=True, help="Override a parameter of the plant.")
@plot_option_of("step response, frequency response and poles of its truth")
@json_option
def plants(name: str | None, preset: str | None, parameters: tuple[str, ...], plot: str | None, as_json: bool) -> int:
    """List the simulated plants, or describe one.

    A description names inputs, limits, outputs, parameters, noise and truth.
    """
    if name is None and (preset or parameters or plot):
        raise ExciteError(
            "plants: --preset, --set and --plot are of one plant; give its name, as in excite plants quadrotor"
        )
    overrides = assignments(parameters, "--set")
    loaded = {key: load_plant(key, preset=preset, parameters=overrides) for key in ([name] if name else sorted(PLANTS))}
    if plot and name:
        from plants.figures.plant import plant_figure

        save_plot(plant_figure(name, {key: loaded[name].truth(None, key) for key in loaded[name].views}), plot)
    if as_json:
        print_json({"schema_version": 1, "plants": {key: _described(plant) for key, plant in loaded.items()}})
    elif name is None:
        print_lines([f"{key:<18} {plant.description}" for key, plant in loaded.items()])
    else:
        print_lines(_plant_lines(name, _described(loaded[name])))
    return 0


def _described(plant: Plant) -> dict[str, Any]:
    """Return the description of a plant with its poles as JSON shows them."""
    from identify.estimate_json import pole_to_dict

    described = describe_plant(plant)
    views = {
        key: view | {"poles": [pole_to_dict(pole, view["dt"]) for pole in view["poles"]]}
        for key, view in described["views"].items()
    }
    return described | {"views": views}


def _plant_lines(name: str, d: dict) -> list[str]:
    lines = [f"{name}: {d['description']}", f"sampling time {d['dt']:g} s"]
    for key, place in d["injections"].items():
        lines.append(f"injection {key}: {place['note']}".rstrip(" :"))
        lines += [f"  {c['channel']:<24} {c['limits'][0]:g} to {c['limits'][1]:g}" for c in place["channels"]]
        lines.append(f"  views: {', '.join(place['views'])}")
    for key, view in d["views"].items():
        lines.append(
            f"view {key}: {listed(view['inputs'])} -> {listed(view['outputs'])}, every "
            f"{view['dt'] * 1e3:g} ms, {'closed loop' if view['closed'] else 'inputs free of feedback'}"
        )
        poles = ", ".join(
            f"{p['f_hz'] * 2 * math.pi:.3g} rad/s" + ("" if p["zeta"] is None else f" ({p['zeta']:.2g})")
            for p in view["poles"]
            if p["im"] >= 0
        )
        lines.append(f"  truth ({view['truth']}), natural frequency (damping): {poles or 'no poles'}")
        lines.append(f"  valid: {view['valid_amplitude']}")
    for title in ("parameters", "noise"):
        lines.append(f"{title}:" if d[title] else f"{title}: none")
        lines += [f"  {k:<23} {_value(p['value']):<12} {p['unit']:<10} {p['source']}" for k, p in d[title].items()]
    return lines


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)
