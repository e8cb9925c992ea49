"""excite scenarios."""

import tomllib

import click

from excite.errors import ExciteError, did_you_mean
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines
from scenarios.scenario.reading import shipped


@click.command()
@click.argument("name", required=False)
@json_option
def scenarios(name: str | None, as_json: bool) -> int:
    """List the shipped scenarios, or print one to start from."""
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
