"""Scenario files: TOML in, a checked `Scenario` out; every error names file, key path, value and remedy."""

import inspect
import operator
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from excite.errors import DesignRefused, ExciteError, did_you_mean
from excite.generators import GENERATORS
from excite.types.recording import Roles
from excite.types.signal import Signal
from identify.method import Method, load_method
from identify.score import METRICS
from plants.plant import Plant, load_plant

LIBRARY = Path(__file__).parent / "library"
STATISTICS = ("median", "q25", "q75", "min", "max", "mean")
COMPARISONS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
FIXED = ("channels", "seed")  # arguments of a generator that the pipeline decides itself


@dataclass(frozen=True)
class SettingSpec:
    """One identification setting: roles on the recording, and how much to decimate ("auto": by the design rule)."""

    name: str
    roles: Roles
    plants_own: bool
    decimate: int | str = "auto"


@dataclass(frozen=True)
class MethodSpec:
    """One method with its settings; horizons that are not given follow from the design rule."""

    name: str
    setting: str
    orders: tuple[int, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)

    def build(self, horizons: Mapping[str, int]) -> Method:
        """Return the method with the horizons of the design rule filled in where the scenario gives none."""
        return load_method(self.name, **{**horizons, **self.settings})


@dataclass(frozen=True)
class Expectation:
    """`setting.method.metric.statistic` compared with a number."""

    key: str
    setting: str | None
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
    """A checked scenario. `source` is the plain dictionary it came from, `plant` the configured plant."""

    name: str
    seed: int
    description: str
    plant: Plant
    noise: bool | Mapping[str, float]
    inject: str
    excitation: Mapping[str, Any]
    settings: tuple[SettingSpec, ...]
    methods: tuple[MethodSpec, ...]
    estimation_runs: int
    validation_runs: int
    discard_s: float
    rank_by: tuple[str, ...]
    bands_hz: Mapping[str, tuple[float, float]]
    horizons_s: tuple[float, ...]
    expect: tuple[Expectation, ...]
    source: Mapping[str, Any]

    def design(self, seed: int) -> Signal:
        """Return the excitation for a realisation seed."""
        parameters = {k: v for k, v in self.excitation.items() if k != "kind"}
        channels = [str(c) for c in self.plant.injections[self.inject].channels]
        return GENERATORS[self.excitation["kind"]](**parameters, channels=channels, seed=seed)


def shipped() -> dict[str, Path]:
    """Scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted(LIBRARY.glob("*.toml"))}


def load_scenario(name_or_path: str, runs: int | None = None) -> Scenario:
    """Read and check a scenario file or a shipped scenario; `runs` overrides data.estimation_runs."""
    known = shipped()
    path = Path(name_or_path)
    if not path.is_file():
        if name_or_path not in known:
            raise ExciteError(f"scenario '{name_or_path}' is neither a file nor shipped; {did_you_mean(name_or_path, known)}")
        path = known[name_or_path]
    try:
        source = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ExciteError(f"{path}: not a valid TOML file ({error}); mend it at that place") from None
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if runs is not None:
        source.setdefault("data", {})["estimation_runs"] = runs
    return check_scenario(source, path.name)


class _Table:
    """One TOML table being read: typed access by key, and refusal of whatever is left over."""

    def __init__(self, values: Any, place: str) -> None:
        if not isinstance(values, dict):
            raise ExciteError(f"{place}: {values!r}; expected a table")
        self.values, self.place, self.known = dict(values), place, []

    def take(self, key: str, kind: type | tuple[type, ...], default: Any = ..., check: Callable | None = None) -> Any:
        self.known.append(key)
        if key not in self.values:
            if default is ...:
                raise ExciteError(f"{self.place}{key}: missing; it is required")
            return default
        value = self.values.pop(key)
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            names = " or ".join(_TYPE_NAMES[k] for k in kinds)
            raise ExciteError(f"{self.place}{key}: {value!r} is not {names}")
        if check is not None and (remedy := check(value)):
            raise ExciteError(f"{self.place}{key}: {value!r}; {remedy}")
        return value

    def tables(self, key: str) -> list["_Table"]:
        rows = self.take(key, list, [])
        return [_Table(row, f"{self.place}{key}[{i}].") for i, row in enumerate(rows)]

    def table(self, key: str) -> "_Table":
        return _Table(self.take(key, dict, {}), f"{self.place}{key}.")

    def done(self) -> None:
        for key in self.values:
            raise ExciteError(f"{self.place}{key}: unknown key; {did_you_mean(key, self.known)}")


_TYPE_NAMES = {
    str: "text", int: "a whole number", float: "a number", bool: "true or false", list: "a list", dict: "a table"
}  # fmt: skip
_NUMBER = (int, float)


def _at_least(least: float) -> Callable[[Any], str | None]:
    return lambda value: None if value >= least else f"give at least {least:g}"


def _file_name(value: str) -> str | None:
    return None if re.fullmatch(r"\w[\w-]*", value) else "use letters, digits, _ and -: it names files"


@contextmanager
def _placed(place: str) -> Iterator[None]:
    """Prefix an inner error with the scenario's key path."""
    try:
        yield
    except ExciteError as error:
        raise type(error)(f"{place}: {error}") from None


