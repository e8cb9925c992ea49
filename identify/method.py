"""What an identification method is: an immutable, hashable description of what it takes, condenses and makes of it."""

import types
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from enum import Enum
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.frozen import Frozen
from identify.data.records import Data, Kind, Records
from identify.estimate import Estimate

Taken = TypeVar("Taken", bound=Data)  # what a method takes: Records, FrequencyResponse, or either
Order = TypeVar("Order", bound=int | None)  # int; None for a method without an order


class Need(Enum):
    """What a method needs beside inputs and outputs; the value names it in messages."""

    REFERENCE = "the reference"
    CONTROLLER = "the controller"


@dataclass(frozen=True)
class OwnCompression:
    """The compression that a method alone knows."""

    method: "Method"

    def __call__(self, data: Data) -> Any:
        """Condense the data as the method says."""
        return self.method.compress(data)


@dataclass(frozen=True)
class Method(ABC, Generic[Taken, Order]):
    """One identification method; its fields are its settings, under the literature's names.

    Settings are checked by their annotation and by the field's metadata: "minimum" of a number, "choices" of a text;
    "meaning" explains a setting in lists. A list becomes a tuple, so that a method can be hashed: equal methods prepare
    and find the same. A setting may be another Method, which makes the method a wrapper. `Method[Records, int]` takes
    records and has an order.

    name, summary : for lists; takes : kinds of data; needs : what the records must hold beside u and y;
    consistent_in_closed_loop : when the input depends on past outputs through feedback; order_is : "states", "lags", or
    None for a method without an order; asymptotic : exact only as the records grow, even without noise (sample
    covariances have ends); input_delay : known dead time of all inputs in samples, where a method has that setting;
    response : the method by which one that takes frequency responses alone makes one of records, where it has that setting;
    conformance_exceptions : name of a conformance check -> why the method does not pass it.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.SERIES})
    needs: ClassVar[frozenset[Need]] = frozenset()
    consistent_in_closed_loop: ClassVar[bool] = False
    order_is: ClassVar[str | None] = "states"
    asymptotic: ClassVar[bool] = False
    input_delay = 0  # without an annotation: a setting of some methods alone
    response: ClassVar["Method | None"] = None
    conformance_exceptions: ClassVar[Mapping[str, str]] = Frozen()

    def __post_init__(self) -> None:
        types_of = setting_types(type(self))
        for setting in fields(self):
            place = f"{self.name}.{setting.name}"
            value = _hashable(getattr(self, setting.name), place)
            _check_type(value, types_of[setting.name], setting.metadata, place)
            object.__setattr__(self, setting.name, value)

    @property
    def compression(self) -> Callable[[Taken], Any]:
        """How data are condensed: a hashable callable. Equal ones are computed once for all methods and orders."""
        return OwnCompression(self)

    def compress(self, data: Taken) -> Any:
        """Condense the data, once for all orders; the data themselves unless a method says otherwise."""
        return data

    def singular_values(self, compressed: Any) -> np.ndarray | None:
        """Return the singular values (k,) from which the order can be judged, or None where the method has none."""
        return None

    @abstractmethod
    def realize(self, compressed: Any, order: Order, data: Taken) -> Estimate:
        """Return the estimate of one order; `data` are those that were compressed."""

    def unsupported(self, data: Taken) -> str | None:
        """Return why these settings cannot take the data, which are of a kind that the method takes, or None."""
        return None

    def span(self, order: int | None) -> int | None:
        """Consecutive samples that one equation takes: records split into parts at gaps; None: gaps are not taken."""
        return None

    def required_excitation(self, order: int | None) -> int:
        """Order of persistency of u without which the estimate does not exist (a necessary condition); 0: none."""
        return 0

    def sufficient_excitation(self, order: int | None) -> int:
        """Order of persistency of u that guarantees identifiability in open loop (a sufficient condition)."""
        return self.required_excitation(order)

    def largest_order(self, data: Taken) -> int:
        """Largest order that these settings and data allow."""
        raise NotImplementedError(f"{self.name}: has an order, and must say how large it may be")

    def example(self, noise: float, length: int) -> tuple[tuple[Any, ...], Any] | None:
        """Return data and truth by which the conformance suite tests the method; None: the usual ones of its kind.

        noise : standard deviation; length : in units of the usual record.
        """
        return None

    def settings(self) -> dict[str, Any]:
        """Return the settings as plain values; a wrapped method as a table with its name under "method"."""
        return {setting.name: plain_setting(getattr(self, setting.name)) for setting in fields(self)}

    @classmethod
    def setting_names(cls) -> tuple[str, ...]:
        """Names of the settings."""
        return tuple(setting.name for setting in fields(cls))


@cache
def setting_types(kind: type[Method]) -> dict[str, Any]:
    """Return setting -> its annotation, also where the module postpones them (from __future__ import annotations)."""
    found = {setting.name: setting.type for setting in fields(kind)}
    if any(isinstance(each, str) for each in found.values()):
        with suppress(Exception):  # a name that is there for type checkers alone: these settings stay unchecked
            hints = get_type_hints(kind)
            found = {name: hints[name] for name in found}
    return found


def plain_setting(value: Any) -> Any:
    """Return a setting as files hold it."""
    if isinstance(value, Method):
        return {"method": value.name, **value.settings()}
    if isinstance(value, tuple):
        return [plain_setting(each) for each in value]
    if isinstance(value, Enum):
        return value.value
    return value if value is None or isinstance(value, (bool, int, float, str)) else getattr(value, "name", repr(value))


def parts_of(data: Records, method: Method, order: int | None = 1) -> tuple:
    """Return the gap-free parts that the method's equations can use."""
    return data.parts(method.span(order) or 1)


