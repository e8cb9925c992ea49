"""`fit`: the one template around every method."""

import time
from collections.abc import Iterable, MutableMapping
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np

from excite.errors import ExciteError, Unsupported
from excite.models.frequency_response import FrequencyResponse
from excite.models.model import Dynamic, Model
from excite.types.experiment import Experiment
from excite.types.frozen import Frozen
from identify.data.gaps import gap_free
from identify.data.records import Data, Kind, Records, constant, mismatch, missing_sample, out_of_range, proportional
from identify.estimate import Estimate, Status
from identify.method import Method, Need
from identify.orders.rules import Candidates, order_rule
from identify.registry import load_method
from identify.steps.initial_state import initial_state
from identify.steps.threads import blas_threads

UNSTABLE = 1 + 1e-6  # modulus of a pole beyond which a model is called unstable


def fit(
    data: Experiment | Iterable[Experiment] | Records | FrequencyResponse,
    method: str | Method,
    order: int | str | None = None,
    *,
    shared: MutableMapping | None = None,
    **settings: Any,
) -> Estimate:
    """Identify a model: `fit(experiment, "po_moesp", order=6, block_rows=20)`.

    Parameters
    ----------
    data : one Experiment or several (side by side), or a FrequencyResponse.
    method : its name, with its settings as further keywords, or a Method.
    order : a whole number, or a rule that chooses it: "gap" (largest singular-value gap), "aic", "aicc", "bic", or one
        that an installed package brings; None: the gap.
    shared : keeps what was condensed from these data, for further fits of them.

    Raises
    ------
    Unsupported where the method cannot take the data; ExciteError for bad data, settings and orders.

    Examples
    --------
    >>> from excite import Experiment
    >>> fit(Experiment([0.0, 1, 0, 0, 1, 1, 0, 1], [0.0, 0, 1, 0.5, 0.2, 1.1, 1.6, 0.8], dt=0.1), "arx", order=1).order
    1
    """
    begin = time.perf_counter()
    method = _chosen(method, settings)
    measured = _checked(data)
    shared = {} if shared is None else shared
    ready, told = _ready(method, measured, shared)
    with blas_threads(len(measured.inputs) + len(measured.outputs)):
        check(method, ready, order)
        compressed = _compressed(method, ready, shared)
        order, notes = _order(method, compressed, ready, order)
        estimate = method.realize(compressed, order, ready)
    if not isinstance(estimate, Estimate):
        raise ExciteError(f"{method.name}: realize returned a {type(estimate).__name__}; it must return an Estimate")
    estimate = replace(estimate, warnings=(*told, *notes, *estimate.warnings), settings=Frozen(method.settings()))
    if isinstance(measured, Records):
        estimate = _about_records(estimate, method, measured, ready)
    return replace(estimate, seconds=time.perf_counter() - begin)


def check(method: Method, data: Data, order: int | str | None) -> None:
    """Raise Unsupported or ExciteError when the data or the order cannot work."""
    if reason := unsupported(method, data):
        raise Unsupported(f"{method.name}: {reason}")
    if isinstance(data, Records) and Kind.SERIES in method.takes:
        parts = data.parts(1)
        if reason := constant(parts) or proportional(parts):
            raise ExciteError(reason)
    if method.order_is is None:
        if order is not None:
            raise ExciteError(f"{method.name}: order {order!r}; this method has no order, leave it out")
    elif order is not None and not isinstance(order, str):
        check_order(method.name, order, method.largest_order(data))


def unsupported(method: Method, data: Data) -> str | None:
    """Return why a method cannot take the data, or None."""
    if reason := mismatch(method.takes, data):
        return reason
    if isinstance(data, Records):
        if Need.REFERENCE in method.needs and any(record.reference is None for record in data.measured):
            return "needs the reference, and none is recorded; name its channels as reference"
        if Need.CONTROLLER in method.needs and any(record.loop.controller is None for record in data.measured):
            return "needs the controller, and nobody stated it; give it as the loop's controller"
        if method.span(1) is None and (reason := missing_sample(data)):
            return reason
        if reason := out_of_range(data):
            return reason
    return method.unsupported(data)


