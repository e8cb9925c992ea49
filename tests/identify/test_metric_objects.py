"""Metrics as objects: every one conforms, says why it does not apply, and comes from our table or another package."""

import json
from dataclasses import replace

import numpy as np
import pytest
from measured_models import DT, record, system

from excite.errors import ExciteError
from excite.models.model import Dynamic
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.metrics import conformance as suite
from identify.metrics import describe, impulse_error, list_metrics, load_metric
from identify.metrics.judgement import Judgement
from identify.metrics.metric import Metric, Need, NotApplicable
from identify.metrics.registry import find_metric, metrics_at, table
from identify.score import case_of, predictions, score, score_in

METHODS_OF_DATA = ("fit_simulation", "fit_one_step", "vaf_simulation", "vaf_one_step")


class Measured(suite.OnlyResponse):
    """A frequency response that is known at some frequencies only, and refuses others."""

    def __init__(self, model, f_hz):
        super().__init__(model)
        self.f_hz = np.asarray(f_hz, float)

    def frf(self, f_hz):
        if np.min(f_hz) < self.f_hz[0] or np.max(f_hz) > self.f_hz[-1]:
            raise ExciteError("outside the band of this frequency response")
        return self.model.frf(f_hz)


class Continuous(Dynamic):
    """The same system in continuous time: dt is None, and the poles are in the s-plane."""

    def __init__(self, model):
        self.model, self.dt, self.inputs, self.outputs = model, None, model.inputs, model.outputs

    def frf(self, f_hz):
        return self.model.frf(f_hz)

    def poles(self):
        return np.log(self.model.poles()) / self.model.dt

    def impulse(self, count, dt=None):
        raise AssertionError("asked for samples of a model in continuous time")

    def simulate(self, u, x0=None):
        return self.model.simulate(u, x0)

    def to_state_space(self, dt=None):
        return self.model


# Conformance --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("check", suite.CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", list_metrics())
def test_every_metric_conforms(name, check):
    metric = suite.example_of(name)
    assert check in suite.checks_of(metric), "none of ours needs an exception"
    check(metric)


def rmse(judgement):
    """Root mean square of the simulation's error, in the unit of the outputs."""
    return np.sqrt(np.mean((judgement.y - judgement.predicted["simulation"]) ** 2))


def a_metric(compute, *needs, **changes):
    texts = {"tells": "How far.", "cannot_tell": "Why.", "header": "distance", "unit": "–"}
    return Metric("distance", "how far it is", compute, needs=frozenset(needs), **texts | changes)


DATA = (Need.RECORD, Need.SIMULATION)


@pytest.mark.parametrize(
    ("metric", "check", "said"),
    [
        (a_metric(rmse, *DATA), suite.check_units, None),
        (a_metric(rmse, *DATA, smaller_is_better=False), suite.check_best, None),
        (a_metric(rmse, *DATA, best=1.0), suite.check_best, None),
        (a_metric(lambda judgement: 0.0), suite.check_best, None),
        (a_metric(lambda judgement: float(np.random.default_rng().random())), suite.check_deterministic, None),
        (a_metric(lambda judgement: rmse(judgement) * judgement.y[0, 0], *DATA), suite.check_channels, None),
        (a_metric(lambda judgement: np.nan), suite.check_needs, "raise NotApplicable"),
        (a_metric(rmse, *DATA, tells=""), suite.check_described, "tells"),
    ],
)
def test_a_metric_that_does_not_conform_is_found_out(metric, check, said):
    with pytest.raises(AssertionError, match=said):
        check(metric)


def test_a_need_that_is_not_declared_is_found_out():
    with pytest.raises(AttributeError):  # the model without poles reaches the computation
        suite.check_needs(a_metric(lambda judgement: len(judgement.dynamic.poles())))
    suite.check_needs(a_metric(lambda judgement: len(judgement.dynamic.poles()), Need.POLES))


def test_declared_exceptions_are_left_out_of_the_suite():
    metric = a_metric(rmse, *DATA, exceptions={"check_units": "it has the unit of the outputs"})
    assert set(suite.CHECKS) - set(suite.checks_of(metric)) == {suite.check_units}
    for check in suite.checks_of(metric):
        check(metric)


# Not applicable is a reason ---------------------------------------------------------------------------------------------


def assert_whole(result, case_horizons=()):
    """Every metric has a finite value or a reason, and none has both."""
    names = {metric.name for metric in metrics_at(case_horizons)}
    found = {name for name in result.values if find_metric(name)}
    assert found | set(result.reasons) == names and not found & set(result.reasons)
    assert np.isfinite(list(result.values.values())).all() and all(result.reasons.values())


