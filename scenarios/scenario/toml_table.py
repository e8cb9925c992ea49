"""One TOML table being read: typed access by key, and refusal of whatever is left over."""

import math
import re
from collections.abc import Callable
from typing import Any

from excite.arguments import LARGEST_WHOLE, bad, is_number, is_whole
from excite.errors import ExciteError, did_you_mean

NUMBER = (int, float)
RENAMED = {"setting": "view"}  # what scenario files of before call otherwise
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)
_NAMES = {
    str: "text",
    int: "a whole number",
    float: "a finite number",
    bool: "true or false",
    list: "a list",
    dict: "a table",
}


class TomlTable:
    """A table with the place it stands at; `take` what is known, then `done` refuses the rest."""

    def __init__(self, values: Any, place: str) -> None:
        if not isinstance(values, dict):
            raise bad(place.rstrip("."), values, "give a table, with a [header] of its own")
        self.values, self.place = dict(values), place
        self.known: list[str] = []

    def take(self, key: str, kind: type | tuple[type, ...], default: Any = ..., check: Callable | None = None) -> Any:
        """Return the value of a key, of one of the types given; `check` returns the remedy for a bad value, or None."""
        self.known.append(key)
        if key not in self.values:
            if default is ...:
                raise ExciteError(f"{self.place}{key}: missing; it is required")
            return default
        value = self.values.pop(key)
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not is_a(value, kinds):
            names = list(dict.fromkeys(_NAMES[k] for k in kinds if k is not int or float not in kinds))
            raise bad(f"{self.place}{key}", value, f"give {' or '.join(names)}")
        if check is not None and (remedy := check(value)):
            raise bad(f"{self.place}{key}", value, remedy)
        return value

    def items(self, key: str, kind: type | tuple[type, ...], default: list, check: Callable | None = None) -> list:
        """Return a list of at least one value, each of one of the types given."""
        values = self.take(key, list, default)
        if not values and default:
            raise ExciteError(f"{self.place}{key}: is empty; give at least one, or drop the key")
        row = TomlTable({f"{key}[{i}]": value for i, value in enumerate(values)}, self.place)
        return [row.take(each, kind, check=check) for each in list(row.values)]

    def tables(self, key: str) -> list["TomlTable"]:
        """Return the tables of an array of tables, each with its number in its place."""
        rows = self.take(key, list, [])
        return [TomlTable(row, f"{self.place}{key}[{i}].") for i, row in enumerate(rows)]

    def table(self, key: str) -> "TomlTable":
        """Return a table inside this one, empty when it is not there."""
        return TomlTable(self.take(key, dict, {}), f"{self.place}{key}.")

    def done(self) -> None:
        """Refuse the keys that nobody took."""
        for key in self.values:
            if key in RENAMED and RENAMED[key] in self.known:
                raise ExciteError(f"{self.place}{key}: is called '{RENAMED[key]}' now; rename it")
            raise ExciteError(f"{self.place}{key}: unknown key; {did_you_mean(key, self.known)}")


def is_a(value: Any, kinds: tuple[type, ...]) -> bool:
    """Whether a value has one of the types; true and false are no numbers, and numbers are finite, of 64 bits."""
    if isinstance(value, bool):
        return bool in kinds
    beyond = is_number(value) and not abs(value) < (LARGEST_WHOLE if is_whole(value) else math.inf)
    return isinstance(value, kinds) and not beyond


def at_least(least: float) -> Callable[[Any], str | None]:
    """Return a check for `TomlTable.take`."""
    return lambda value: None if value >= least else f"give at least {least:g}"


def file_name(value: str) -> str | None:
    """Return the remedy for a name that no file should have, or None."""
    if RESERVED.fullmatch(value):
        return "Windows takes this name for a device: choose another, since it names files"
    return None if re.fullmatch(r"\w[\w-]{0,59}", value) else "use at most 60 letters, digits, _ and -: it names files"
