"""A mapping that cannot be changed and that travels: it pickles, copies and compares."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any


class Frozen(Mapping[str, Any]):
    """A read-only mapping; `types.MappingProxyType` would do, if it could be pickled or copied."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Any] | Iterable[tuple[str, Any]] = (), /, **more: Any) -> None:
        object.__setattr__(self, "_items", dict(items, **more))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Frozen mapping cannot be changed ({name})")

    def __getitem__(self, key: str) -> Any:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)

    def __reduce__(self) -> tuple:
        return Frozen, (self._items,)
