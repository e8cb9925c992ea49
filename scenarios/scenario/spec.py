"""Scenario files: TOML in, a checked `Scenario` out; every error names file, key path, value and remedy."""

import inspect
import operator
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.errors import DesignRefused, ExciteError, did_you_mean, placed
from excite.generators import GENERATORS, in_sequence, rest
from excite.types.recording import Roles
from excite.types.signal import Signal
from identify.compare import STATISTICS
from identify.method import Method
from identify.metrics.registry import find_metric, list_metrics
from identify.orders.rules import ORDER_RULES
from identify.registry import load_method, method_class
from plants.plant import Plant
from plants.registry import load_plant
from scenarios.scenario.toml_table import NUMBER, TomlTable, at_least, is_a

LIBRARY = Path(__file__).parents[1] / "library"
COMPARISONS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
BOUND = re.compile(r"\s*(<=|>=|<|>)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)
FIXED = ("channels", "seed")  # arguments of a generator that a run decides itself


@dataclass(frozen=True)
class ViewSpec:
    """One identification view: roles on the recording, and how much to decimate ("auto": by the design rule).

    coherence : keep the outputs whose mean coherence with what was played, over the view's band, is at least this.
    """

    name: str
    roles: Roles
    plants_own: bool
    decimate: int | str = "auto"
    coherence: float | None = None


@dataclass(frozen=True)
class MethodSpec:
    """One method with its settings; horizons that are not given follow from the design rule.

    orders : whole numbers or rules ("bic"); (None,) for a method without an order; label : what tables call it, by default
    its name, with the settings that set twins apart; place : its key path.
    """

    name: str
    view: str
    orders: tuple[int | str | None, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
    place: str = "method"
    label: str | None = None

    def build(self, horizons: Mapping[str, int]) -> Method:
        """Return the method with the horizons of the design rule filled in where the scenario gives none."""
        return load_method(self.name, **{**horizons, **self.settings})


@dataclass(frozen=True)
class Expectation:
    """`view.method.metric.statistic` compared with a number."""

    key: str
    view: str
    method: str
    metric: str
    statistic: str
    comparison: str
    bound: float

    def holds(self, value: float) -> bool:
        """Whether the value meets the bound; NaN never does."""
        return bool(COMPARISONS[self.comparison](value, self.bound))


@dataclass(frozen=True, eq=False)
class Scenario:
    """A checked scenario. `source` is the plain dictionary it came from, `file` its file, `plant` the configured plant."""

    name: str
    seed: int
    description: str
    plant: Plant
    preset: str | None
    parameters: Mapping[str, Any]
    noise: bool | Mapping[str, float]
    inject: str
    excitation: tuple[Mapping[str, Any], ...]
    views: tuple[ViewSpec, ...]
    methods: tuple[MethodSpec, ...]
    estimation_runs: int
    validation_runs: int
    discard_s: float
    rank_by: tuple[str, ...]
    bands_hz: Mapping[str, tuple[float, float]]
    horizons_s: tuple[float, ...]
    expect: tuple[Expectation, ...]
    source: Mapping[str, Any]
    file: str = "scenario"

    def design(self, seed: int) -> Signal:
        """Return the excitation for a realisation seed."""
        return play(self.excitation, [str(c) for c in self.plant.injections[self.inject].channels], seed)


def shipped() -> dict[str, Path]:
    """Scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted(LIBRARY.glob("*.toml"))}


def load_scenario(name_or_path: str, runs: int | None = None) -> Scenario:
    """Read and check a scenario file or a shipped scenario; `runs` overrides data.estimation_runs."""
    path, file, known = Path(name_or_path), name_or_path, shipped()
    if not path.is_file():
        if name_or_path not in known:
            raise ExciteError(
                f"scenario '{name_or_path}' is neither a file nor shipped; {did_you_mean(name_or_path, known)}"
            )
        path, file = known[name_or_path], f"{name_or_path}.toml"
    try:
        source = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ExciteError(f"{file}: not a valid TOML file ({error}); mend it at that place") from None
    except OSError as error:
        raise ExciteError(f"{file}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if runs is not None and isinstance(source.setdefault("data", {}), dict):
        source["data"]["estimation_runs"] = runs
    return check_scenario(source, file)


def _file_name(value: str) -> str | None:
    if RESERVED.fullmatch(value):
        return "Windows takes this name for a device: choose another, since it names files"
    return None if re.fullmatch(r"\w[\w-]{0,59}", value) else "use at most 60 letters, digits, _ and -: it names files"


def check_scenario(source: Mapping[str, Any], file: str) -> Scenario:
    """Check a scenario dictionary key by key; nothing is simulated."""
    top = TomlTable(source, f"{file}: ")
    name = top.take("name", str, check=_file_name)
    seed = top.take("seed", int, 0, at_least(0))
    description = top.take("description", str, "")

    table = top.table("plant")
    given = table.take("name", str), table.take("preset", str, None), table.take("parameters", dict, {})
    table.done()
    with placed(f"{file}: plant"):
        plant = load_plant(given[0], preset=given[1], parameters=given[2])

    table = top.table("noise")
    on = table.take("enabled", bool, True)
    levels = {}
    for key in plant.noise_sources:
        value = table.take(key, NUMBER, None, at_least(0))
        if value is not None:
            levels[key] = float(value)
    table.done()

    table = top.table("loop")
    inject = table.take("inject", str, next(iter(plant.injections)))
    if inject not in plant.injections:
        raise ExciteError(f"{table.place}inject: '{inject}'; {did_you_mean(inject, plant.injections)}")
    table.done()

    excitation = read_excitation(top)

    table = top.table("data")
    estimation_runs = table.take("estimation_runs", int, 1, at_least(1))
    validation_runs = table.take("validation_runs", int, 1, at_least(1))
    discard_s = float(table.take("discard_s", NUMBER, 0.0, at_least(0)))
    table.done()

    if "setting" in top.values:
        raise ExciteError(f"{file}: setting: is called 'view' now, also in [[method]]; rename [[setting]] to [[view]]")
    views = tuple(_view(row, plant, inject) for row in top.tables("view"))
    if not views:
        known = ", ".join(plant.injections[inject].views)
        raise ExciteError(f"{file}: view: missing; give at least one [[view]] with a name, such as {known}")
    names = [s.name for s in views]
    for i, name_i in enumerate(names):
        if name_i.casefold() in [n.casefold() for n in names[:i]]:
            raise ExciteError(f"{file}: view[{i}].name: '{name_i}' is given twice; each view needs its own")
    methods = tuple(spec for row in top.tables("method") for spec in _methods(row, names))
    if not methods:
        raise ExciteError(f"{file}: method: missing; give at least one [[method]]")
    _refuse_twins(methods)
    for i, view in enumerate(names):
        if view not in [m.view for m in methods]:
            raise ExciteError(f"{file}: view[{i}]: no method for '{view}'; give it one, or drop the view")

    rank_by, horizons_s, bands_hz = _score(top.table("score"), views)

    table = top.table("expect")
    expect = tuple(_expectation(key, value, table.place, names, methods) for key, value in table.values.items())
    top.done()
    scenario = Scenario(
        name=name,
        seed=seed,
        description=description,
        plant=plant,
        preset=given[1],
        parameters=given[2],
        noise=levels if (on and levels) else on,
        inject=inject,
        excitation=excitation,
        views=views,
        methods=methods,
        estimation_runs=estimation_runs,
        validation_runs=validation_runs,
        discard_s=discard_s,
        rank_by=rank_by,
        bands_hz=bands_hz,
        horizons_s=horizons_s,
        expect=expect,
        source=source,
        file=file,
    )
    return scenario


def check_signal(scenario: Scenario, signal: Signal) -> None:
    """Refuse an excitation that leaves the plant's limits, and discards and horizons that it does not bear."""
    file = scenario.file
    check_limits(scenario, signal, f"{file}: excitation")
    left_s = signal.duration_s - scenario.discard_s
    if left_s <= 0:
        raise ExciteError(
            f"{file}: data.discard_s: {scenario.discard_s:g} s discards the whole record of {signal.duration_s:g} s; discard less"
        )
    for i, horizon in enumerate(scenario.horizons_s):
        if horizon >= left_s:
            raise ExciteError(
                f"{file}: score.horizons_s[{i}]: {horizon:g} s is beyond the {left_s:g} s of data; shorten it"
            )


def check_limits(scenario: Scenario, signal: Signal, place: str) -> None:
    """Refuse a design whose amplitude leaves the limits of the place where it enters the plant."""
    injection = scenario.plant.injections[scenario.inject]
    low, high = signal.u.min(0), signal.u.max(0)
    for channel, limits, least, most in zip(injection.channels, injection.limits, low, high, strict=True):
        if least < limits[0] or most > limits[1]:
            worst = least if least < limits[0] else most
            raise DesignRefused(
                f"{place}: channel '{channel.name}' reaches {worst:g} {channel.unit}, outside the plant's limits "
                f"{limits[0]:g} to {limits[1]:g} {channel.unit}; lower the amplitude"
            )


def play(parts: Sequence[Mapping[str, Any]], channels: list[str] | int, seed: int) -> Signal:
    """Return the signal of one part, or of several one after the other with their rests."""
    signals = []
    for i, part in enumerate(parts):
        given = {k: v for k, v in part.items() if k not in ("kind", "rest_s")}
        signals.append(GENERATORS[part["kind"]](**given, channels=channels, seed=seed + i))
        if part["rest_s"]:
            signals.append(rest(dt=signals[-1].dt, duration_s=part["rest_s"], channels=channels))
    return signals[0] if len(signals) == 1 else in_sequence(signals)


def read_excitation(top: TomlTable) -> tuple[dict[str, Any], ...]:
    """Read [excitation], or the parts of [[excitation]], each of which may end with a rest of rest_s."""
    several = isinstance(top.values.get("excitation"), list)
    tables = top.tables("excitation") if several else [top.table("excitation")]
    if not tables:
        raise ExciteError(f"{top.place}excitation: is empty; give at least one part")
    return tuple(_part(table, several) for table in tables)


def _part(table: TomlTable, several: bool) -> dict[str, Any]:
    kind = table.take("kind", str)
    if kind not in GENERATORS:
        raise ExciteError(f"{table.place}kind: '{kind}'; {did_you_mean(kind, GENERATORS)}")
    rest_s = table.take("rest_s", NUMBER, 0.0, at_least(0)) if several else 0.0
    known = [p for p in inspect.signature(GENERATORS[kind]).parameters if p not in FIXED]
    for key in table.values:
        if key not in known:
            raise ExciteError(f"{table.place}{key}: unknown key for a {kind}; {did_you_mean(key, known)}")
    return {"kind": kind, **table.values, "rest_s": rest_s}


def _view(table: TomlTable, plant: Plant, inject: str) -> ViewSpec:
    name = table.take("name", str, check=_file_name)
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


def _score(table: TomlTable, views: tuple[ViewSpec, ...]) -> tuple[tuple, tuple, dict]:
    """Return rank_by, horizons_s and bands_hz by view."""
    rank_by = tuple(table.items("rank_by", str, ["pole_error_max", "frf_error_h2"]))
    without_truth = [s.name for s in views if not s.plants_own]
    for i, metric in enumerate(rank_by):
        place = f"{table.place}rank_by[{i}]: '{metric}'"
        if (known := find_metric(metric)) is None:
            raise ExciteError(f"{place} is no metric; {did_you_mean(metric, list_metrics())}")
        if without_truth and known.needs_truth:
            raise ExciteError(
                f"{place} needs a truth, and view '{without_truth[0]}', with roles of its own, has none; "
                'rank by "fit_one_step" or "fit_simulation"'
            )
        if known.horizon is not None and "horizons_s" not in table.values:
            raise ExciteError(f"{place} needs a prediction horizon; give horizons_s")
    horizons_s = table.items("horizons_s", NUMBER, [], lambda h: None if h > 0 else "give positive seconds")
    bands, bands_hz = table.table("bands_hz"), {}
    for view in views:
        band = bands.take(view.name, list, None)
        if band is None and view.coherence is not None:
            raise ExciteError(f"{bands.place}{view.name}: missing; coherence is judged over it, give [low, high] in Hz")
        if band is None:
            continue
        if len(band) != 2 or not all(is_a(f, NUMBER) for f in band) or not 0 < band[0] < band[1]:
            raise ExciteError(f"{bands.place}{view.name}: {band!r}; give [low, high] with 0 < low < high")
        bands_hz[view.name] = (float(band[0]), float(band[1]))
    bands.done()
    table.done()
    return rank_by, tuple(map(float, horizons_s)), bands_hz


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


def _expectation(key: str, value: Any, place: str, views: list[str], methods: tuple[MethodSpec, ...]) -> Expectation:
    place = f'{place}"{key}"'
    match = BOUND.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ExciteError(f'{place}: {value!r}; give a comparison such as "<= 0.02"')
    parts = key.split(".")
    if len(parts) not in (3, 4):
        raise ExciteError(f'{place}: give "method.metric.statistic" or "view.method.metric.statistic"')
    if len(parts) == 3 and len(views) > 1:
        raise ExciteError(f"{place}: there are {len(views)} views; put one first: {', '.join(views)}")
    view = parts[0] if len(parts) == 4 else views[0]
    method, metric, statistic = parts[-3:]
    here = [name for m in methods if m.view == view for name in (m.label or m.name,)] + ["best"]
    metrics = [metric] if find_metric(metric) else list_metrics()
    for part, known in ((view, views), (method, here), (metric, metrics), (statistic, STATISTICS)):
        if part not in known:
            raise ExciteError(f"{place}: '{part}' is not known here; {did_you_mean(part, known)}")
    return Expectation(key, view, method, metric, statistic, match[1], float(match[2]))
