"""What a scenario identifies, and how: [[view]] and [[method]]."""

from excite.errors import ExciteError, did_you_mean, placed
from excite.types.recording import Roles
from identify.orders.rules import ORDER_RULES
from identify.registry import load_method, method_class
from plants.plant import Plant
from scenarios.scenario.spec import MethodSpec, ViewSpec
from scenarios.scenario.toml_table import NUMBER, TomlTable, file_name


def read_views(top: TomlTable, plant: Plant, inject: str) -> tuple[ViewSpec, ...]:
    """Read [[view]], each with a name of its own."""
    if "setting" in top.values:
        raise ExciteError(
            f"{top.place}setting: is called 'view' now, also in [[method]]; rename [[setting]] to [[view]]"
        )
    views = tuple(_view(row, plant, inject) for row in top.tables("view"))
    if not views:
        known = ", ".join(plant.injections[inject].views)
        raise ExciteError(f"{top.place}view: missing; give at least one [[view]] with a name, such as {known}")
    names = [view.name.casefold() for view in views]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ExciteError(f"{top.place}view[{i}].name: '{views[i].name}' is given twice; each view needs its own")
    return views


def read_methods(top: TomlTable, views: list[str]) -> tuple[MethodSpec, ...]:
    """Read [[method]], at least one for every view."""
    methods = tuple(spec for row in top.tables("method") for spec in _methods(row, views))
    if not methods:
        raise ExciteError(f"{top.place}method: missing; give at least one [[method]]")
    _refuse_twins(methods)
    for i, view in enumerate(views):
        if view not in [m.view for m in methods]:
            raise ExciteError(f"{top.place}view[{i}]: no method for '{view}'; give it one, or drop the view")
    return methods


def _view(table: TomlTable, plant: Plant, inject: str) -> ViewSpec:
    name = table.take("name", str, check=file_name)
    given = {key: tuple(table.items(key, str, [])) for key in ("inputs", "outputs", "reference")}
    decimate = table.take("decimate", (int, str), "auto")
    if (isinstance(decimate, str) and decimate != "auto") or (isinstance(decimate, int) and decimate < 1):
        raise ExciteError(f'{table.place}decimate: {decimate!r}; give a whole number of at least 1, or "auto"')
    coherence = table.take("coherence", NUMBER, None, lambda c: None if 0 < c <= 1 else "give a number from 0 to 1")
    table.done()
    if not any(given.values()):
        known = plant.injections[inject].views
        if name not in known:
            raise ExciteError(
                f"{table.place}name: '{name}' is no view of plant {plant.name} excited at '{inject}'; "
                f"{did_you_mean(name, known)} Or give inputs and outputs."
            )
        return ViewSpec(name, known[name], True, decimate, coherence)
    for key in ("inputs", "outputs"):
        if not given[key]:
            raise ExciteError(f"{table.place}{key}: missing; a view with its own roles needs inputs and outputs")
    for channel in given["outputs"]:
        if channel in given["inputs"]:
            raise ExciteError(f"{table.place}outputs: '{channel}' is an input too; drop it from one of the two")
    if decimate == "auto":
        raise ExciteError(
            f"{table.place}decimate: missing; a view with its own roles has no truth whose poles could choose it"
        )
    # What enters the plant from outside is free of feedback; everything else in a closed loop depends on the outputs.
    outside = {c.name for c in plant.injections[inject].channels}
    closed = any(roles.closed for roles in plant.injections[inject].views.values()) and not outside.issuperset(
        given["inputs"]
    )
    return ViewSpec(
        name, Roles(given["inputs"], given["outputs"], given["reference"], closed=closed), False, decimate, coherence
    )


def _methods(table: TomlTable, views: list[str]) -> list[MethodSpec]:
    name = table.take("name", str)
    with placed(f"{table.place}name"):
        method_class(name)
    label = table.take("label", str, None, _label)
    order = table.take("order", (int, str), None, _order)
    orders = table.items("orders", (int, str), [], _order)
    if method_class(name).order_is is None:
        if order is not None or orders:
            raise ExciteError(f"{table.place}order: {name} has no order; drop the key")
        orders = [None]
    elif (order is None) == (not orders):
        raise ExciteError(f"{table.place}order: give either order, a whole number, or orders, a list of them")
    options = table.take("settings", dict, {})
    chosen = table.take("view", (str, list), views)
    table.done()
    chosen = [chosen] if isinstance(chosen, str) else chosen
    for view in chosen or [""]:
        if view not in views:
            raise ExciteError(f"{table.place}view: {view!r} is not defined; {did_you_mean(str(view), views)}")
    with placed(f"{table.place}settings"):
        load_method(name, **options)
    place = table.place.rstrip(".")
    return [MethodSpec(name, view, tuple(orders or [order]), options, place, label) for view in chosen]


def _order(value: int | str) -> str | None:
    """Return the remedy for what is no order: a whole number of at least 1, or the name of a rule."""
    if isinstance(value, str):
        return None if value in ORDER_RULES else f"{did_you_mean(value, ORDER_RULES)} Or give a whole number."
    return None if value >= 1 else "give at least 1"


def _label(value: str) -> str | None:
    if value == "best":
        return "it stands for the best method in [expect]; choose another"
    fits = value == value.strip() and 0 < len(value) <= 60 and "." not in value and value.isprintable()
    return None if fits else "use at most 60 characters, without dots and outer spaces"


def _refuse_twins(methods: tuple[MethodSpec, ...]) -> None:
    """Refuse a method that stands twice in a view at one order with the same settings, and a label for two methods."""
    seen: list[tuple] = []
    labels: dict[tuple[str, str], tuple] = {}
    for m in methods:
        for n in m.orders:
            mine = (m.name, dict(m.settings), m.view, n)
            if mine in seen:
                raise ExciteError(
                    f"{m.place}: {m.name} of order {n} stands in view '{m.view}' twice; drop one, or change its settings"
                )
            seen.append(mine)
        if m.label is not None and labels.setdefault((m.label, m.view), mine[:2]) != mine[:2]:
            raise ExciteError(f"{m.place}.label: '{m.label}' stands for two methods in view '{m.view}'; give another")
