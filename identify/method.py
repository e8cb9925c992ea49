"""What a method is, the table of all methods, and `fit`, which runs one by name."""

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from excite.errors import ExciteError, Unsupported, did_you_mean
from excite.types.experiment import Experiment
from identify.data.gaps import gap_free, out_of_range, proportional, without_dead_time
from identify.estimate import Estimate, Status
from identify.orders.orders import largest_gap
from identify.steps.initial_state import initial_state
from identify.steps.threads import blas_threads

Data = Experiment | Sequence[Experiment]

# One line adds a method: name -> "module:class".
METHODS: dict[str, str] = {
    "arx": "identify.prediction_error.arx:Arx",
    "cobra": "identify.realization.cobra:Cobra",
    "cva": "identify.subspace.n4sid:Cva",
    "era": "identify.realization.era:Era",
    "ho_kalman": "identify.realization.ho_kalman:HoKalman",
    "iem": "identify.subspace.iem:Iem",
    "io_realization": "identify.realization.io_realization:IoRealization",
    "moesp": "identify.subspace.moesp:Moesp",
    "n4sid": "identify.subspace.n4sid:N4sid",
    "okid": "identify.realization.okid:Okid",
    "parsim_k": "identify.subspace.parsim_k:ParsimK",
    "pbsid": "identify.subspace.pbsid:Pbsid",
    "pi_moesp": "identify.subspace.pi_moesp:PiMoesp",
    "po_moesp": "identify.subspace.po_moesp:PoMoesp",
    "sbr": "identify.realization.sbr:Sbr",
    "ssarx": "identify.subspace.ssarx:Ssarx",
    "ssi_cov": "identify.output_only.ssi_cov:SsiCov",
    "ssi_data": "identify.output_only.ssi_data:SsiData",
    "ssinnov1": "identify.subspace.ssinnov1:Ssinnov1",
    "ssinnov2": "identify.subspace.ssinnov2:Ssinnov2",
    "wfa": "identify.subspace.wfa:Wfa",
}


