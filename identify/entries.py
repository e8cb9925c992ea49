"""What a comparison compares: methods with settings and orders, under labels that differ."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from excite.errors import ExciteError
from identify.method import Method
from identify.metrics.registry import METRICS
from identify.orders.rules import ORDER_RULES
from identify.registry import METHODS, load_method
from identify.steps.regions import REGIONS


@dataclass(frozen=True)
class Entry:
    """A method with its settings, at some orders, under the label that tables show.

    orders : whole numbers or rules ("bic"); (None,) leaves the choice to the method.
    """

    label: str
    method: Method
    orders: tuple[int | str | None, ...] = (None,)


def entries(
    methods: str | Method | Entry | Iterable[str | Method | Entry],
    orders: int | str | Sequence[int | str | None] | None = None,
) -> tuple[Entry, ...]:
    """Return entries with labels that differ: a method's name, followed by the settings that set twins apart.

    orders : of the methods that come without any; a method without an order makes one row.

    Raises
    ------
    ExciteError for what is no method, and where one stands there twice with the same settings and order.
    """
    methods = [methods] if isinstance(methods, (str, Method, Entry)) else methods
    orders = [orders] if isinstance(orders, (int, str)) else orders
    found = []
    for each in methods:
        if isinstance(each, Entry):
            found.append(each)
            continue
        method = load_method(each) if isinstance(each, str) else each
        if not isinstance(method, Method):
            raise ExciteError(
                f"methods: {each!r} is none; give names, Methods with their settings, or Entries with labels"
            )
        asked = (None,) if method.order_is is None or not orders else tuple(dict.fromkeys(orders))
        found.append(Entry(method.name, method, asked))
    _refuse_twins(found)
    return tuple(_labelled(found))


def _refuse_twins(found: Sequence[Entry]) -> None:
    seen: set[tuple[Method, int | str | None]] = set()
    for entry in found:
        for order in entry.orders:
            if (entry.method, order) in seen:
                at = "" if order is None else f" of order {order}"
                raise ExciteError(
                    f"{entry.label}: {entry.method.name}{at} stands there twice with the same settings; drop one, or change "
                    "its settings"
                )
            seen.add((entry.method, order))


def _labelled(found: Sequence[Entry]) -> Iterator[Entry]:
    taken: set[tuple[str, int | str | None]] = set()
    for entry in found:
        twins = [other.method for other in found if other.label == entry.label and other.method != entry.method]
        label = entry.label
        if twins:
            mine = entry.method.settings()
            apart = {k: v for k, v in mine.items() if any(other.settings().get(k) != v for other in twins)}
            label = " ".join([entry.label, *(f"{name}={_short(value)}" for name, value in apart.items())])
        base, count = label, 2
        while any((label, order) in taken for order in entry.orders):
            label, count = f"{base} ({count})", count + 1
        taken |= {(label, order) for order in entry.orders}
        yield Entry(label, entry.method, entry.orders)


def _short(value: Any) -> str:
    return value["method"] if isinstance(value, Mapping) else str(value)


def packages_of(method: Method, order: int | str | None) -> list[tuple[str, ...]]:
    """Return name, version and source digest of the installed packages, beside ours, on which a trial rests.

    Those are the packages of the method, of the methods and regions that are its settings, of the rule that chooses the
    order, and of all metrics.
    """
    found = {METRICS.made_by(name) for name in METRICS} | _packages(method)
    if isinstance(order, str):
        found.add(ORDER_RULES.made_by(order))
    return sorted(package for package in found if package is not None)


def _packages(method: Method) -> set[tuple[str, ...] | None]:
    found = {METHODS.made_by(method.name)}
    for setting in fields(method):
        value = getattr(method, setting.name)
        found |= _packages(value) if isinstance(value, Method) else {REGIONS.made_by(str(value))}
    return found
