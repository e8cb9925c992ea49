"""Registries: one line per entry of ours, and entry points of installed packages beside them."""

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from excite.errors import ExciteError, did_you_mean

Entry = TypeVar("Entry")


class Registry(Generic[Entry]):
    """Names and what stands behind them, loaded when asked for.

    A plug-in is an entry point of the group ``excite.<things>`` in an installed package. Its object is checked by
    `accepts`, which returns what is wrong with it, or None. A plug-in that fails to import, that is not accepted, or
    whose name is taken, is left out; `skipped` says why, and `excite doctor` tells.

    Parameters
    ----------
    thing : what one entry is called in messages, "method"; the group of entry points is "excite.methods".
    ours : name -> "module:attribute".
    accepts : returns why an object cannot be an entry, or None.
    """

    def __init__(self, thing: str, ours: Mapping[str, str], accepts: Callable[[Any], str | None] | None = None) -> None:
        self.thing, self.ours, self.accepts = thing, dict(ours), accepts

    @property
    def group(self) -> str:
        """Group of entry points."""
        return f"excite.{self.thing.replace(' ', '_')}s"

    @cached_property
    def _plugins(self) -> tuple[dict[str, EntryPoint], dict[str, str]]:
        found: dict[str, EntryPoint] = {}
        skipped: dict[str, str] = {}
        for point in sorted(entry_points(group=self.group), key=lambda point: (point.name, point.value)):
            if point.name in self.ours or point.name in found:
                owner = found[point.name].value if point.name in found else "excite"
                skipped[f"{point.name} ({point.value})"] = f"the name is taken by {owner}; rename the entry point"
            else:
                found[point.name] = point
        for name in list(found):
            try:
                reason = self.accepts and self.accepts(found[name].load())
            except Exception as error:  # a plug-in may raise anything; doctor tells
                reason = f"{type(error).__name__}: {error}"
            if reason:
                skipped[f"{name} ({found.pop(name).value})"] = reason
        return found, skipped

    @property
    def skipped(self) -> dict[str, str]:
        """Plug-ins that were left out, with the reason."""
        return dict(self._plugins[1])

    def distribution(self, name: str) -> tuple[str, str] | None:
        """Name and version of the installed package that a plug-in comes from, None for an entry of ours."""
        point = self._plugins[0].get(name)
        return None if point is None or point.dist is None else (point.dist.name, point.dist.version)

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self.ours, *self._plugins[0]}))

    def __len__(self) -> int:
        return len(self.ours) + len(self._plugins[0])

    def __contains__(self, name: object) -> bool:
        return name in self.ours or name in self._plugins[0]

    def __getitem__(self, name: str) -> Entry:
        """Return what stands behind a name; an unknown one is refused with the nearest known."""
        if name in self.ours:
            module, attribute = self.ours[name].split(":")
            return getattr(import_module(module), attribute)
        if name in self._plugins[0]:
            return self._plugins[0][name].load()
        raise ExciteError(f"{self.thing} '{name}' does not exist; {did_you_mean(str(name), self)}")
