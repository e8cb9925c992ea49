"""Conformance of identification methods: what every method must satisfy, as callables for a test runner.

Checks take a Method instance, one of ours or of an installed package. A method declares the checks that it does not
pass, with the reason, in `conformance_exceptions`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from excite.types.experiment import Experiment
from identify.data.records import Kind
from identify.estimate import Estimate
from identify.examples import closed_loop, example_of, series, with_needs
from identify.fit import fit
from identify.method import Method, with_settings
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors
from identify.state_space_method import StateSpaceMethod
from identify.steps.kalman import spectral_radius
from identify.steps.shift import Shift

STATES, LAGS = 4, 2  # order of the examples: states, or lags of two outputs
OVER_TIME = {Kind.SERIES, Kind.OUTPUTS, Kind.IMPULSES, Kind.STEPS}


def order_of(method: Method) -> int | None:
    """Return the order at which the method holds the examples."""
    return {"states": STATES, "lags": LAGS, None: None}[method.order_is]


def _fit(method: Method, data: Any) -> Estimate:
    return fit(data, method, order_of(method))


def _error(model: Model, truth: Model, count: int | None = None) -> float:
    """Relative error of the impulse response; the largest pole error where there is no input; else of the response."""
    if not (isinstance(model, Dynamic) and isinstance(truth, Dynamic)) or model.dt is None or truth.dt is None:
        f = np.linspace(0.01, 0.4, 60) / (truth.dt or 1.0)
        return float(np.linalg.norm(model.frf(f) - truth.frf(f)) / np.linalg.norm(truth.frf(f)))
    if truth.inputs:
        return impulse_error(model, truth) if count is None else impulse_error(model, truth, count)
    return float(pole_errors(truth.poles(), model.poles(), truth.dt).z.max())


def check_deterministic(method: Method) -> None:
    """The same data give the same bits."""
    data, _ = example_of(method)
    first, second = (_fit(method, data).model for _ in range(2))
    f_hz = np.linspace(0.01, 0.4, 20) / (first.dt or 1.0)
    assert first.frf(f_hz).tobytes() == second.frf(f_hz).tobytes()


def check_inputs_unmodified(method: Method) -> None:
    """A fit leaves the data as they were."""
    data, _ = example_of(method)
    before = [_bytes(e) for e in data]
    _fit(method, data)
    assert before == [_bytes(e) for e in data]


def _bytes(data: Any) -> tuple[bytes, ...]:
    return (data.u.tobytes(), data.y.tobytes()) if isinstance(data, Experiment) else (data.values.tobytes(),)


def check_hashable(method: Method) -> None:
    """Equal methods are one key, in a dictionary and for what is condensed; settings are plain values."""
    again = with_settings(method)
    assert again == method and hash(again) == hash(method)
    assert hash(again.compression) == hash(method.compression) and again.compression == method.compression
    assert set(method.settings()) == set(method.setting_names())


def check_units(method: Method) -> None:
    """One common factor on all inputs and one on all outputs scale the response and leave the poles."""
    data, _ = example_of(method)
    plain = _fit(method, data).model
    scaled = _fit(method, [replace(e, u=1e3 * e.u, y=1e-2 * e.y, references=e.references or None) for e in data]).model
    f_hz = np.linspace(0.01, 0.4, 20) / (plain.dt or 1.0)
    np.testing.assert_allclose(scaled.frf(f_hz) * 1e5, plain.frf(f_hz), rtol=1e-6, atol=1e-7)
    if isinstance(plain, Dynamic) and isinstance(scaled, Dynamic):
        poles = [np.sort_complex(np.round(model.poles(), 12)) for model in (scaled, plain)]
        np.testing.assert_allclose(poles[0], poles[1], atol=1e-8)


def check_converges(method: Method) -> None:
    """On in-class data the error is small and falls with the noise; with the record where a method is `asymptotic`."""
    first, second, least = ((0.1, 1), (0.1, 16), 0.5) if method.asymptotic else ((0.1, 1), (0.001, 1), 0.05)
    errors = []
    for noise, length in (first, second):
        data, truth = example_of(method, noise, length)
        errors.append(_error(_fit(method, data).model, truth))
    assert errors[0] < 0.05 and errors[1] < least * errors[0], errors


def check_several_records(method: Method) -> None:
    """More records give one estimate that no seam disturbs: cut in two with samples missing between, or repeated."""
    data, truth = example_of(method)
    if method.takes & {Kind.SERIES, Kind.OUTPUTS}:
        data = tuple(part for e in data for part in (e.window(0, 700), e.window(705)))
    else:
        data = data + data
    estimate = _fit(method, data)
    assert _error(estimate.model, truth) < 0.05
    assert len(estimate.x0) in (0, len(data))


def check_closed_loop_claim(method: Method) -> None:
    """A method that claims consistency in closed loop converges there where the biased one does not."""
    order = {"states": STATES, "lags": 20, None: None}[method.order_is]
    errors = []
    for samples in (1000, 16_000):
        runs = [closed_loop(samples, seed) for seed in range(4)]
        errors.append(np.median([_error(fit(d, method, order).model, t, 60) for d, t in runs]))
    if method.consistent_in_closed_loop:
        assert errors[1] < 0.5 * errors[0], errors
    else:
        assert errors[1] > 0.5 * errors[0], errors


def check_refusals(method: Method) -> None:
    """Constant channels, uneven time and impossible orders are refused with a reason."""
    data, _ = example_of(method)
    flat = [replace(e, y=np.column_stack([e.y[:, 0], np.full(len(e), 3.0)]), **_kept(e)) for e in data]
    cases: dict[str, tuple[Any, int | None]] = {"'y2' is constant": (flat, order_of(method))}
    if Kind.UNEVEN_STEPS not in method.takes:
        uneven = [replace(e, dt=None, time_s=np.cumsum(1 + 0.5 * np.sin(np.arange(len(e)))), **_kept(e)) for e in data]
        cases["not uniform"] = (uneven, order_of(method))
    if method.order_is is None:
        cases["has no order"] = (data, 2)
    else:
        cases |= {"order 0": (data, 0), "largest possible": (data, 10_000)}
    for expected, (bad, order) in cases.items():
        _refuses(method, bad, order, expected)


def check_gaps(method: Method) -> None:
    """Missing samples split a record, which the estimate says; a method that cannot take gaps refuses them."""
    data, truth = example_of(method)
    y, middle = data[0].y.copy(), len(data[0]) // 2
    y[7, 1] = y[middle : middle + 9] = np.nan
    data = (replace(data[0], y=y, **_kept(data[0])), *data[1:])
    if method.span(1) is None:
        _refuses(method, data, order_of(method), "sample 7 of channel 'y2' is missing")
        return
    estimate = _fit(method, data)
    assert _error(estimate.model, truth) < 0.05
    assert len(estimate.x0) in (0, len(data))
    assert "10 of " in estimate.warnings[0] and "incomplete" in estimate.warnings[0]


def check_needs_its_input(method: Method) -> None:
    """Records whose input is absent, constant, or not of the kind taken are refused with a reason."""
    data = with_needs(method, series()[0])
    u = data.u.copy()
    u[:, 1] = 3.0
    constant, absent = replace(data, u=u), data.without_inputs()
    cases: dict[Kind, dict[str, Experiment]] = {
        Kind.SERIES: {"'u2' is constant": constant, "no input": absent},
        Kind.IMPULSES: {"not an impulse": data},
        Kind.STEPS: {"not a step": data, "no input": absent},
        Kind.OUTPUTS: {"the data have inputs": data},
        Kind.FREQUENCY: {"takes frequency responses": data} if method.response is None else {},
    }
    for kind in method.takes:
        for expected, bad in cases.get(kind, {}).items():
            _refuses(method, bad, order_of(method), expected)


@dataclass(frozen=True)
class Inside:
    """A disc about the origin, entered by scaling all of A: no method of merit, but an effect that shows."""

    radius: float
    name = "inside"

    def __call__(self, shift: Shift) -> tuple[np.ndarray, str | None]:
        """Return A scaled into the disc."""
        factor = self.radius / max(spectral_radius(shift.A), 1e-300)
        assert np.isfinite(shift.left).all() and np.isfinite(shift.right).all()
        return (shift.A, None) if factor >= 1 else (factor * shift.A, f"A scaled by {factor:.3f}")


def check_regions(method: StateSpaceMethod) -> None:
    """A region moves the eigenvalues inside and says so; one that holds them changes nothing; the guard is one."""
    data, _ = example_of(method)
    free = _fit(method, data)
    radius = spectral_radius(free.dynamic.to_state_space().A)
    bound = 0.9 * radius
    moved = _fit(with_settings(method, regions=(Inside(bound),)), data)
    assert spectral_radius(moved.dynamic.to_state_space().A) <= bound * (1 + 1e-9)
    assert any("A scaled by" in text for text in moved.warnings)
    for regions in ((Inside(1.1 * radius),), ("stable",)):
        same = _fit(with_settings(method, regions=regions), data).dynamic
        np.testing.assert_array_equal(same.to_state_space().A, free.dynamic.to_state_space().A)


def _kept(record: Experiment) -> dict[str, Any]:
    return {"references": record.references or None}


def _refuses(method: Method, bad: Any, order: int | None, expected: str) -> None:
    try:
        fit(bad, method, order)
    except ExciteError as error:
        assert expected in str(error), f"{expected!r} not in {error}"
    else:
        raise AssertionError(f"{method.name} took data that should be refused: {expected}")


Check = Callable[[Any], None]
# Each check and when it has a meaning.
CHECKS: dict[Check, Callable[[Method], bool]] = {
    check_deterministic: lambda method: True,
    check_inputs_unmodified: lambda method: True,
    check_hashable: lambda method: True,
    check_units: lambda method: bool(method.takes & OVER_TIME),
    check_converges: lambda method: True,
    check_several_records: lambda method: bool(method.takes & OVER_TIME),
    check_closed_loop_claim: lambda method: Kind.SERIES in method.takes,  # the others play open loop, or know no input
    check_refusals: lambda method: bool(method.takes & OVER_TIME),
    check_gaps: lambda method: bool(method.takes & OVER_TIME),
    check_needs_its_input: lambda method: True,
    check_regions: lambda method: isinstance(method, StateSpaceMethod),
}


def checks_of(method: Method) -> list[Check]:
    """Return the checks that have a meaning for a method and that it does not declare as exceptions."""
    return [c for c, fits in CHECKS.items() if fits(method) and c.__name__ not in method.conformance_exceptions]


def check(method: Method, exceptions: Mapping[str, str] | None = None) -> None:
    """Run every check on a method; exceptions : further name of a check -> the reason why it is left out."""
    for each in checks_of(method):
        if each.__name__ not in (exceptions or {}):
            each(method)
