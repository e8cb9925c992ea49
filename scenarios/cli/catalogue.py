"""excite plants, methods, scenarios: what there is."""

from dataclasses import MISSING, fields

import click

from excite.errors import ExciteError, did_you_mean
from identify.method import METHODS, method_class
from plants.plant import PLANTS, load_plant, settings_of
from scenarios.cli.common import json_option, print_json, print_lines


@click.command()
@click.argument("name", required=False)
@json_option
def plants(name: str | None, as_json: bool) -> int:
    """List the simulated plants, or describe one: inputs, limits, outputs, parameters, noise, truth."""
    described = {key: _plant(key) for key in ([name] if name else sorted(PLANTS))}
    if as_json:
        print_json({"schema_version": 1, "plants": described})
        return 0
    if name is None:
        print_lines([f"{key:<14} {d['description']}" for key, d in described.items()])
        return 0
    d = described[name]
    lines = [f"{name}: {d['description']}", f"sampling time {d['dt']:g} s"]
    for key, place in d["injections"].items():
        lines.append(f"injection {key}: {place['note']}")
        lines += [f"  {c['channel']:<24} {c['limits'][0]:g} to {c['limits'][1]:g}" for c in place["channels"]]
    for key, setting in d["settings"].items():
        lines.append(
            f"setting {key}: {', '.join(setting['inputs'])} -> {', '.join(setting['outputs'])}, every "
            f"{setting['dt'] * 1e3:g} ms, {'closed loop' if setting['closed'] else 'inputs free of feedback'}"
        )
        poles = ", ".join(f"{p['f_hz'] * 6.283185307:.3g} rad/s" + ("" if p["zeta"] is None else f" ({p['zeta']:.2f})")
                          for p in setting["poles"] if p["im"] >= 0)  # fmt: skip
        lines.append(f"  truth ({setting['truth']}), natural frequency (damping): {poles}")
    for title in ("parameters", "noise"):
        lines.append(f"{title}:")
        lines += [f"  {k:<20} {p['value']:<12g} {p['unit']:<10} {p['source']}" for k, p in d[title].items()]
    print_lines(lines)
    return 0


def _plant(name: str) -> dict:
    from identify.model_json import pole_to_dict

    plant = load_plant(name)
    settings = {}
    for key, roles in settings_of(plant).items():
        truth = plant.truth(None, key)
        settings[key] = {
            "inputs": [str(c) for c in truth.model.inputs], "outputs": [str(c) for c in truth.model.outputs],
            "reference": roles.reference, "dt": truth.model.dt, "closed": roles.closed, "truth": truth.kind,
            "valid_amplitude": truth.valid_amplitude,
            "poles": [pole_to_dict(p, truth.model.dt) for p in truth.poles],
        }  # fmt: skip
    return {
        "description": plant.description, "dt": plant.dt,
        "injections": {
            key: {
                "note": place.note,
                "channels": [{"channel": str(c), "limits": l} for c, l in zip(place.channels, place.limits, strict=True)],
            }
            for key, place in plant.injections.items()
        },
        "settings": settings,
        "parameters": {k: vars(p) for k, p in plant.parameters.items()},
        "noise": {k: vars(p) for k, p in plant.noise_sources.items()},
    }  # fmt: skip


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
        print_lines(lines + [f"  {key:<14} default {value}" for key, value in d["settings"].items()])
    return 0


def _method(name: str) -> dict:
    kind = method_class(name)
    settings = {f.name: None if f.default is MISSING else f.default for f in fields(kind)}
    return {
        "summary": kind.summary, "closed_loop": kind.closed_loop, "settings": settings,
        "description": "\n".join(line.removeprefix("    ") for line in (kind.__doc__ or "").strip().splitlines()),
    }  # fmt: skip


@click.command()
@click.argument("name", required=False)
@json_option
def scenarios(name: str | None, as_json: bool) -> int:
    """List the shipped scenarios, or print one as a starting point for your own."""
    import tomllib

    from scenarios.spec import shipped

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
