"""Options that several commands share, and how their values are read."""

import re
import tomllib
from collections.abc import Callable, Sequence
from typing import Any

import click

from excite.errors import ExciteError

MOST_ORDERS = 1000

json_option = click.option("--json", "as_json", is_flag=True, help="Print one strict JSON object instead of text.")
limits_option = click.option(
    "--limits", type=click.Path(), metavar="FILE", help="TOML file of hardware limits (amplitude, rate, bits, …)."
)


def plot_option_of(what: str) -> Callable:
    """Return the option --plot of a command that draws `what`."""
    ways = "(.png, .svg, .pdf, or its data: .json, .csv)"
    return click.option("--plot", type=click.Path(), metavar="FILE", help=f"Draw {what} {ways}.")


plot_option = plot_option_of("signal, spectrum, autocorrelation and histogram")


class Order(click.ParamType):
    """A model order, or the name of a rule that chooses it."""

    name = "order"

    def convert(self, value: str | int, param: click.Parameter | None, ctx: click.Context | None) -> str | int:
        """Return a whole number, or the name of a rule."""
        try:
            return int(value)
        except ValueError:
            from identify.orders.rules import ORDER_RULES

            if value not in ORDER_RULES:
                self.fail(f"{value!r} is not a valid integer, nor a rule; rules: {', '.join(ORDER_RULES)}", param, ctx)
            return value


def toml_value(text: str) -> Any:
    """Read a TOML value (20, 1.5, true, [1, 2], "a"); anything else is text, and 1,2,3 a list."""
    for candidate in (text, f"[{text}]"):
        try:
            return tomllib.loads(f"v = {candidate}")["v"]
        except tomllib.TOMLDecodeError:
            continue
    try:
        return float(text)  # .5 and 1., which TOML does not know
    except ValueError:
        return [part.strip() for part in text.split(",")] if "," in text else text


def assignments(pairs: tuple[str, ...], option: str) -> dict[str, Any]:
    """Parse key=TOML-value pairs."""
    values = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.strip() or not text.strip():
            raise ExciteError(f"{option} {pair}: give key=value, for example block_rows=20")
        values[key.strip()] = toml_value(text.strip())
    return values


def parse_methods(text: str) -> list[tuple[str, dict[str, Any]]]:
    """Parse ssarx,iem or ssarx(past=30, future=20),ssarx: names, with settings of their own in brackets."""
    methods = []
    for part in re.split(r",(?![^(\[{]*[)\]}])", text):
        match = re.fullmatch(r"\s*(\w+)\s*(?:\((.*)\))?\s*", part)
        if match is None:
            raise ExciteError(f"--methods {text}: '{part}'; give names, or names with settings as ssarx(past=30)")
        own = re.split(r",(?![^\[{\"]*[\]}\"])", match[2]) if match[2] else []
        methods.append((match[1], assignments(tuple(pair.strip() for pair in own), "--methods")))
    return methods


def parse_orders(text: str) -> list[int]:
    """Parse 4, 2,4,8 or 2:10 (both ends included)."""
    try:
        if ":" in text:
            first, last = (int(part) for part in text.split(":"))
            orders: Sequence[int] = range(first, last + 1)
        else:
            orders = [int(part) for part in text.split(",")]
    except ValueError:
        orders = []
    if len(orders) > MOST_ORDERS:
        raise ExciteError(f"--orders {text}: {len(orders)} orders; give at most {MOST_ORDERS}")
    if not orders or min(orders) < 1:
        raise ExciteError(f"--orders {text}: give positive whole numbers as 4, or 2,4,8, or 2:10")
    return sorted(set(orders))