def check_order(name: str, order: object, largest: int) -> None:
    """Refuse an order that is not a whole number between 1 and the largest possible."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 1:
        raise ExciteError(f"{name}: order {order!r}; give a whole number from 1 to {largest}")
    if order > largest:
        raise ExciteError(
            f"{name}: order {order} is above the largest possible, {largest}, for these settings and data; "
            "lower the order, lengthen the horizon, or record more samples"
        )


def _chosen(method: str | Method, settings: dict[str, Any]) -> Method:
    if isinstance(method, str):
        return load_method(method, **settings)
    if not isinstance(method, Method):
        raise ExciteError(f"fit: method {method!r}; give a method's name, or a Method")
    if settings:
        raise ExciteError(f"fit: {', '.join(settings)} given beside a Method, which has its settings; give its name")
    return method


def _checked(data: Any) -> Data:
    """Return the data, checked: records, or one frequency response."""
    if isinstance(data, (list, tuple)) and len(data) == 1 and isinstance(data[0], FrequencyResponse):
        return data[0]
    return data if isinstance(data, FrequencyResponse) else Records.of(data)


def _ready(method: Method, measured: Data, shared: MutableMapping) -> tuple[Data, tuple[str, ...]]:
    """Return the data as the method takes them, and what was done to records in words.

    Records are taken about their level and without the dead time that the method is told. Where it takes frequency
    responses alone, its setting `response` makes one of them.
    """
    if isinstance(measured, FrequencyResponse):
        return measured, ()
    if method.response is None or Kind.SERIES in method.takes:
        return measured.deviations().without_dead_time(method.input_delay), ()
    key = ("response", method.response)
    if key not in shared:
        shared[key] = fit(measured, method.response, shared=shared)
    found = shared[key]
    if not isinstance(found.model, FrequencyResponse):
        raise ExciteError(
            f"{method.name}.response: {method.response.name} gives a {type(found.model).__name__}, no frequency response"
        )
    return found.model, (f"frequency response estimated from the records by {method.response.name}", *found.warnings)


def _compressed(method: Method, data: Data, shared: MutableMapping) -> Any:
    key = (method.compression, method.input_delay, method.response)
    if key not in shared:
        shared[key] = method.compression(data)
    return shared[key]


def _order(method: Method, compressed: Any, data: Data, asked: int | str | None) -> tuple[int | None, tuple[str, ...]]:
    """Return the order, and how it was chosen where a rule chose it."""
    if method.order_is is None:
        return None, ()
    if asked is not None and not isinstance(asked, str):
        return int(asked), ()
    candidates = Candidates(method, compressed, data)
    rule = "gap" if asked is None else asked
    chosen = order_rule(rule)(candidates)
    if not (isinstance(chosen, tuple) and len(chosen) == 2):
        raise ExciteError(f"order rule '{rule}': it gave {chosen!r}, not an order and why; correct the rule")
    order, why = chosen
    check_order(method.name, order, candidates.largest)
    return order, (f"order {order} chosen {why}; give the order to fix it",)


def _about_records(estimate: Estimate, method: Method, measured: Records, ready: Data) -> Estimate:
    """Return the estimate for the records as they were measured: gaps reported, dead time and level put back, judged."""
    span = method.span(estimate.order)
    if isinstance(ready, Records) and span and (parts := ready.gap_free(span)).missing:
        x0 = tuple(estimate.x0[i] for i in parts.first) if estimate.x0 else ()
        estimate = replace(estimate, x0=x0, warnings=(parts.report(span), *estimate.warnings))
    if any(record.loop.state == "unknown" for record in measured.measured):
        assumed = "whether the loop was closed is unknown: taken as open"
        estimate = replace(estimate, warnings=tuple(dict.fromkeys((assumed, *estimate.warnings))))
    if method.input_delay:
        predictor = method.consistent_in_closed_loop or measured.closed
        estimate = _behind_dead_time(estimate, measured.deviations(), method.input_delay, predictor)
    level = measured.measured[0].level
    if level.state == "known" and isinstance(estimate.model, Dynamic) and is_dataclass(estimate.model):
        model = replace(estimate.model, input_offset=np.array(level.u0), output_offset=np.array(level.y0))
        estimate = replace(estimate, model=model)
    if estimate.status is Status.OK and not measured.closed and _unstable(estimate.model):
        estimate = replace(estimate, status=Status.UNSTABLE)
    return estimate


def _unstable(model: Model) -> bool:
    """Whether a sampled model has a pole outside the unit circle."""
    if not isinstance(model, Dynamic) or model.dt is None:
        return False
    return bool(np.abs(model.poles()).max(initial=0) > UNSTABLE)


def _behind_dead_time(estimate: Estimate, data: Records, samples: int, predictor: bool) -> Estimate:
    """Return the estimate for the inputs as they were measured; x0 then also holds what was on its way at the start."""
    model = estimate.dynamic.to_state_space().delayed(samples)
    predictor = bool(np.any(model.K)) and (predictor or np.abs(model.poles()).max() >= 1)  # else by simulation, as B, D
    first = (gap_free((record,), model.order).parts[0] for record in data.measured)
    x0 = tuple(initial_state(model, part, predictor) for part in first)
    return replace(estimate, model=model, x0=x0)
