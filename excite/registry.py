"""Registries: one line per entry of ours, and entry points of installed packages beside them."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout, suppress
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, distributions, entry_points
from typing import Any, Generic, TypeVar

from excite.digest import code_digest
from excite.errors import ExciteError, did_you_mean, in_words

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
    named : an object with a `name` must have that of its entry point.
    """

    def __init__(
        self,
        thing: str,
        ours: Mapping[str, str],
        accepts: Callable[[Any], str | None] | None = None,
        *,
        named: bool = False,
    ) -> None:
        self.thing, self.ours, self.accepts, self.named = thing, dict(ours), accepts, named

    @property
    def group(self) -> str:
        """Group of entry points."""
        return f"excite.{self.thing.replace(' ', '_')}s"

    @cached_property
    def _plugins(self) -> tuple[dict[str, EntryPoint], dict[str, str]]:
        found: dict[str, EntryPoint] = {}
        skipped: dict[str, str] = {}
        for point in sorted(_installed(self.group), key=lambda point: (point.name, point.value, _owner(point))):
            name = point.name
            if name in self.ours or name in found:
                owner = _owner(found[name]) if name in found else "excite"
                reason: str | None = f"the name is taken by {owner}; rename the entry point"
            else:
                reason = self._refused(point)
            if reason is None:
                found[name] = point
                continue
            place = f"{name} ({point.value})"
            skipped[place if place not in skipped else f"{name} ({point.value}, {_owner(point)})"] = reason
        return found, skipped

    def _refused(self, point: EntryPoint) -> str | None:
        """Load an entry point and return why it cannot be an entry, or None."""
        try:
            with redirect_stdout(sys.stderr):  # stdout is for results
                loaded = point.load()
            own = getattr(loaded, "name", point.name) if self.named else point.name
            if own != point.name:
                return f"it calls itself {own!r}; give the entry point that name"
            return self.accepts(loaded) if self.accepts else None
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plug-in may raise anything, and may try to exit; doctor tells
            return in_words(error)

    @property
    def skipped(self) -> dict[str, str]:
        """Plug-ins that were left out, with the reason."""
        return dict(self._plugins[1])

    def distribution(self, name: str) -> tuple[str, str] | None:
        """Name and version of the installed package that a plug-in comes from, None for an entry of ours."""
        point = self._plugins[0].get(name)
        return None if point is None or point.dist is None else (point.dist.name, point.dist.version)

    def made_by(self, name: str) -> tuple[str, ...] | None:
        """What a result of a plug-in depends on: package, version, digest of its source. None for an entry of ours."""
        point = self._plugins[0].get(name)
        return None if point is None else (*(self.distribution(name) or ()), code_digest(point.module.split(".")[0]))

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


def _installed(group: str) -> list[EntryPoint]:
    """Return the entry points of a group; a package whose list of them cannot be read has none."""
    try:
        return list(entry_points(group=group))
    except Exception:  # one damaged package must not take the others with it
        found: dict[str, list[EntryPoint]] = {}
        for distribution in distributions():
            with suppress(Exception):
                found.setdefault(distribution.name, list(distribution.entry_points))
        return [point for points in found.values() for point in points if point.group == group]


def _owner(point: EntryPoint) -> str:
    """Return the package that an entry point comes from."""
    return point.value if point.dist is None else f"{point.dist.name} ({point.value})"
