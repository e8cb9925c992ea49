"""Conformance of metrics: what every metric must satisfy, third parties' included, as callables for a test runner.

A check raises AssertionError with what it found. A metric may declare that a check does not hold for it, with the reason:
`Metric.exceptions`. Checks call `Metric.measure` itself, so that a metric that fails is seen to fail.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import scipy.linalg as la

from excite.models.model import Model
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.metrics.judgement import Case, Judgement
from identify.metrics.metric import FAMILY, Metric, Need, NotApplicable, describe
from identify.metrics.registry import load_metric
from identify.score import case_of

DT = 0.1
HORIZON = 5  # samples, of the examples and of the metrics of families
CLOSE = 1e-6  # relative to 1 or to the value, whichever is larger: what rounding may change


class OnlyResponse(Model):
    """A model that is known by its frequency response alone."""

    def __init__(self, model: Model) -> None:
        self.model, self.inputs, self.outputs = model, model.inputs, model.outputs

    @property
    def dt(self) -> float | None:
        """That of the model."""
        return self.model.dt

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu)."""
        return self.model.frf(f_hz)


@cache
def example() -> StateSpaceModel:
    """Return a truth with an oscillatory pair, a real pole, an integrator, two inputs, two outputs and a noise part."""
    angle = 0.6
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    A = la.block_diag(0.9 * rotation, 0.7, 1.0)
    B = np.array([[1.0, 0.3], [0.2, -0.5], [0.4, 1.0], [0.5, -0.2]])
    C = np.array([[1.0, 0.4, 0.5, 1.0], [-0.3, 1.0, 0.8, 0.6]])
    K = la.solve_discrete_are(A.T, C.T, np.eye(4), np.eye(2))
    K = A @ K @ C.T @ la.inv(C @ K @ C.T + np.eye(2))
    return StateSpaceModel(A, B, C, np.zeros((2, 2)), DT, K=K, innovation_cov=np.eye(2))


def _gain(model: StateSpaceModel) -> np.ndarray:
    assert model.K is not None, "the examples have a noise part"
    return model.K


def _record(judged: Case) -> Experiment:
    assert judged.validation is not None, "the examples have a record"
    return judged.validation


def worse() -> Iterator[StateSpaceModel]:
    """Yield models that differ from the example in their poles, their gain, a state too few and a state too many."""
    true = example()
    poles = true.A.copy()
    poles[:2, :2] *= 0.97
    poles[2, 2], poles[3, 3] = 0.5, 0.98
    yield replace(true, A=poles)
    yield replace(true, B=1.2 * true.B)
    yield replace(true, A=true.A[:3, :3], B=true.B[:3], C=true.C[:, :3], K=_gain(true)[:3])
    yield replace(
        true,
        A=la.block_diag(true.A, 0.3),
        B=np.vstack([true.B, [[0.8, 0.5]]]),
        C=np.hstack([true.C, [[0.5], [0.7]]]),
        K=np.vstack([_gain(true), np.zeros((1, 2))]),
    )


def case(true: StateSpaceModel | None = None, scale: float = 1.0) -> Case:
    """Return a case without noise, in which the truth is a perfect model; scale : of its outputs."""
    true = true or example()
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], (150, len(true.inputs))), 2, axis=0)
    x0 = np.linspace(0.5, -0.5, true.order)
    model = scaled(true, scale)
    data = Experiment(u, model.simulate(u, x0), dt=true.dt, inputs=true.inputs, outputs=true.outputs)
    return case_of(data, Truth(model, "exact"), horizons=[HORIZON], clean=data)


def scaled(model: StateSpaceModel, factor: float) -> StateSpaceModel:
    """Return the same model with its outputs in another unit."""
    cov = None if model.innovation_cov is None else factor**2 * model.innovation_cov
    K = None if model.K is None else model.K / factor
    return replace(model, C=factor * model.C, D=factor * model.D, K=K, innovation_cov=cov)


def value(metric: Metric, model: Model, judged: Case) -> float:
    """Return a metric's value, the mean over outputs where it has one per output."""
    raw = np.asarray(metric.measure(Judgement(model, judged)), float)
    return float(np.mean(raw if metric.lowest is None else np.maximum(raw, metric.lowest)))


def check_described(metric: Metric) -> None:
    """It has a name that can be a key, and says what it is, what it tells and what it cannot tell."""
    assert metric.name and not set(metric.name) & set(". \"'"), metric.name
    for key, text in describe(metric).items():
        assert text != "", key
    assert metric.compact is False or metric.column, "the terminal shows a column that the report does not have"


