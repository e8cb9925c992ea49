"""excite plants, methods, scenarios: what there is."""

import math
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import click

from excite.errors import ExciteError, did_you_mean
from excite.types.channel import listed
from identify.method import Method
from identify.registry import METHODS, method_class
from plants.plant import Plant
from plants.registry import PLANTS, load_plant
from scenarios.cli.common import assignments, json_option, print_json, print_lines


@click.command()
@click.argument("name", required=False)
@click.option("--preset", metavar="NAME", help="A preset of the plant's parameters.")
@click.option("--set", "parameters", metavar="KEY=VALUE", multiple=True, help="Override a parameter of the plant.")
@click.option(
    "--plot", type=click.Path(), metavar="FILE", help="Draw step, Bode and poles of its truth (.png, .svg, .pdf)."
)
@json_option
def plants(name: str | None, preset: str | None, parameters: tuple[str, ...], plot: str | None, as_json: bool) -> int:
    """List the simulated plants, or describe one: inputs, limits, outputs, parameters, noise, truth."""
    if name is None and (preset or parameters or plot):
        raise ExciteError(
            "plants: --preset, --set and --plot are of one plant; give its name, as in excite plants quadrotor"
        )
    overrides = assignments(parameters, "--set")
    loaded = {key: load_plant(key, preset=preset, parameters=overrides) for key in ([name] if name else sorted(PLANTS))}
    if plot:
        draw_plant(loaded[name], plot)
    described = {key: _plant(plant, whole=name is not None or as_json) for key, plant in loaded.items()}
    if as_json:
        print_json({"schema_version": 1, "plants": described})
    elif name is None:
        print_lines([f"{key:<18} {d['description']}" for key, d in described.items()])
    else:
        print_lines(_plant_lines(name, described[name]))
    return 0


def draw_plant(plant: Plant, path: str) -> None:
    """Draw the truth of every view of a plant into a file."""
    from excite.figures.save import save_figure
    from plants.figures.plant import plant_figure

    save_figure(plant_figure(plant.name, {key: plant.truth(None, key) for key in plant.views}), path)


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


def _plant(plant: Plant, whole: bool) -> dict:
    from identify.estimate_json import pole_to_dict

    if not whole:
        return {"description": plant.description}
    views = {}
    for key, roles in plant.views.items():
        truth = plant.truth(None, key)
        views[key] = {
            "inputs": [str(c) for c in truth.model.inputs],
            "outputs": [str(c) for c in truth.model.outputs],
            "reference": roles.reference,
            "dt": truth.model.dt,
            "closed": roles.closed,
            "truth": truth.kind,
            "valid_amplitude": truth.valid_amplitude,
            "poles": [pole_to_dict(p, truth.model.dt) for p in truth.poles],
        }
    return {
        "description": plant.description,
        "dt": plant.dt,
        "injections": {
            key: {
                "note": place.note,
                "views": list(place.views),
                "channels": [
                    {"channel": str(c), "limits": l} for c, l in zip(place.channels, place.limits, strict=True)
                ],
            }
            for key, place in plant.injections.items()
        },
        "views": views,
        "parameters": {k: vars(p) for k, p in plant.parameters.items()},
        "noise": {k: vars(p) for k, p in plant.noise_sources.items()},
    }


@click.command()
@click.argument("name", required=False)
@json_option
def methods(name: str | None, as_json: bool) -> int:
    """List the identification methods, or describe one with its settings."""
    described = {key: _method(key) for key in ([name] if name else sorted(METHODS))}
    if as_json:
        print_json({"schema_version": 1, "methods": described})
    elif name is None:
        print_lines([f"{key:<14} {d['summary']}" for key, d in described.items()])
    else:
        d = described[name]
        loop = "open and closed loop" if d["closed_loop"] else "open loop only (biased in closed loop)"
        lines = [d["description"], "", f"consistent in: {loop}", "settings:"]
        kind = method_class(name)
        print_lines(
            lines + [f"  {key:<16} default {v!s:<6} {_meaning(kind, key)}".rstrip() for key, v in d["settings"].items()]
        )
    return 0


def _method(name: str) -> dict:
    kind = method_class(name)
    settings = {f.name: None if f.default is MISSING else f.default for f in fields(kind)}
    return {
        "summary": kind.summary,
        "closed_loop": kind.consistent_in_closed_loop,
        "settings": settings,
        "description": "\n".join(line.removeprefix("    ") for line in (kind.__doc__ or "").strip().splitlines()),
    }


def _meaning(kind: type[Method], setting: str) -> str:
    """What a setting means where methods share it; each method's own are explained in its description."""
    declared = (f for base in kind.__mro__ if is_dataclass(base) for f in fields(base) if f.name == setting)
    return next((f.metadata["meaning"] for f in declared if "meaning" in f.metadata), "")


@click.command()
@click.argument("name", required=False)
@json_option
def scenarios(name: str | None, as_json: bool) -> int:
    """List the shipped scenarios, or print one as a starting point for your own."""
    import tomllib

    from scenarios.scenario.spec import shipped

    known = shipped()
    if name is not None and name not in known:
        raise ExciteError(f"scenario '{name}' is not shipped; {did_you_mean(name, known)}")
    chosen = {key: path for key, path in known.items() if name in (None, key)}
    texts = {key: path.read_text(encoding="utf-8") for key, path in chosen.items()}
    if as_json:
        print_json({"schema_version": 1, "scenarios": {key: tomllib.loads(text) for key, text in texts.items()}})
    elif name:
        click.echo(texts[name], nl=False)
    else:
        print_lines([f"{key:<22} {tomllib.loads(text).get('description', '')}" for key, text in texts.items()])
    return 0
