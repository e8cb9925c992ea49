"""Scenario files: TOML in, a checked `Scenario` out; every error names file, key path, value and remedy."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from excite.errors import ExciteError, did_you_mean, placed
from plants.plant import Plant
from plants.registry import load_plant
from scenarios.scenario.excitation import read_excitation
from scenarios.scenario.identification import read_methods, read_views
from scenarios.scenario.judging import read_expectation, read_score
from scenarios.scenario.spec import Scenario
from scenarios.scenario.toml_table import NUMBER, TomlTable, at_least, file_name

LIBRARY = Path(__file__).parents[1] / "library"


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


def check_scenario(source: Mapping[str, Any], file: str) -> Scenario:
    """Check a scenario dictionary key by key; nothing is simulated."""
    top = TomlTable(source, f"{file}: ")
    name = top.take("name", str, check=file_name)
    seed = top.take("seed", int, 0, at_least(0))
    description = top.take("description", str, "")
    plant, preset, parameters = _plant(top.table("plant"), file)
    noise = _noise(top.table("noise"), plant)
    inject = _inject(top.table("loop"), plant)
    excitation = read_excitation(top)
    estimation_runs, validation_runs, discard_s = _data(top.table("data"))
    views = read_views(top, plant, inject)
    names = [view.name for view in views]
    methods = read_methods(top, names)
    rank_by, horizons_s, bands_hz = read_score(top.table("score"), views)
    table = top.table("expect")
    expect = tuple(read_expectation(key, value, table.place, names, methods) for key, value in table.values.items())
    top.done()
    return Scenario(
        name=name,
        seed=seed,
        description=description,
        plant=plant,
        preset=preset,
        parameters=parameters,
        noise=noise,
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


def _plant(table: TomlTable, file: str) -> tuple[Plant, str | None, dict[str, Any]]:
    """Return the plant with its preset and parameters."""
    name, preset, parameters = (
        table.take("name", str),
        table.take("preset", str, None),
        table.take("parameters", dict, {}),
    )
    table.done()
    with placed(f"{file}: plant"):
        return load_plant(name, preset=preset, parameters=parameters), preset, parameters


def _noise(table: TomlTable, plant: Plant) -> bool | dict[str, float]:
    """Return the levels of the noise sources that are given, or whether there is noise at all."""
    on = table.take("enabled", bool, True)
    given = {key: table.take(key, NUMBER, None, at_least(0)) for key in plant.noise_sources}
    table.done()
    levels = {key: float(value) for key, value in given.items() if value is not None}
    return levels if (on and levels) else on


def _inject(table: TomlTable, plant: Plant) -> str:
    """Return where the excitation enters the plant."""
    inject = table.take("inject", str, next(iter(plant.injections)))
    if inject not in plant.injections:
        raise ExciteError(f"{table.place}inject: '{inject}'; {did_you_mean(inject, plant.injections)}")
    table.done()
    return inject


def _data(table: TomlTable) -> tuple[int, int, float]:
    """Return estimation_runs, validation_runs and discard_s."""
    estimation_runs = table.take("estimation_runs", int, 1, at_least(1))
    validation_runs = table.take("validation_runs", int, 1, at_least(1))
    discard_s = float(table.take("discard_s", NUMBER, 0.0, at_least(0)))
    table.done()
    return estimation_runs, validation_runs, discard_s