def check_best(metric: Metric) -> None:
    """A perfect model has the best value, none of several wrong ones a better, and one of them a worse."""
    judged = case()
    perfect = value(metric, example(), judged)
    assert abs(perfect - metric.best) < CLOSE * max(1.0, abs(metric.best)), perfect
    losses = []
    for model in worse():
        try:
            losses.append(metric.loss(value(metric, model, judged)))
        except NotApplicable:
            continue
    assert min(losses) >= -CLOSE * max(1.0, abs(metric.best)), losses
    assert max(losses) > 1e3 * CLOSE * max(1.0, abs(metric.best)), losses


def check_needs(metric: Metric) -> None:
    """Where something is missing it gives a number all the same, or says in words why not; it never breaks."""
    whole, true = case(), example()
    lacking = {
        Need.TRUTH: (true, replace(whole, truth=None)),
        Need.CLEAN: (true, replace(whole, clean=None)),
        Need.RECORD: (true, replace(whole, validation=None)),
        Need.PREDICTION: (replace(true, K=None, innovation_cov=None), whole),
        Need.SIMULATION: (OnlyResponse(true), whole),
        Need.INPUT: _without_input(),
    }
    for need, (model, judged) in lacking.items():
        reason = metric.not_applicable(Judgement(model, judged))
        assert reason is not None or need not in metric.needs, f"applies without {need.value}, which it needs"
        if reason is None:
            try:
                found = value(metric, model, judged)
            except NotApplicable as error:
                assert str(error), f"no reason without {need.value}"
            else:
                assert np.isfinite(found), f"{found} without {need.value}; raise NotApplicable with the reason"
        else:
            assert len(reason) > 5, f"no reason without {need.value}"


def _without_input() -> tuple[StateSpaceModel, Case]:
    true = example()
    model = replace(true, B=np.empty((4, 0)), D=np.empty((2, 0)), inputs=None, input_offset=None)
    y = model.simulate(np.empty((100, 0)), np.ones(4))
    data = Experiment(np.empty((100, 0)), y, dt=DT)
    return model, case_of(data, Truth(model, "exact"), horizons=[HORIZON], clean=data)


def check_deterministic(metric: Metric) -> None:
    """The same model in the same case has the same value, and nothing of the case is changed."""
    model, judged = next(worse()), case()
    record = _record(judged)
    before = record.y.tobytes(), record.u.tobytes(), model.A.tobytes()
    assert value(metric, model, judged) == value(metric, model, replace(judged))
    assert before == (record.y.tobytes(), record.u.tobytes(), model.A.tobytes())


def check_units(metric: Metric) -> None:
    """Outputs in a unit a thousand times as small leave the value."""
    model = next(worse())
    plain, other = value(metric, model, case()), value(metric, scaled(model, 1e3), case(scale=1e3))
    assert abs(plain - other) < CLOSE * max(1.0, abs(plain)), (plain, other)


def check_channels(metric: Metric) -> None:
    """Inputs and outputs in another order leave the value."""
    model = next(worse())
    plain, other = value(metric, model, case()), value(metric, _turned(model), _turned_case())
    assert abs(plain - other) < CLOSE * max(1.0, abs(plain)), (plain, other)


def _turned(model: StateSpaceModel) -> StateSpaceModel:
    inputs: tuple[Channel, ...] = tuple(reversed(model.inputs))
    return replace(
        model,
        B=model.B[:, ::-1],
        C=model.C[::-1],
        D=model.D[::-1, ::-1],
        K=_gain(model)[:, ::-1],
        inputs=inputs,
        outputs=tuple(reversed(model.outputs)),
    )


def _turned_case() -> Case:
    judged = case()
    data, model = _record(judged), _turned(example())
    data = Experiment(data.u[:, ::-1], data.y[:, ::-1], dt=DT, inputs=model.inputs, outputs=model.outputs)
    return replace(judged, validation=data, clean=data, truth=Truth(model, "exact"))


CHECKS: tuple[Callable[[Metric], None], ...] = (
    check_described,
    check_best,
    check_needs,
    check_deterministic,
    check_units,
    check_channels,
)


def example_of(name: str) -> Metric:
    """Return the metric that stands for a name in the conformance suite: of a family, the one at HORIZON samples."""
    return load_metric(name.replace(FAMILY, str(HORIZON)))


def checks_of(metric: Metric) -> list[Callable[[Metric], None]]:
    """Return the checks that hold for a metric: all but those it declares as exceptions."""
    return [check for check in CHECKS if check.__name__ not in metric.exceptions]