def test_a_frequency_response_is_scored_by_what_applies():
    true = system()
    model = suite.OnlyResponse(system(gain=1.1))
    result = score(model, record(true), Truth(true, "exact"), horizons=[3], clean=record(true))
    assert_whole(result, (3,))
    assert result.values == pytest.approx({"frf_error_h2": 0.1, "frf_error_peak": 0.1})
    assert result.reasons["pole_error_max"] == "an OnlyResponse has no poles"
    assert result.reasons["fit_simulation"] == "an OnlyResponse cannot be simulated"
    assert result.reasons["impulse_error"] == "an OnlyResponse has no impulse response"


def test_a_response_that_is_known_over_part_of_the_band_is_judged_there():
    true = system()
    result = score(Measured(system(gain=1.1), [0.5, 1.0, 2.0]), None, Truth(true, "exact"))
    assert result.values == pytest.approx({"frf_error_h2": 0.1, "frf_error_peak": 0.1})
    outside = score(Measured(true, [1e-6, 1e-5]), None, Truth(true, "exact"))
    assert outside.values == {} and "1e-06 to 1e-05 Hz, outside the band" in outside.reasons["frf_error_h2"]


def test_a_truth_that_is_a_frequency_response_alone():
    true = system()
    truth = Truth(Measured(true, np.linspace(0.2, 3.0, 50)), "exact", poles=[])
    result = score(system(gain=1.1), record(true), truth)
    assert result.values["frf_error_h2"] == pytest.approx(0.1)
    assert result.reasons["pole_error_max"] == "the truth is a Measured alone" == result.reasons["impulse_error"]
    band = score(true, None, Truth(suite.OnlyResponse(true), "exact", poles=[]))
    assert "give band_hz" in band.reasons["frf_error_h2"]


def test_a_model_without_noise_part_is_not_scored_on_prediction():
    model = system(K=False)
    result = score(model, record(model), horizons=[3], clean=record(model))
    assert_whole(result, (3,))
    ahead = ("fit_one_step", "vaf_one_step", "fit_3_step", "vaf_3_step", "fit_clean_3_step")
    assert {result.reasons[name] for name in ahead} == {"the model has no noise part"}
    assert result.values["fit_simulation"] == pytest.approx(100)
    assert {result.reasons[name] for name in ("frf_error_h2", "fit_below_floor")} == {"no truth is known"}


def test_without_a_record_the_truth_still_judges():
    result = score(system(), None, Truth(system(), "exact"))
    assert_whole(result)
    assert result.values["pole_error_max"] == 0 and result.reasons["fit_clean"].startswith("no noise-free twin")
    assert {result.reasons[name] for name in METHODS_OF_DATA} == {"no validation record is given"}


def test_poles_of_a_kind_that_the_truth_lacks():
    result = score(system(), None, Truth(system(), "exact"))
    assert result.reasons["pole_error_integrator_rad_s"] == "no pole of the truth is an integrator"
    assert "pole_error_frequency_percent" in result.values
    real = StateSpaceModel(np.diag([0.9, 0.5]), [[1], [1]], [[1, 1]], [[0]], DT)
    fewer = StateSpaceModel([[0.9]], [[1]], [[1]], [[0]], DT)
    assert score(fewer, None, Truth(real, "exact")).reasons["pole_error_damping"] == (
        "no matched pole of the truth is oscillatory"
    )
    gain = StateSpaceModel(np.empty((0, 0)), np.empty((0, 1)), np.empty((1, 0)), [[2.0]], DT)
    static = score(gain, None, Truth(gain, "exact"))
    assert static.reasons["pole_error_max"] == "the truth has no poles" and static.values["frf_error_h2"] == 0


def test_a_model_in_continuous_time_is_judged_at_the_rate_of_the_truth():
    true = system(K=False)
    result = score(Continuous(true), record(true), Truth(true, "exact"))
    assert_whole(result)
    assert result.values["pole_error_max"] == pytest.approx(0, abs=1e-9)
    assert result.values["fit_simulation"] == pytest.approx(100)
    assert "continuous time" in result.reasons["impulse_error"]


def test_a_constant_output_is_named_and_the_others_keep_their_values():
    model = StateSpaceModel(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0)
    u = np.random.default_rng(1).standard_normal((200, 2))
    y = model.simulate(u)
    y[:, 1] = 3.0
    result = score(model, Experiment(u, y, dt=1.0, outputs=["height", "speed"]))
    assert_whole(result)
    assert result.reasons["fit_simulation"] == "'speed' is constant on this record"
    fits = result.per_output["fit_simulation"]
    assert fits[0] > 0 and np.isnan(fits[1]) and "fit_simulation_unclipped" not in result.values


