"""Ranking, tables and notes where a metric does not apply: the row stands last, and says why."""

import json
from dataclasses import replace

import numpy as np
import pytest
from demo_package import install
from scipy.signal import lfilter

from excite.errors import ExciteError
from identify.metrics.registry import METRICS
from identify.prediction_error.arx import Arx
from scenarios.cli.main import status
from scenarios.report.columns import columns_of, legend
from scenarios.report.page import page
from scenarios.report.tables import note, ranking
from scenarios.report.text import summary_text
from scenarios.run.results import to_json
from scenarios.run.run import run_scenario
from scenarios.scenario.reading import check_scenario

OWN = {"view": [{"name": "mine", "inputs": ["u"], "outputs": ["y"], "decimate": 1}]}


def source(**changes):
    return {
        "name": "short",
        "plant": {"name": "mercere_open"},
        "excitation": {"kind": "noise", "form": "white", "dt": 1.0, "duration_s": 300},
        "data": {"estimation_runs": 2},
        "view": [{"name": "plant"}],
        "method": [{"name": "ssarx", "order": 1}, {"name": "arx", "order": 2}],
        **changes,
    }


def run(folder, **changes):
    return run_scenario(check_scenario(source(**changes), "short.toml"), folder)


def ranked(result):
    """The comparison of the only view."""
    (view,) = result.views
    return view.comparison


@pytest.fixture
def deaf(monkeypatch):
    """An arx whose models have no noise part, as those of methods that see the deterministic part alone."""
    fitted = Arx.realize

    def realize(self, *arguments):
        estimate = fitted(self, *arguments)
        model = estimate.model.to_state_space()
        return replace(estimate, model=replace(model, K=None, innovation_cov=None))

    monkeypatch.setattr(Arx, "realize", realize)


def test_a_row_to_which_a_ranking_metric_does_not_apply_stands_last_with_the_reason(tmp_path, deaf):
    result = run(tmp_path / "out", score={"rank_by": ["fit_one_step"]})
    view = ranked(result)
    assert [row.method for row in view.rows] == ["ssarx", "arx"]
    assert view.rows[0].reason is None and view.rows[1].reason == "fit one step: the model has no noise part"
    assert note(view, view.rows[1]).startswith("not ranked by fit one step: the model has no noise part")
    headers, rows = ranking(view)
    (arx,) = (row for row in rows if row[1] == "arx")
    assert arx[0] == "–" and arx[headers.index("fit one step [%]")] == "–"
    assert float(arx[headers.index("fit simulation, measured [%]")]) > 0  # what applies is shown
    shown = json.loads(json.dumps(to_json(result)["views"]["plant"]["ranking"], default=str))
    assert "fit_one_step" not in shown[1]["metrics"] and "fit_simulation" in shown[1]["metrics"]
    assert shown[1]["reasons"]["fit_one_step"] == "the model has no noise part"
    assert "fit_one_step" not in shown[0]["reasons"]
    assert "trust ssarx" in "\n".join(summary_text(result))


def test_a_cell_without_a_value_has_its_reason_below(tmp_path, deaf):
    view = ranked(run(tmp_path / "out"))
    rows = {row.method: row for row in view.rows}
    assert rows["arx"].reason is None  # the ranking metrics apply
    assert "no fit one step: the model has no noise part" in note(view, rows["arx"])
    assert "no " not in note(view, rows["ssarx"])


def test_where_nothing_can_be_ranked_the_verdict_says_so(tmp_path):
    result = run(tmp_path / "out", score={"rank_by": ["pole_error_integrator_rad_s"]})
    text = "\n".join(summary_text(result))
    assert "no method can be ranked (integrator error: no pole of the truth is an integrator)" in text
    assert "pole_error_integrator_rad_s" not in json.dumps(ranked(result).rows[0].summary)
    assert "not ranked by integrator error" in page(result, {})


def test_expectations_on_what_has_no_value_are_missed(tmp_path):
    result = run(tmp_path / "out", expect={"best.pole_error_damping.max": "<= 1"})
    assert [met for *_, met in result.expectations] == [False]
    assert "–" in page(result, {})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (OWN | {"score": {"rank_by": ["fit_below_floor"]}}, "'fit_below_floor' needs a truth"),
        (OWN | {"score": {"rank_by": ["poles_missing"]}}, "'poles_missing' needs a truth"),
        ({"score": {"rank_by": ["fit_5_step"]}}, "'fit_5_step' needs a prediction horizon; give horizons_s"),
        ({"score": {"rank_by": ["fit_<h>_step"]}}, "'fit_<h>_step' is no metric"),
        ({"score": {"rank_by": ["vaf_simulatio"]}}, "did you mean 'vaf_simulation'"),
    ],
)
def test_metrics_that_a_scenario_cannot_be_ranked_by(changes, message):
    with pytest.raises(ExciteError, match=message):
        check_scenario(source(**changes), "short.toml")


def test_roles_of_ones_own_are_ranked_by_fits():
    for metric in ("fit_clean", "vaf_one_step", "fit_simulation"):
        assert check_scenario(source(**OWN, score={"rank_by": [metric]}), "").rank_by == (metric,)


