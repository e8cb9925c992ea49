"""From a scenario to what is played: excitation, certificates, horizons; what cannot work is refused before it flies."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.errors import DesignRefused, ExciteError, placed
from excite.persistency.certificate import Certificate, certify
from excite.types.experiment import Experiment
from excite.types.recording import Recording
from excite.types.signal import Signal
from excite.types.truth import Truth
from identify.compare import Entry, entries
from identify.data.records import Kind, Records
from identify.fit import check
from identify.method import Method
from identify.registry import method_class
from scenarios.scenario.sampling_rule import Horizons, horizons
from scenarios.scenario.spec import MethodSpec, Scenario, ViewSpec, check_signal


@dataclass(frozen=True, eq=False)
class Design:
    """signal : the excitation; per view name: certificate at the view's rate, horizons; warnings to show."""

    signal: Signal
    certificates: Mapping[str, Certificate]
    horizons: Mapping[str, Horizons]
    warnings: tuple[str, ...]


def make_design(scenario: Scenario, signal: Signal | None = None) -> Design:
    """Design the excitation, unless it is given, and judge it for every view and method.

    Raises ExciteError for roles, bands, orders and horizons that the records will not allow, and DesignRefused when the
    excitation is unsafe or cannot work.
    """
    with placed(f"{scenario.file}: excitation"):
        signal = scenario.design(scenario.seed) if signal is None else signal
    check_signal(scenario, signal)
    layout = scenario.plant.records(scenario.inject)
    if layout.dt is None:
        raise ExciteError(
            f"{scenario.file}: plant.parameters: they have the plant sample at uneven times, which no scenario can take; have it "
            "sample uniformly, or record it by `excite simulate`"
        )
    with placed(f"{scenario.file}: excitation"):
        scenario.plant.prepare(signal, scenario.inject, noise=False)
    blank = layout.blank()
    certificates, chosen, warnings = {}, {}, list(signal.warnings)
    for i, spec in enumerate(scenario.views):
        with placed(f"{scenario.file}: view[{i}]"):
            blank.experiment(spec.roles)
        chosen[spec.name] = rule = view_horizons(scenario, spec, signal)
        if note := _inexact(scenario, spec, rule, signal):
            warnings.append(note)
        _check_band(scenario, spec, rule)
        _check_methods(scenario, spec, rule, signal)
        certificates[spec.name], notes = _judge(scenario, spec, rule, signal)
        warnings += notes
    return Design(signal, certificates, chosen, tuple(dict.fromkeys(warnings)))


def view_truth(scenario: Scenario, spec: ViewSpec, recording: Recording | None = None) -> Truth | None:
    """Return the truth at the view's recorded rate; None for roles that the plant does not know."""
    return _truth(scenario, spec, recording) if spec.plants_own else None


def _truth(scenario: Scenario, spec: ViewSpec, recording: Recording | None = None) -> Truth:
    truth = scenario.plant.truth(recording, spec.name)
    all_outputs = len(truth.model.outputs) == len(spec.roles.outputs)
    return truth if all_outputs else truth.select(spec.roles.outputs)


def view_horizons(scenario: Scenario, spec: ViewSpec, signal: Signal) -> Horizons:
    """Apply the design rule with the nominal truth; without one the methods keep their own horizons."""
    dt = scenario.plant.dt * spec.roles.every
    if isinstance(spec.decimate, int) and spec.decimate * dt > signal.duration_s:
        raise ExciteError(
            f"{scenario.file}: view '{spec.name}': decimate: {spec.decimate} leaves one sample of "
            f"{signal.duration_s:g} s; give at most {signal.duration_s / dt / 2:.0f}"
        )
    if not spec.plants_own and isinstance(spec.decimate, int):  # "auto" is refused where there is no truth
        return Horizons(spec.decimate, 20, 20, (f"decimation {spec.decimate} and the methods' own horizons: no truth",))
    try:
        truth = _truth(scenario, spec)
        return horizons(truth, None if spec.roles.closed else _held(scenario, spec, signal), spec.decimate)
    except (np.linalg.LinAlgError, ExciteError) as error:
        given = scenario.source["plant"].get("parameters", {})
        raise ExciteError(
            f"{scenario.file}: plant.parameters: {given} leave view '{spec.name}' without a linearised truth ({error}); "
            "change them, or give the view inputs, outputs and decimate of its own"
        ) from error