def check_scenario(source: Mapping[str, Any], file: str) -> Scenario:
    """Check a scenario dictionary key by key; nothing is simulated."""
    top = _Table(source, f"{file}: ")
    name = top.take("name", str, check=_file_name)
    seed = top.take("seed", int, 0, _at_least(0))
    description = top.take("description", str, "")

    table = top.table("plant")
    with _placed(f"{file}: plant"):
        plant = load_plant(
            table.take("name", str), preset=table.take("preset", str, None), parameters=table.take("parameters", dict, {})
        )
    table.done()

    table = top.table("noise")
    on = table.take("enabled", bool, True)
    levels = {}
    for key in plant.noise_sources:
        value = table.take(key, _NUMBER, None, _at_least(0))
        if value is not None:
            levels[key] = float(value)
    table.done()

    table = top.table("loop")
    inject = table.take("inject", str, next(iter(plant.injections)))
    if inject not in plant.injections:
        raise ExciteError(f"{table.place}inject: '{inject}'; {did_you_mean(inject, plant.injections)}")
    table.done()

    excitation = _excitation(top.table("excitation"))

    table = top.table("data")
    estimation_runs = table.take("estimation_runs", int, 1, _at_least(1))
    validation_runs = table.take("validation_runs", int, 1, _at_least(1))
    discard_s = float(table.take("discard_s", _NUMBER, 0.0, _at_least(0)))
    table.done()

    settings = tuple(_setting(row, plant) for row in top.tables("setting"))
    if not settings:
        raise ExciteError(f"{file}: setting: missing; give at least one [[setting]] with name = one of {_list(plant.settings)}")
    _distinct([s.name for s in settings], f"{file}: setting", "name")
    names = [s.name for s in settings]
    methods = tuple(spec for row in top.tables("method") for spec in _methods(row, names))
    if not methods:
        raise ExciteError(f"{file}: method: missing; give at least one [[method]]")

    table = top.table("score")
    rank_by = tuple(table.take("rank_by", list, ["pole_error_max", "frf_error_h2"]))
    for i, metric in enumerate(rank_by):
        if metric not in METRICS:
            raise ExciteError(f"{table.place}rank_by[{i}]: {metric!r} is no metric; {did_you_mean(str(metric), METRICS)}")
    horizons_s = tuple(table.take("horizons_s", list, []))
    for i, horizon in enumerate(horizons_s):
        if not isinstance(horizon, _NUMBER) or horizon <= 0:
            raise ExciteError(f"{table.place}horizons_s[{i}]: {horizon!r}; give a positive number of seconds")
    bands = {}
    bands_table = table.table("bands_hz")
    for key in names:
        band = bands_table.take(key, list, None)
        if band is not None:
            if len(band) != 2 or not all(isinstance(f, _NUMBER) for f in band) or not 0 < band[0] < band[1]:
                raise ExciteError(f"{bands_table.place}{key}: {band!r}; give [low, high] with 0 < low < high")
            nyquist = 0.5 / (plant.dt * next(s.roles.every for s in settings if s.name == key))
            if band[1] > nyquist:
                raise ExciteError(f"{bands_table.place}{key}[1]: {band[1]:g} Hz exceeds the Nyquist frequency {nyquist:g} Hz")
            bands[key] = (float(band[0]), float(band[1]))
    bands_table.done()
    table.done()

    table = top.table("expect")
    expect = tuple(_expectation(key, value, table.place, names, methods) for key, value in table.values.items())
    top.done()
    scenario = Scenario(
        name=name, seed=seed, description=description, plant=plant, noise=levels if (on and levels) else on,
        inject=inject, excitation=excitation, settings=settings, methods=methods, estimation_runs=estimation_runs,
        validation_runs=validation_runs, discard_s=discard_s, rank_by=rank_by, bands_hz=bands,
        horizons_s=tuple(map(float, horizons_s)), expect=expect, source=source,
    )  # fmt: skip
    with _placed(f"{file}: excitation"):
        signal = scenario.design(seed)
    check_limits(scenario, signal, f"{file}: excitation")
    if discard_s >= signal.duration_s:
        raise ExciteError(f"{file}: data.discard_s: {discard_s:g} s discards the whole record of {signal.duration_s:g} s")
    return scenario


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


def _list(names: object) -> str:
    return ", ".join(map(str, names))