def _hashable(value: Any, place: str) -> Any:
    """Return a value in hashable form: lists as tuples."""
    if isinstance(value, (list, tuple)):
        return tuple(_hashable(each, f"{place}[{i}]") for i, each in enumerate(value))
    if isinstance(value, np.ndarray):
        return _hashable(value.tolist(), place)
    if isinstance(value, np.generic):
        return value.item()
    try:
        hash(value)
    except Exception:
        raise ExciteError(
            f"{place}: a {type(value).__name__} cannot be a setting; give numbers, text, lists or methods"
        ) from None
    return value


def _check_type(value: Any, wanted: Any, metadata: Mapping[str, Any], place: str) -> None:
    """Refuse a value that does not fit the annotation of a setting."""
    if get_origin(wanted) in (types.UnionType, Union):
        if value is None and type(None) in get_args(wanted):
            return
        errors = []
        for each in get_args(wanted):
            try:
                return _check_type(value, each, metadata, place)
            except ExciteError as error:
                errors.append(error)
        raise errors[0]
    if get_origin(wanted) is tuple and isinstance(value, tuple):
        for i, each in enumerate(value):
            _check_type(each, get_args(wanted)[0], metadata, f"{place}[{i}]")
        return
    if remedy := _remedy(value, wanted, metadata):
        raise ExciteError(f"{place}: {value!r}; {remedy}")


def _remedy(value: Any, wanted: Any, metadata: Mapping[str, Any]) -> str | None:
    """Return what to give instead of the value, or None where it fits."""
    least = metadata.get("minimum", 1)
    if wanted is int:
        whole = isinstance(value, int) and not isinstance(value, bool)
        return None if whole and value >= least else f"give a whole number of at least {least}"
    if wanted is float:
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)
        fits = number and value >= metadata.get("minimum", -np.inf)
        return None if fits else "give a finite number" + (f" of at least {least}" if "minimum" in metadata else "")
    if wanted is bool:
        return None if isinstance(value, bool) else "give true or false"
    if wanted is str:
        choices = metadata.get("choices", ())
        if isinstance(value, str) and (not choices or value in choices):
            return None
        return did_you_mean(str(value), choices) if choices else "give text"
    kind = get_origin(wanted) or wanted
    if isinstance(kind, type) and not isinstance(value, kind):
        words: dict[type, str] = {tuple: "give a list", Method: "give the name of a method"}
        return words.get(kind, f"give a {kind.__name__}")
    return None


def with_settings(method: Method, **changes: Any) -> Method:
    """Return the method with some settings changed."""
    return type(method)(**{name: getattr(method, name) for name in method.setting_names()} | changes)
