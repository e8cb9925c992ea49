"""From a checked scenario to pieces: what is designed, flown and identified, resolved once."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from excite.digest import digest
from excite.errors import placed
from excite.generators.registry import GENERATORS
from excite.types.frozen import Frozen
from excite.types.signal import Signal
from scenarios.run.design import Design, built_entries, make_design
from scenarios.run.pieces import DESIGNING, FLYING, Flight, Identification, PlantSpec, View, code_of, slots_of, stems_of
from scenarios.run.store import Slot, Store
from scenarios.scenario.spec import Scenario, ViewSpec, check_signal

VALIDATION_OFFSET = 10_000  # between the noise seeds of estimation and validation runs
EXCITATION = "excitation.csv"


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything a run makes, in the order in which it can be made.

    design : the excitation and what follows from it; signals : name -> signal, all of them designed; flights and
    identifications : pieces; views : name -> the view that is identified.
    """

    design: Design
    signals: Mapping[str, Signal]
    flights: tuple[Flight, ...]
    identifications: tuple[Identification, ...]
    views: Mapping[str, View] = field(default_factory=Frozen)

    def names(self) -> set[str]:
        """Names of all pieces."""
        trials = {slot.name for slot in self.slots().values()}
        return {*self.signals, *(flight.name for flight in self.flights), *trials}

    def slots(self) -> dict[str, Slot]:
        """Return key -> where it lies, for all trials."""
        return {key: slot for piece in self.identifications for key, slot in piece.slots.items()}

    def of_view(self, name: str) -> tuple[Identification, ...]:
        """Return the identifications of a view, run after run."""
        return tuple(piece for piece in self.identifications if piece.view.name == name)


def make_plan(scenario: Scenario, store: Store | None = None) -> Plan:
    """Resolve a scenario. Signals that the store holds are taken from there: a search may decide otherwise next time.

    Raises what `make_design` raises, before anything is flown.
    """
    runs = range(scenario.validation_runs)
    design = make_design(scenario, _kept(scenario, store, EXCITATION, scenario.seed))
    signals = {EXCITATION: design.signal}
    for k in runs:
        name, seed = f"validation_{k:02d}.csv", scenario.seed + 1 + k
        kept = _kept(scenario, store, name, seed)
        signals[name] = scenario.design(seed) if kept is None else kept
        check_signal(scenario, signals[name])
    plant = PlantSpec(scenario.plant.name, scenario.preset, Frozen(scenario.parameters))
    flights = tuple(_flights(scenario, plant, signals))
    views: dict[str, View] = {}
    identifications: list[Identification] = []
    for spec in scenario.views:
        views[spec.name] = _view(scenario, spec, design)
        identifications += _identifications(scenario, spec, views[spec.name], design, plant, flights)
    return Plan(design, signals, flights, tuple(identifications), views)


def signal_key(scenario: Scenario, seed: int) -> str:
    """Return the digest of what a signal is designed from."""
    return digest(scenario.excitation, [str(c) for c in scenario.plant.injections[scenario.inject].channels], seed)


def signal_code(scenario: Scenario) -> str:
    """Return the digest of the code that designs the signals."""
    packages = {GENERATORS.made_by(part["kind"]) for part in scenario.excitation}
    return code_of(DESIGNING, sorted(package for package in packages if package is not None))


def _kept(scenario: Scenario, store: Store | None, name: str, seed: int) -> Signal | None:
    if store is None or not store.has(name, signal_key(scenario, seed), signal_code(scenario)):
        return None
    return store.signal(name)


def _flights(scenario: Scenario, plant: PlantSpec, signals: Mapping[str, Signal]) -> Iterator[Flight]:
    """Estimation runs share one excitation under different noise; validation runs have a fresh realisation of it."""
    parameters = f" with plant.parameters {dict(plant.parameters)}" if plant.parameters else ""
    for kind, count in (
        ("estimation", scenario.estimation_runs),
        ("validation", scenario.validation_runs),
        ("clean", scenario.validation_runs),
    ):
        for k in range(count):
            yield Flight(
                name=_recording(kind, k),
                place=f"{kind} run {k}{parameters}",
                plant=plant,
                signal=signals[EXCITATION if kind == "estimation" else f"validation_{k:02d}.csv"],
                inject=scenario.inject,
                noise=False if kind == "clean" else scenario.noise,
                seed=scenario.seed + k + (0 if kind == "estimation" else VALIDATION_OFFSET),
            )


def _recording(kind: str, k: int) -> str:
    return f"recordings/{kind}_{k:02d}.npz"


def _view(scenario: Scenario, spec: ViewSpec, design: Design) -> View:
    return View(
        spec.name,
        spec.roles,
        spec.plants_own,
        design.horizons[spec.name].every,
        scenario.discard_s,
        spec.coherence,
        scenario.bands_hz.get(spec.name),
        scenario.horizons_s,
    )


def _identifications(
    scenario: Scenario, spec: ViewSpec, view: View, design: Design, plant: PlantSpec, flights: tuple[Flight, ...]
) -> Iterator[Identification]:
    with placed(f"{scenario.file}: method: view '{spec.name}'"):
        entries = built_entries(scenario, spec, design.horizons[spec.name])
    keys = {flight.name: flight.key for flight in flights}
    validation, clean = (
        tuple(_recording(kind, k) for k in range(scenario.validation_runs)) for kind in ("validation", "clean")
    )
    judged = [keys[name] for name in (*validation, *clean)]
    first, stems = _recording("estimation", 0), stems_of(entries)
    for k in range(scenario.estimation_runs):
        estimation = _recording("estimation", k)
        base = digest(view, plant.key, keys[estimation], keys[first], judged, code_of(FLYING))
        slots = slots_of(entries, base, stems, f"models/{spec.name}", k)
        yield Identification(view, k, plant, estimation, first, validation, clean, entries, base, slots)
