"""Pieces of a run: each says what it is made from (its key), and makes itself; none knows the scenario."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from excite.digest import code_digest, digest, file_digest
from excite.errors import placed
from excite.types.experiment import Experiment
from excite.types.frozen import Frozen
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from identify.compare import Judge, Trial, run_trials, trial_key
from identify.data.coherence import select_outputs
from identify.data.records import Records
from identify.entries import Entry, packages_of
from plants.plant import Plant
from plants.registry import PLANTS, load_plant
from scenarios.run.store import Shelf, Slot, Store, file_safe

DESIGNING, FLYING, IDENTIFYING = ("excite",), ("excite", "plants"), ("excite", "identify")  # whose code makes a piece


def code_of(ours: Sequence[str], others: Sequence[tuple[str, ...]] = ()) -> str:
    """Return the digest of our packages' code, and of name and version of the packages of others, that make a piece."""
    return digest(code_digest(*ours), list(others)) if others else code_digest(*ours)


@dataclass(frozen=True)
class PlantSpec:
    """A plant by name, as a piece carries it to another process."""

    name: str
    preset: str | None
    parameters: Mapping[str, Any]

    def load(self) -> Plant:
        """Return the plant."""
        return load_plant(self.name, preset=self.preset, parameters=self.parameters)

    @cached_property
    def key(self) -> str:
        """Digest of the plant, of the files it refers to, and of the package it comes from."""
        files = [(str(path), file_digest(path)) for path in self.load().files]
        return digest(self.name, self.preset, self.parameters, files, PLANTS.made_by(self.name))


@dataclass(frozen=True, eq=False)
class Flight:
    """One run of the plant: estimation, validation, or the noise-free twin of a validation run.

    name : of the piece; place : what messages call it; noise : whether there is any, or standard deviations by source.
    """

    name: str
    place: str
    plant: PlantSpec
    signal: Signal
    inject: str
    noise: bool | Mapping[str, float]
    seed: int

    @cached_property
    def key(self) -> str:
        """Digest of all that the recording depends on."""
        signal = self.signal
        return digest(self.plant.key, signal.u, signal.dt, signal.channels, self.inject, self.noise, self.seed)

    @property
    def code(self) -> str:
        """Digest of the code that makes the recording."""
        package = PLANTS.made_by(self.plant.name)
        return code_of(FLYING, [package] if package else [])

    def finished(self, store: Store) -> bool:
        """Whether the store holds this recording."""
        return store.has(self.name, self.key, self.code)

    def make(self, folder: str) -> None:
        """Fly, and keep the recording."""
        with placed(self.place):
            recording = self.plant.load().run(self.signal, inject=self.inject, noise=self.noise, seed=self.seed)
        Store(Path(folder)).save_recording(self.name, self.key, self.code, recording)


@dataclass(frozen=True, eq=False)
class View:
    """What is identified from a recording, and how it is made fit: roles, start discarded, decimated.

    coherence : keep the outputs whose mean coherence over band_hz is at least this in the first estimation run;
    plants_own : whether the plant knows a truth for it; horizons_s : further prediction horizons.
    """

    name: str
    roles: Roles
    plants_own: bool
    every: int
    discard_s: float = 0.0
    coherence: float | None = None
    band_hz: tuple[float, float] | None = None
    horizons_s: tuple[float, ...] = ()

    def experiment(self, recording: Recording) -> Experiment:
        """Return the view of a recording."""
        experiment = recording.experiment(self.roles)
        skip = round(self.discard_s / experiment.uniform_dt)
        return replace(experiment.window(skip - skip % self.every).decimate(self.every), name=self.name)

    def chosen(self, first: Recording) -> "View":
        """Return the view with the outputs that the first estimation run shows coherent, where it asks for that."""
        if self.coherence is None or self.band_hz is None:  # a scenario with one names the other
            return self
        with placed(f"view '{self.name}': coherence"):
            kept = select_outputs(self.experiment(first), self.band_hz, self.coherence)
        return replace(self, roles=replace(self.roles, outputs=tuple(kept)), coherence=None)

    def truth(self, plant: Plant, recording: Recording | None = None) -> Truth | None:
        """Return the truth at the recorded rate; None for roles that the plant does not know."""
        if not self.plants_own:
            return None
        truth = plant.truth(recording, self.name)
        all_outputs = len(truth.model.outputs) == len(self.roles.outputs)
        return truth if all_outputs else truth.select(self.roles.outputs)


