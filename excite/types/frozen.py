"""What makes types travel: a mapping and arrays that cannot be changed, here, in a copy, or in another process."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np


class ReadOnlyArrays:
    """A type whose arrays are read-only, and stay so when it is copied or pickled; NumPy forgets it by itself."""

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)


class Frozen(Mapping[str, Any]):
    """A read-only mapping; `types.MappingProxyType` would do, if it could be pickled or copied."""

    __slots__ = ("_items",)
    _items: dict[str, Any]

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
