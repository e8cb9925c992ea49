"""What can be told of a method: what it is for, and what its settings mean."""

from dataclasses import MISSING, fields, is_dataclass
from typing import Any

from identify.method import Method
from identify.registry import method_class


def describe_method(name: str) -> dict[str, Any]:
    """Return a description of a method in plain values.

    Keys: summary, one line; closed_loop, whether it is consistent there; settings: name -> default, None where it must be
    given; meanings: name -> words, for the settings that methods share; description, which explains its own settings.
    """
    kind = method_class(name)
    return {
        "summary": kind.summary,
        "closed_loop": kind.consistent_in_closed_loop,
        "settings": {f.name: None if f.default is MISSING else f.default for f in fields(kind)},
        "meanings": {f.name: meaning for f in fields(kind) if (meaning := _meaning(kind, f.name))},
        "description": "\n".join(line.removeprefix("    ") for line in (kind.__doc__ or "").strip().splitlines()),
    }


def _meaning(kind: type[Method], setting: str) -> str:
    """Return what a setting means where methods share it."""
    declared = (f for base in kind.__mro__ if is_dataclass(base) for f in fields(base) if f.name == setting)
    return next((f.metadata["meaning"] for f in declared if "meaning" in f.metadata), "")