def test_a_prediction_horizon_ranks(tmp_path):
    result = run(tmp_path / "out", score={"rank_by": ["fit_3_step"], "horizons_s": [3.0]})
    assert all(row.reason is None for row in ranked(result).rows)
    result = run(tmp_path / "other", score={"rank_by": ["fit_4_step"], "horizons_s": [3.0]})
    assert "fit 4 samples ahead: no value" in ranked(result).rows[0].reason


def test_the_legend_explains_every_column_once():
    words = [name for names, *_ in legend() for name in names.split("; ")]
    assert len(words) == len(set(words)) and {"pole error max", "fit … ms ahead", "[q25 q75]"} <= set(words)


@pytest.fixture
def data(tmp_path):
    u = np.random.default_rng(0).choice([-1.0, 1.0], 300)
    y = lfilter([0, 1.0], [1, -0.8], u) + 0.1 * np.random.default_rng(1).standard_normal(300)
    path = tmp_path / "data.csv"
    np.savetxt(path, np.column_stack([u, y]), delimiter=",", header="u,y", comments="")
    return [str(path), "--inputs", "0", "--outputs", "1", "--dt", "0.1"]


def test_compare_shows_what_applies_and_says_why_the_rest_does_not(data, tmp_path, deaf, capsys):
    argv = ["compare", *data, "--methods", "arx,ssarx", "--orders", "2", "-o", str(tmp_path / "out")]
    assert status(argv) == 0
    lines = capsys.readouterr().out.splitlines()
    header, arx = lines[1].split(), next(line for line in lines if " arx " in line).split()
    assert header[:3] == ["rank", "method", "order"] and {"fit_simulation", "vaf_one_step"} <= set(header)
    assert arx[3:].count("–") == 2  # fit and VAF of one step
    assert "arx n=2: no fit_one_step, vaf_one_step: the model has no noise part" in lines
    rows = json.loads((tmp_path / "out" / "comparison.json").read_text())["rows"]
    (arx,) = (row for row in rows if row["method"] == "arx")
    assert arx["reasons"]["fit_one_step"] == "the model has no noise part" and "fit_one_step" not in arx["values"]


def test_score_prints_why_a_metric_has_no_value(data, tmp_path, deaf, capsys):
    model = str(tmp_path / "m.json")
    assert status(["identify", *data, "--method", "arx", "--order", "2", "-o", model]) == 0
    capsys.readouterr()
    assert status(["score", model, *data]) == 0
    out = capsys.readouterr().out
    assert "no fit_one_step, vaf_one_step: the model has no noise part" in out and "no truth is known" not in out
    assert "unclipped" not in out and "fit of the simulated output on the validation record" in out
    assert status(["score", model, *data, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out, parse_constant=lambda c: pytest.fail(f"{c} in JSON"))
    assert printed["reasons"]["pole_error_max"] == "no truth is known" and printed["values"]["fit_simulation"] > 50


PLUGIN = """
from identify.metrics.metric import Metric, Need

GAIN = Metric("gain", "error of the static gain", lambda j: abs(j.model.frf([0.0]) - j.truth.model.frf([0.0])).max(),
              tells="Where it settles.", cannot_tell="How it gets there.", header="gain error", unit="%", scale=100.0,
              short="gain %", needs=frozenset({Need.TRUTH, Need.INPUT}), compact=True)
"""


def test_a_metric_of_another_package_is_a_column_ranks_and_is_explained(tmp_path, monkeypatch):
    METRICS.__dict__.pop("_plugins", None)
    install(tmp_path, monkeypatch, "excite.metrics", PLUGIN, {"gain": "GAIN"})
    try:
        changes = {"score": {"rank_by": ["gain"]}, "expect": {"ssarx.gain.median": "<= 5"}}
        result = run(tmp_path / "out", **changes)
        view = ranked(result)
        assert "gain error [%]" in columns_of(view)[1] and "gain %" in ranking(view, compact=True)[0]
        medians = [row.summary["gain"]["median"] for row in view.rows]
        assert medians == sorted(medians) and result.expectations[0][2]
        html = page(result, {})
        assert "gain error" in html and "How it gets there." in html
        assert "gain error" in "\n".join(summary_text(result))
        with pytest.raises(ExciteError, match="'gain' needs a truth"):
            check_scenario(source(**OWN, **changes), "short.toml")
    finally:
        METRICS.__dict__.pop("_plugins", None)


def test_score_says_which_channels_it_takes_for_which(data, tmp_path, capsys):
    model, other = str(tmp_path / "m.json"), tmp_path / "other.csv"
    assert status(["identify", *data, "--method", "arx", "--order", "1", "-o", model]) == 0
    with open(data[0], encoding="utf-8") as stream:
        other.write_text(stream.read().replace("u,y", "v,y", 1), encoding="utf-8")
    capsys.readouterr()
    assert status(["score", model, str(other), *data[1:]]) == 0
    said = capsys.readouterr().err
    assert said == "warning: inputs u of the model are taken to be v of the record, in this order\n"