def test_a_response_that_overflows_has_a_reason():
    wild = replace(system(), A=1e200 * np.eye(2))
    result = score(wild, record(system()), Truth(system(), "exact"))
    assert_whole(result)
    assert result.reasons["impulse_error"].startswith("comes out as ")


def test_a_record_without_a_complete_sample_is_refused():
    u = np.full((30, 1), np.nan)
    with pytest.raises(ExciteError, match="each of its 30 samples misses a value"):
        score(system(), Experiment(u, np.ones((30, 2)), dt=DT))


def test_a_truth_of_another_rate_or_other_channels_is_refused():
    with pytest.raises(ExciteError, match=r"truth has dt 0\.2 s, the model 0\.1 s"):
        score(system(), None, Truth(replace(system(), dt=0.2), "exact"))
    one = StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], DT)
    with pytest.raises(ExciteError, match="truth has 1 outputs, the model 2"):
        score(system(), None, Truth(one, "exact"))


def test_the_distance_from_the_floor_is_that_of_the_truth_itself():
    true, other = system(), system(gain=0.9)
    case = case_of(record(true), Truth(true, "exact"), clean=record(other, seed=4))
    floor, own = (score_in(case, model).values for model in (true, system(gain=0.7)))
    assert floor["fit_below_floor"] == 0
    assert own["fit_below_floor"] == pytest.approx(floor["fit_clean"] - own["fit_clean"]) and own["fit_below_floor"] > 1
    integrating = replace(true, A=np.diag([1.0, 0.5]))
    case = case_of(record(integrating), Truth(integrating, "exact"), horizons=[2, 5], clean=record(integrating))
    assert score_in(case, replace(integrating, K=None)).reasons["fit_below_floor"] == "the model has no noise part"


def test_what_metrics_share_is_computed_once():
    calls = []

    def counting(model, experiment, horizons):
        calls.append(model)
        return predictions(model, experiment, horizons)

    true = system()
    case = replace(case_of(record(true), Truth(true, "exact"), clean=record(true)), predict=counting)
    for _ in range(3):
        score_in(case, system(gain=0.8))
    assert len(calls) == 3 * 2 + 1  # record and twin of each, and once the truth on the twin


# The table --------------------------------------------------------------------------------------------------------------


def test_names_families_and_headers():
    assert load_metric("fit_5_step").title(0.02) == "fit 100 ms ahead [%]"
    assert load_metric("fit_clean_5_step").short_title(0.02) == "100 ms clean"
    assert load_metric("fit_<h>_step").words() == "fit … ms ahead" and find_metric("fit_<h>_step") is None
    assert load_metric("pole_error_max").title() == "pole error max [%]"
    assert find_metric("fit_simulation_unclipped") is None and find_metric("fit_0x_step") is None
    with pytest.raises(ExciteError, match="metric 'frf_eror_h2' does not exist; did you mean 'frf_error_h2'"):
        load_metric("frf_eror_h2")
    assert [m.name for m in metrics_at([2, 7])][-5:] == [
        "fit_2_step",
        "vaf_2_step",
        "fit_7_step",
        "fit_clean_7_step",
        "vaf_7_step",
    ]
    assert {m.name for m in table()} == set(list_metrics())


def test_a_family_itself_and_a_horizon_that_was_not_asked_for_apply_to_nothing():
    judged = Judgement(system(), case_of(record(system()), horizons=[2, 7], clean=record(system())))
    for name, said in (
        ("fit_<h>_step", "stands for a family"),
        ("fit_5_step", "5 samples are no horizon that was asked for"),
        ("fit_clean_2_step", "2 samples are no longest horizon that was asked for"),
    ):
        assert said in load_metric(name).not_applicable(judged)
        with pytest.raises(NotApplicable, match=said):
            load_metric(name).measure(judged)


@pytest.mark.parametrize("name", list_metrics())
def test_descriptions_are_plain(name):
    described = json.loads(json.dumps(describe(load_metric(name)), allow_nan=False))
    assert described["name"] == name and described["tells"] and described["cannot_tell"] and described["summary"]


def test_names_of_the_face_are_loaded_when_asked_for():
    assert impulse_error(system(), system()) == 0
    with pytest.raises(ImportError):
        from identify.metrics import no_such_name  # noqa: F401
