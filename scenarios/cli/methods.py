"""excite methods."""

import click

from identify.describe import describe_method
from identify.registry import METHODS
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines


@click.command()
@click.argument("name", required=False)
@json_option
def methods(name: str | None, as_json: bool) -> int:
    """List the methods, or describe one with its settings."""
    described = {key: describe_method(key) for key in ([name] if name else sorted(METHODS))}
    if as_json:
        print_json({"schema_version": 1, "methods": described})
    elif name is None:
        print_lines([f"{key:<14} {d['summary']}" for key, d in described.items()])
    else:
        d = described[name]
        loop = "open and closed loop" if d["closed_loop"] else "open loop only (biased in closed loop)"
        lines = [d["description"], "", f"consistent in: {loop}", "settings:"]
        meanings = d["meanings"]
        lines += [f"  {key:<16} default {v!s:<6} {meanings.get(key, '')}".rstrip() for key, v in d["settings"].items()]
        print_lines(lines)
    return 0
