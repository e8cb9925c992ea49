"""From a scenario to what is played: excitation, certificates, horizons; unsafe or unexciting designs are refused."""

from collections.abc import Mapping
from dataclasses import dataclass

from excite.errors import DesignRefused, ExciteError
from excite.persistency import Certificate, certify
from excite.types.signal import Signal
from excite.types.truth import Truth
from identify.method import Method, method_class
from scenarios.rule import Horizons, horizons
from scenarios.spec import MethodSpec, Scenario, SettingSpec


@dataclass(frozen=True, eq=False)
class Design:
    """signal : the excitation; per setting name: certificate at the setting's rate, horizons; warnings to show."""

    signal: Signal
    certificates: Mapping[str, Certificate]
    horizons: Mapping[str, Horizons]
    warnings: tuple[str, ...]


def make_design(scenario: Scenario) -> Design:
    """Design the excitation and judge it for every setting and method; DesignRefused when it cannot work."""
    signal = scenario.design(scenario.seed)
    certificates, chosen, warnings = {}, {}, list(signal.recipe.get("warnings", ()))
    for spec in scenario.settings:
        chosen[spec.name] = setting_horizons(scenario, spec, signal)
        certificate, notes = _judge(scenario, spec, chosen[spec.name], signal)
        certificates[spec.name] = certificate
        warnings += notes
    return Design(signal, certificates, chosen, tuple(dict.fromkeys(warnings)))


def setting_truth(scenario: Scenario, spec: SettingSpec, recording: object = None) -> Truth | None:
    """Return the truth at the setting's recorded rate; None for roles that the plant does not know."""
    return scenario.plant.truth(recording, spec.name) if spec.plants_own else None


def setting_horizons(scenario: Scenario, spec: SettingSpec, signal: Signal) -> Horizons:
    """Apply the design rule with the nominal truth; without one the scenario must give decimation and horizons."""
    truth = setting_truth(scenario, spec)
    if truth is None:
        if spec.decimate == "auto":
            raise ExciteError(
                f"{scenario.name}: setting '{spec.name}' has roles of its own, so no truth says how to decimate it; "
                "give decimate, and the methods their horizons"
            )
        return Horizons(spec.decimate, 20, 20, (f"decimation {spec.decimate} and the methods' own horizons: no truth",))
    dt = scenario.plant.dt * spec.roles.every
    hold = round(signal.dt * signal.recipe.get("hold", 1) / dt)
    return horizons(truth.model, None if spec.roles.closed or hold <= 1 else hold, spec.decimate)


def built_methods(scenario: Scenario, spec: SettingSpec, rule: Horizons) -> list[tuple[MethodSpec, Method]]:
    """Return the methods of one setting with their horizons filled in."""
    mine = [m for m in scenario.methods if m.setting == spec.name]
    return [(m, m.build(rule.fill(method_class(m.name)))) for m in mine]


def _judge(scenario: Scenario, spec: SettingSpec, rule: Horizons, signal: Signal) -> tuple[Certificate, list[str]]:
    """Certify the excitation at the setting's rate against what its methods need."""
    pairs = [(m, method, n) for m, method in built_methods(scenario, spec, rule) for n in m.orders]
    sufficient = max((method.sufficient_excitation(n) for _, method, n in pairs), default=1)
    certificate = certify(signal.sampled(scenario.plant.dt * spec.roles.every * rule.every), block_rows=sufficient)
    warnings = []
    for m, method, n in pairs:
        need, enough = method.required_excitation(n), method.sufficient_excitation(n)
        what = f"setting '{spec.name}': {m.name} n={n}"
        if certificate.order < need and not spec.roles.closed:
            raise DesignRefused(
                f"{scenario.name}: {what} needs an input persistently exciting of order {need}, the design has order "
                f"{certificate.order} at {certificate.dt * 1e3:g} ms; play a longer period, or shorten the horizons"
            )
        if certificate.order < enough:
            judged = "the reference" if spec.roles.closed else "the input"
            warnings.append(f"{what}: order {enough} would suffice, {judged} has order {certificate.order}")
    return certificate, warnings