def _distinct(names: list[str], place: str, key: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ExciteError(f"{place}: {key} '{name}' is given twice; each needs its own")


def _excitation(table: _Table) -> dict[str, Any]:
    kind = table.take("kind", str)
    if kind not in GENERATORS:
        raise ExciteError(f"{table.place}kind: '{kind}'; {did_you_mean(kind, GENERATORS)}")
    known = [p for p in inspect.signature(GENERATORS[kind]).parameters if p not in FIXED]
    for key in table.values:
        if key not in known:
            raise ExciteError(f"{table.place}{key}: unknown key for a {kind}; {did_you_mean(key, known)}")
    return {"kind": kind, **table.values}


def _setting(table: _Table, plant: Plant) -> SettingSpec:
    name = table.take("name", str, check=_file_name)
    given = {key: table.take(key, list, None) for key in ("inputs", "outputs", "reference")}
    decimate = table.take("decimate", (int, str), "auto")
    if (isinstance(decimate, str) and decimate != "auto") or (isinstance(decimate, int) and decimate < 1):
        raise ExciteError(f'{table.place}decimate: {decimate!r}; give a whole number of at least 1, or "auto"')
    table.done()
    if given["inputs"] is None and given["outputs"] is None:
        if name not in plant.settings:
            raise ExciteError(
                f"{table.place}name: '{name}' is no setting of plant {plant.name}; "
                f"{did_you_mean(name, plant.settings)} Or give inputs and outputs."
            )
        return SettingSpec(name, plant.settings[name], True, decimate)
    for key in ("inputs", "outputs"):
        if not given[key]:
            raise ExciteError(f"{table.place}{key}: missing; a setting with its own roles needs inputs and outputs")
    roles = Roles(*(tuple(given[key] or ()) for key in ("inputs", "outputs", "reference")))
    return SettingSpec(name, roles, False, decimate)


def _methods(table: _Table, settings: list[str]) -> list[MethodSpec]:
    name = table.take("name", str)
    order, orders = table.take("order", int, None, _at_least(1)), table.take("orders", list, None)
    if (order is None) == (orders is None):
        raise ExciteError(f"{table.place}order: give either order or orders")
    orders = [order] if orders is None else orders
    if not orders or not all(isinstance(n, int) and not isinstance(n, bool) and n >= 1 for n in orders):
        raise ExciteError(f"{table.place}orders: {orders!r}; give whole numbers of at least 1")
    options = table.take("settings", dict, {})
    chosen = table.take("setting", (str, list), settings)
    table.done()
    chosen = [chosen] if isinstance(chosen, str) else chosen
    for setting in chosen:
        if setting not in settings:
            raise ExciteError(f"{table.place}setting: {setting!r} is not defined; {did_you_mean(str(setting), settings)}")
    with _placed(f"{table.place}settings"):
        load_method(name, **options)
    return [MethodSpec(name, setting, tuple(orders), options) for setting in chosen]


def _expectation(key: str, value: Any, place: str, settings: list[str], methods: tuple[MethodSpec, ...]) -> Expectation:
    match = re.fullmatch(r"\s*(<=|>=|<|>)\s*([-+0-9.eE]+)\s*", value) if isinstance(value, str) else None
    if match is None:
        raise ExciteError(f'{place}{key}: {value!r}; give a comparison such as "<= 0.02"')
    parts = key.split(".")
    if len(parts) not in (3, 4):
        raise ExciteError(f'{place}"{key}": give "method.metric.statistic" or "setting.method.metric.statistic"')
    setting = parts[0] if len(parts) == 4 else None
    method, metric, statistic = parts[-3:]
    checks = [(method, [m.name for m in methods] + ["best"]), (metric, METRICS), (statistic, STATISTICS)]
    for part, known in checks + ([(setting, settings)] if setting is not None else []):
        if part not in known:
            raise ExciteError(f'{place}"{key}": {part!r} is not known here; {did_you_mean(part, known)}')
    if setting is None and len(settings) > 1:
        raise ExciteError(f'{place}"{key}": there are {len(settings)} settings; put one first: {_list(settings)}')
    try:
        bound = float(match[2])
    except ValueError:
        raise ExciteError(f"{place}{key}: {match[2]!r} is not a number") from None
    return Expectation(key, setting or settings[0], method, metric, statistic, match[1], bound)


def statistics(values: list[float]) -> dict[str, float]:
    """Median, quartiles, extremes and mean; all NaN when any run failed to give a number."""
    array = np.asarray(values, float)
    if array.size == 0 or np.isnan(array).any():
        return dict.fromkeys(STATISTICS, float("nan"))
    q25, median, q75 = np.percentile(array, [25, 50, 75])
    return dict(zip(STATISTICS, (median, q25, q75, array.min(), array.max(), array.mean()), strict=True))