@dataclass(frozen=True, eq=False)
class Identification:
    """All entries of one view on one estimation run, scored on all validation runs.

    run : number of the estimation run; estimation, first, validation, clean : names of recordings (of this run, of the
    first one, of the validation runs and their noise-free twins); base : digest of data and judge; slots : key of a
    trial -> where it lies.
    """

    view: View
    run: int
    plant: PlantSpec
    estimation: str
    first: str
    validation: tuple[str, ...]
    clean: tuple[str, ...]
    entries: tuple[Entry, ...]
    base: str
    slots: Mapping[str, Slot] = field(default_factory=Frozen)

    def finished(self, store: Store) -> bool:
        """Whether the store holds all trials."""
        return all(store.has(slot.name, key, slot.code) for key, slot in self.slots.items())

    def trials(self, store: Store) -> tuple[Trial, ...]:
        """Return the finished trials, under the labels of the entries."""
        keyed = [(e, trial_key(self.base, e.method, order)) for e in self.entries for order in e.orders]
        return tuple(store.trial(self.slots[key].name).under(entry.label) for entry, key in keyed)

    def make(self, folder: str) -> None:
        """Fit and score what is not there yet; every trial is kept as soon as it is finished."""
        store = Store(Path(folder))
        view = self.view.chosen(store.recording(self.first))
        data = Records.of(view.experiment(store.recording(self.estimation)))
        shelf = Shelf(store, self.slots)
        run_trials(self.entries, data, self.judge(store, view), name=f"run {self.run}", store=shelf, base=self.base)

    def judge(self, store: Store, view: View) -> Judge:
        """Return what scores the estimates: validation runs, noise-free twins, the truth of the estimation run."""
        validation, clean = (
            [view.experiment(store.recording(name)) for name in names] for names in (self.validation, self.clean)
        )
        truth = view.truth(self.plant.load(), store.recording(self.estimation))
        steps = tuple(max(1, round(h / validation[0].uniform_dt)) for h in view.horizons_s)
        lifted = truth and truth.lift(view.every)
        return Judge(validation, lifted, clean=clean, horizons=steps, band_hz=view.band_hz)


def slots_of(
    entries: Sequence[Entry], base: str, stems: Mapping[tuple, str], place: str, run: int | None = None
) -> Frozen:
    """Return key -> where it lies, for all trials on one set of records; run : its number, where there are several."""
    end = ".json" if run is None else f"/run_{run:02d}.json"
    return Frozen(
        {
            trial_key(base, entry.method, order): Slot(
                f"{place}/{stems[entry.label, order]}{end}",
                code_of(IDENTIFYING, packages_of(entry.method, order)),
                entry.label,
            )
            for entry in entries
            for order in entry.orders
        }
    )


def stems_of(entries: Sequence[Entry], reserved: Sequence[str] = ()) -> dict[tuple[str, int | str | None], str]:
    """Return a file-safe name for each label and order, distinct also where the file system ignores case.

    It ends with the order: -n4, -nbic, nothing where there is none. reserved : names that stand for something else.
    """
    stems: dict[tuple[str, int | str | None], str] = {}
    taken = {name.casefold() for name in reserved}
    for entry in entries:
        for order in entry.orders:
            base, end, count = file_safe(entry.label), "" if order is None else f"-n{file_safe(str(order))}", 2
            name = base + end
            while name.casefold() in taken:
                name, count = f"{base}_{count}{end}", count + 1
            taken.add(name.casefold())
            stems[entry.label, order] = name
    return stems
