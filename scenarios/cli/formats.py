"""excite formats."""

from typing import Any

import click

from excite.files.formats import FORMATS, describe_format
from scenarios.cli.common import json_option
from scenarios.cli.output import print_json, print_lines


@click.command()
@click.argument("name", required=False)
@json_option
def formats(name: str | None, as_json: bool) -> int:
    """List the file formats, or describe one.

    A description names extensions, reading, writing, and what the format wants of a signal.
    """
    described = {key: describe_format(key) for key in ([name] if name else sorted(FORMATS))}
    if as_json:
        print_json({"schema_version": 1, "formats": described})
    elif name is None:
        print_lines([f"{key:<17} {_ways(d):<13} {d['summary']}" for key, d in described.items()])
    else:
        print_lines(_lines(name, described[name]))
    return 0


def _ways(d: dict[str, Any]) -> str:
    return ", ".join(word for word, there in (("read", d["reads"]), ("written", d["writes"])) if there)


def _lines(name: str, d: dict[str, Any]) -> list[str]:
    holds = "one channel; several channels make several files" if d["one_channel"] else "all channels"
    use = "plays a signal on hardware: rounded to what will be played, and certified as that" if d["plays"] else "data"
    lines = [f"{name}: {d['summary']}", f"extensions: {', '.join(d['extensions'])}", f"it is {_ways(d)}"]
    lines += [f"a file holds: {holds}", f"use: {use}"]
    lines += ["a signal must be:" if d["wants"] else "a signal may be anything"]
    lines += [f"  {key:<9} {words}" for key, words in d["wants"].items()]
    return lines if d["package"] is None else [*lines, f"from the package {d['package']}"]
