"""Scores of several records, ranking by metrics, and metrics of other packages."""

import copy
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from demo_package import install
from measured_models import record, system

from identify.metrics import conformance as suite
from identify.metrics import list_metrics
from identify.metrics.ranking import ranking_value
from identify.metrics.registry import METRICS
from identify.score import Score, absent, by_reason, mean_score, score
from identify.score_json import score_from_dict, score_to_dict

# Scores -----------------------------------------------------------------------------------------------------------------


def test_scores_travel():
    constant = record(system())
    constant = replace(constant, y=constant.y * [1.0, 0.0])
    result = score(system(), constant)
    text = json.dumps(score_to_dict(result), allow_nan=False)
    back = score_from_dict(json.loads(text))
    for again in (back, pickle.loads(pickle.dumps(result)), copy.deepcopy(result)):
        assert (again.values, again.reasons, again.reason) == (result.values, result.reasons, None)
        np.testing.assert_array_equal(again.per_output["fit_simulation"], result.per_output["fit_simulation"])
    older = {"values": {"fit_clean": None, "frf_error_h2": 0.1}, "per_output": {}, "reason": None}
    assert score_from_dict(older).values == {"frf_error_h2": 0.1}


def test_the_mean_over_records_has_what_all_of_them_have():
    a = Score({"fit_clean": 90.0, "frf_error_h2": 0.1}, {"fit_clean": (80.0, 100.0)})
    b = Score({"fit_clean": 80.0}, {"fit_clean": (70.0, 90.0)}, reasons={"frf_error_h2": "no truth is known"})
    mean = mean_score([a, b])
    assert mean == Score({"fit_clean": 85.0}, {"fit_clean": (75.0, 95.0)}, None, {"frf_error_h2": "no truth is known"})
    assert mean_score([a]) == a


def test_reasons_over_runs_say_in_how_many():
    runs = [Score({}, reasons={"a": "why", "b": "why"}), Score({}, reasons={"a": "why"})]
    assert absent(runs) == {"a": "why", "b": "in 1 of 2 runs: why"}
    assert by_reason({"a": "why", "b": "else", "c": "why"}) == {"why": ["a", "c"], "else": ["b"]}


def test_rows_are_ranked_by_the_geometric_mean_of_their_losses():
    medians = {"pole_error_max": 0.04, "fit_one_step": 91.0}
    value, reason = ranking_value(medians, {}, ["pole_error_max", "fit_one_step"])
    assert value == pytest.approx(np.sqrt(0.04 * 9.0)) and reason is None
    reasons = {"frf_error_h2": "no truth is known"}
    assert ranking_value(medians, reasons, ["pole_error_max", "frf_error_h2"]) == (
        np.inf,
        "FRF error H2: no truth is known",
    )
    assert ranking_value({"fit_clean": 100.0}, {}, ["fit_clean"])[0] < 1e-200


# Metrics of other packages ------------------------------------------------------------------------------------------------

PLUGIN = """
from identify.metrics.metric import Metric, Need

WORDS = {"tells": "Whether it is stable.", "cannot_tell": "Whether it is right.", "unit": "–"}
RADIUS = Metric("radius", "largest modulus of the poles", lambda j: abs(j.dynamic.poles()).max(), header="radius",
                needs=frozenset({Need.POLES}), compact=True, **WORDS)
BROKEN = Metric("broken", "what fails", lambda j: 1 / 0, header="broken", **WORDS)


def ahead(horizon):
    return Metric(f"count_{horizon}_step", "samples", lambda j: float(horizon), header="count {ahead}", horizon=horizon, **WORDS)


NOTHING = 3
"""


ENTRIES = {
    "radius": "RADIUS",
    "broken": "BROKEN",
    "count_<h>_step": "ahead",
    "nothing": "NOTHING",
    "absent": "demo_metrics_that_are_not:RADIUS",
    "fit_clean": "RADIUS",
}


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """A package outside ours that is found through entry points."""
    METRICS.__dict__.pop("_plugins", None)
    yield install(tmp_path, monkeypatch, "excite.metrics", PLUGIN, ENTRIES)
    METRICS.__dict__.pop("_plugins", None)


def test_metrics_of_another_package_are_scored_and_a_broken_one_takes_nothing_with_it(plugin):
    assert {"radius", "broken", "count_<h>_step"} <= set(list_metrics())
    skipped = " ".join(f"{name}: {why}" for name, why in METRICS.skipped.items())
    assert "NOTHING): neither a Metric nor a function" in skipped and "ModuleNotFoundError" in skipped
    assert f"fit_clean ({plugin}:RADIUS): the name is taken by excite" in skipped
    result = score(system(), record(system()), horizons=[4])
    assert result.values["radius"] == pytest.approx(0.9) and result.values["count_4_step"] == 4
    assert result.reasons["broken"] == "ZeroDivisionError: division by zero" and result.values["fit_one_step"] > 99
    assert score(suite.OnlyResponse(system()), None).reasons["radius"] == "an OnlyResponse has no poles"
    assert ranking_value({"radius": 0.9}, {}, ["radius"])[0] == pytest.approx(0.9)