def built_methods(scenario: Scenario, spec: ViewSpec, rule: Horizons) -> list[tuple[MethodSpec, Method]]:
    """Return the methods of one view with their horizons filled in."""
    mine = [m for m in scenario.methods if m.view == spec.name]
    return [(m, m.build(rule.fill(method_class(m.name)))) for m in mine]


def built_entries(scenario: Scenario, spec: ViewSpec, rule: Horizons) -> tuple[Entry, ...]:
    """Return the methods of one view as entries of a comparison, with labels that differ."""
    built = built_methods(scenario, spec, rule)
    return entries([Entry(m.label or m.name, method, m.orders) for m, method in built])


def _held(scenario: Scenario, spec: ViewSpec, signal: Signal) -> int | None:
    """Samples of the view over which the excitation is held, None when it moves every sample."""
    hold = round(signal.dt * signal.hold / (scenario.plant.dt * spec.roles.every))
    return hold if hold > 1 else None


def _inexact(scenario: Scenario, spec: ViewSpec, rule: Horizons, signal: Signal) -> str | None:
    """Return a warning when the decimated records are those of no discrete model."""
    held = None if spec.roles.closed else _held(scenario, spec, signal)
    if rule.every == 1 or (held and held % rule.every == 0):
        return None
    moves = f"is held for {held} samples, no multiple of it" if held else "moves every sample"
    return f"view '{spec.name}': decimation {rule.every} is not exact, since the input {moves}"


def _check_band(scenario: Scenario, spec: ViewSpec, rule: Horizons) -> None:
    nyquist = 0.5 / (scenario.plant.dt * spec.roles.every * rule.every)
    high = scenario.bands_hz.get(spec.name, (0.0, nyquist))[1]
    if high > nyquist:
        raise ExciteError(
            f"{scenario.file}: score.bands_hz.{spec.name}[1]: {high:g} Hz exceeds the Nyquist frequency {nyquist:g} Hz of "
            f"this view (decimation {rule.every}); lower it"
        )


def _check_methods(scenario: Scenario, spec: ViewSpec, rule: Horizons, signal: Signal) -> None:
    """Refuse orders and horizons that records of the coming length and channels cannot bear.

    Methods that want a certain shape of records (steps, impulses, outputs alone), and outputs chosen by coherence, are
    judged on the records themselves.
    """
    if spec.coherence is not None:
        return
    dt = scenario.plant.dt * spec.roles.every
    length = (round(signal.duration_s / dt) - round(scenario.discard_s / dt)) // rule.every
    widths = [len(names) for names in (spec.roles.inputs, spec.roles.outputs, spec.roles.reference)]
    columns = np.random.default_rng(0).standard_normal((max(length, 1), sum(widths)))
    u, y, r = np.split(columns, np.cumsum(widths)[:2], axis=1)
    stand_in = Experiment(u, y, dt=dt * rule.every, reference=r if widths[2] else None)
    for m, method in built_methods(scenario, spec, rule):
        for n in m.orders if Kind.SERIES in method.takes else ():
            with placed(f"{m.place}: view '{spec.name}', {len(u)} samples of {stand_in.dt:g} s"):
                check(method, Records.of(stand_in), n)


def _judge(scenario: Scenario, spec: ViewSpec, rule: Horizons, signal: Signal) -> tuple[Certificate, list[str]]:
    """Certify the excitation at the view's rate against what its methods need."""
    pairs = [(m, method, n) for m, method in built_methods(scenario, spec, rule) for n in m.orders]
    sufficient = max(1, *(method.sufficient_excitation(n if isinstance(n, int) else None) for _, method, n in pairs))
    dt = scenario.plant.dt
    certificate = certify(signal.sampled(dt).sampled(dt * spec.roles.every * rule.every), block_rows=sufficient)
    warnings = []
    for m, method, n in pairs:
        states = n if isinstance(n, int) else None
        need, enough = method.required_excitation(states), method.sufficient_excitation(states)
        what = f"view '{spec.name}': {m.name}" + ("" if n is None else f" n={n}")
        if certificate.order < need and not spec.roles.closed:
            raise DesignRefused(
                f"{scenario.file}: {what} needs an input persistently exciting of order {need}, the design has order "
                f"{certificate.order} at {certificate.dt * 1e3:g} ms; play a longer period, or shorten the horizons"
            )
        if certificate.order < enough:
            judged = "the reference" if spec.roles.closed else "the input"
            warnings.append(f"{what}: order {enough} would suffice, {judged} has order {certificate.order}")
    return certificate, warnings