@dataclass(frozen=True)
class Method(ABC):
    """One identification method; its fields are its settings, under the literature's names.

    closed_loop : consistent when the input depends on past outputs through feedback; summary : one line for lists;
    consumes : what the records hold: any input ("time series"), an impulse in one input a record or a free decay
    ("impulse responses"), steps ("step responses"), or no input at all ("outputs");
    asymptotic : exact only as the records grow, even without noise (sample covariances have ends); input_delay : known
    dead time of all inputs in samples, where a method has that setting.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    closed_loop: ClassVar[bool]
    consumes: ClassVar[str] = "time series"
    asymptotic: ClassVar[bool] = False
    input_delay: ClassVar[int] = 0

    def __post_init__(self) -> None:
        for setting in fields(self):
            value = getattr(self, setting.name)
            least = setting.metadata.get("minimum", 1)
            if setting.type is int and (isinstance(value, bool) or not isinstance(value, int) or value < least):
                raise ExciteError(f"{self.name}.{setting.name}: {value!r}; give a whole number of at least {least}")
            if setting.type is bool and not isinstance(value, bool):
                raise ExciteError(f"{self.name}.{setting.name}: {value!r}; give true or false")

    def unsupported(self, data: Data) -> str | None:
        """Return why this method cannot take the data, or None."""
        data = experiments(data)
        if self.consumes in ("time series", "step responses") and not data[0].inputs:
            return "the data have no input, and this method identifies the path from inputs to outputs; name the inputs"
        for k, experiment in enumerate(data):
            record = f"record {k}: " if len(data) > 1 else ""
            if experiment.dt is None:
                return f"{record}sampling is not uniform, and this method needs one sampling time; resample the record"
            for key, channels in (("u", experiment.inputs), ("y", experiment.outputs)):
                values = getattr(experiment, key)
                if self.span(1) is None and (missing := np.isnan(values)).any():
                    row, column = np.argwhere(missing)[0]
                    return (
                        f"{record}sample {row} of channel '{channels[column].name}' is missing (NaN), {missing.sum()} in all; "
                        "fill them or give the gap-free parts as separate records"
                    )
            if reason := out_of_range(experiment):
                return record + reason
        return None

    def span(self, order: int) -> int | None:
        """Consecutive samples that one equation takes: records split into parts at gaps; None: gaps are not taken."""
        return None

    @abstractmethod
    def required_excitation(self, order: int) -> int:
        """Order of persistency of u without which the estimate does not exist (a necessary condition)."""

    @abstractmethod
    def sufficient_excitation(self, order: int) -> int:
        """Order of persistency of u that guarantees identifiability in open loop (a sufficient condition)."""

    @abstractmethod
    def largest_order(self, data: Data) -> int:
        """Largest order that these settings and data allow."""

    @abstractmethod
    def prepare(self, data: Data) -> Any:
        """Compress the data once for all orders; methods with the same `factor_key` can share the result."""

    @abstractmethod
    def realize(self, factor: Any, order: int | None) -> Estimate:
        """Return the model of one order (None: chosen by the largest singular-value gap) from prepared data."""

    def factor_key(self) -> tuple:
        """Two methods with equal keys prepare the same factor."""
        return (self.name, *asdict(self).values())

    def check(self, data: Data, order: int | None) -> None:
        """Raise Unsupported or ExciteError when the data or the order cannot work."""
        if reason := self.unsupported(data):
            raise Unsupported(f"{self.name}: {reason}")
        data = experiments(data)
        if self.consumes == "time series" and (reason := proportional(gap_free(data, 1).parts)):
            raise ExciteError(reason)
        if order is not None:
            check_order(self.name, order, self.largest_order(data))

    def fit(self, data: Data, order: int | None = None, shared: dict[tuple, Any] | None = None) -> Estimate:
        """Check, prepare, realize; `shared` keeps what was prepared from these data, by `factor_key`, for further fits."""
        begin = time.perf_counter()
        measured = experiments(data)
        data = without_dead_time(measured, self.input_delay)
        with blas_threads(len(data[0].inputs) + len(data[0].outputs)):
            self.check(data, order)
            factors = {} if shared is None else shared
            if self.factor_key() not in factors:
                factors[self.factor_key()] = self.prepare(data)
            estimate = self.realize(factors[self.factor_key()], order)
        if (span := self.span(estimate.order)) and (records := gap_free(data, span)).missing:
            x0 = tuple(estimate.x0[i] for i in records.first)
            estimate = replace(estimate, x0=x0, warnings=(records.report(span), *estimate.warnings))
        closed = any(experiment.loop.closed for experiment in data)
        if self.input_delay:
            estimate = _behind_dead_time(estimate, measured, self.input_delay, self.closed_loop or closed)
        settings = asdict(self)
        if not closed and estimate.status is Status.OK and np.abs(estimate.model.poles()).max(initial=0) > 1 + 1e-6:
            estimate = replace(estimate, status=Status.UNSTABLE)
        return replace(estimate, settings=settings, seconds=time.perf_counter() - begin)


def _behind_dead_time(estimate: Estimate, data: tuple[Experiment, ...], samples: int, predictor: bool) -> Estimate:
    """Return the estimate for the inputs as they were measured; x0 then also holds what was on its way at the first sample."""
    model = estimate.model.delayed(samples)
    predictor = bool(np.any(model.K)) and (
        predictor or np.abs(model.poles()).max() >= 1
    )  # else by simulation, as B and D
    first = (gap_free((record,), model.order).parts[0] for record in data)
    x0 = tuple(initial_state(model, part, predictor) for part in first)
    return replace(estimate, model=model, x0=x0)


def experiments(data: Data) -> tuple[Experiment, ...]:
    """Return data as a tuple of experiments that share channels and sampling time."""
    data = (data,) if isinstance(data, Experiment) else tuple(data)
    if not data:
        raise ExciteError("no experiment given; pass at least one")
    first = data[0]
    for k, other in enumerate(data[1:], 1):
        for what in ("inputs", "outputs"):
            if getattr(other, what) != getattr(first, what):
                raise ExciteError(f"experiment {k}: its {what} differ from those of experiment 0; pass like with like")
        if (first.dt is None) != (other.dt is None) or (first.dt and abs(other.dt / first.dt - 1) > 1e-6):
            raise ExciteError(
                f"experiment {k}: dt {other.dt} s differs from {first.dt} s of experiment 0; resample one"
            )
    return data


def check_order(name: str, order: object, largest: int) -> None:
    """Refuse an order that is not a whole number between 1 and the largest possible."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 1:
        raise ExciteError(f"{name}: order {order!r}; give a whole number from 1 to {largest}")
    if order > largest:
        raise ExciteError(
            f"{name}: order {order} is above the largest possible, {largest}, for these settings and data; "
            "lower the order, lengthen the horizon, or record more samples"
        )


def order_or_gap(order: int | None, singular_values: np.ndarray, largest: int) -> tuple[int, tuple[str, ...]]:
    """Return the order asked for, or the one before the largest singular-value gap with a warning that says so."""
    if order is not None:
        return order, ()
    if len(singular_values) < 2:
        raise ExciteError("a single singular value shows no gap to choose the order at; give the order")
    chosen, ratio = largest_gap(singular_values[: largest + 1])
    return chosen, (
        f"order {chosen} chosen at the largest singular-value gap (ratio {ratio:.3g}); give the order to fix it",
    )


def list_methods() -> list[str]:
    """Names of all methods."""
    return sorted(METHODS)


def method_class(name: str) -> type[Method]:
    """Return the class behind a method's name."""
    if name not in METHODS:
        raise ExciteError(f"method '{name}' does not exist; {did_you_mean(name, METHODS)}")
    module, kind = METHODS[name].split(":")
    return getattr(import_module(module), kind)


def load_method(name: str, **settings: Any) -> Method:
    """Return a method by name with its settings; an unknown setting is refused with the nearest known one."""
    kind = method_class(name)
    known = [setting.name for setting in fields(kind)]
    for key in settings:
        if key not in known:
            raise ExciteError(f"{name}: no setting '{key}'; {did_you_mean(key, known)}")
    return kind(**settings)


def fit(data: Data, method: str, order: int | None = None, **settings: Any) -> Estimate:
    """Identify a model: `fit(experiment, "po_moesp", order=6, block_rows=20)`.

    data : one Experiment or several (side by side); order : None lets the method choose it from its singular values.
    """
    return load_method(method, **settings).fit(data, order)
