"""Scenario files and runs: refusals that name key and remedy, folders that are whole, resumed and never shared."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from short_scenario import OWN, changed, excite, pieces, run, scores, write

from excite.errors import ExciteError
from excite.files import load_recording, load_signal
from identify.estimate_json import load_estimate
from identify.subspace.ssarx import Ssarx
from plants.quadrotor.plant import Quadrotor
from scenarios.run.results import to_json
from scenarios.run.run import run_scenario
from scenarios.scenario.reading import check_scenario, load_scenario, shipped

# A finished run ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """One run by the command, with one expectation met and one missed: folder, exit code, printed JSON, progress."""
    home = tmp_path_factory.mktemp("finished")
    expect = {"best.frf_error_h2.median": "< 1e-9", "arx.fit_one_step.min": "> 1.0"}
    code, out, err = excite("run", write(home, {"expect": expect}), "-o", home / "out", "--jobs", "1", "--json")
    return home / "out", code, out, err


def test_the_folder_is_whole(finished):
    folder = finished[0]
    names = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file() and p.name != ".lock"}
    recordings = {f"recordings/{n}.npz" for n in ("estimation_00", "estimation_01", "validation_00", "clean_00")}
    models = {f"models/attitude/{m}/run_0{k}.json" for m in ("ssarx-n5", "arx-n2", "arx-n3") for k in range(2)}
    figures = {name for name in names if name.startswith("figures/")}
    single = {
        "scenario.toml",
        "excitation.csv",
        "excitation.csv.json",
        "certificate.json",
        "scores.json",
        "report.html",
    }
    single |= {"validation_00.csv", "validation_00.csv.json"}
    index = {name for name in names if name.startswith("index/")}
    assert index and names - figures - index == recordings | models | single
    assert {"figures/excitation.svg", "figures/attitude-poles.svg", "figures/attitude-bode.svg"} <= figures
    starts = {".svg": "<svg", ".json": "{", ".csv": "panel,"}
    assert all((folder / name).read_text().startswith(starts[Path(name).suffix]) for name in figures)
    assert {Path(name).stem for name in figures if name.endswith(".svg")} == {Path(name).stem for name in figures}
    assert "<script" not in (folder / "report.html").read_text()


def test_what_the_folder_holds_can_be_used_again(finished):
    folder = finished[0]
    scenario = load_scenario(str(folder / "scenario.toml"))
    assert np.array_equal(load_signal(folder / "excitation.csv").u, scenario.design(scenario.seed).u)
    recording = load_recording(folder / "recordings/estimation_01.npz")
    assert recording.origin.seed == 4 and recording.views == Quadrotor.injections["attitude_setpoint"].views
    outcome = json.loads((folder / "models/attitude/ssarx-n5/run_00.json").read_text())
    (folder / "copy.json").write_text(json.dumps(outcome["estimate"]))
    model = load_estimate(folder / "copy.json").model
    (folder / "copy.json").unlink()
    assert model.order == 5 and model.dt == 0.02
    assert json.loads((folder / "certificate.json").read_text())["attitude"]["order"] >= 16


def test_json_equals_the_scores_and_the_missed_expectation_is_1(finished):
    folder, code, out, err = finished
    result = json.loads(out, parse_constant=lambda constant: pytest.fail(f"{constant} in JSON"))
    assert code == 1 and result == json.loads((folder / "scores.json").read_text())
    assert [e["met"] for e in result["expectations"]] == [False, True]
    ranking = result["views"]["attitude"]["ranking"]
    assert [r["rank"] for r in ranking] == [1, 2, 3] and {r["method"] for r in ranking} == {"arx", "ssarx"}
    values = [r["rank_value"] for r in ranking]
    assert values == sorted(values)
    assert "playing" in err and "identifying" in err


def test_estimation_runs_share_the_excitation_and_validation_has_its_own(finished):
    inputs = {
        name: load_recording(finished[0] / f"recordings/{name}.npz").experiment("attitude")
        for name in ("estimation_00", "estimation_01", "validation_00", "clean_00")
    }
    assert np.array_equal(inputs["estimation_00"].u, inputs["estimation_01"].u)
    assert not np.array_equal(inputs["estimation_00"].y, inputs["estimation_01"].y)
    assert np.array_equal(inputs["validation_00"].u, inputs["clean_00"].u)
    assert not np.array_equal(inputs["validation_00"].u, inputs["estimation_00"].u)


def test_the_same_command_makes_nothing_again_and_prints_the_table(finished):
    folder = finished[0]
    before = pieces(folder)
    code, out, _ = excite("run", folder.parent / "short.toml", "-o", folder, "--jobs", "2")
    assert code == 1 and pieces(folder) == before
    assert "rank" in out and "ssarx" in out and "missed" in out and str(folder / "report.html") in out


def test_another_scenario_is_kept_out(finished):
    folder = finished[0]
    before = pieces(folder)
    with pytest.raises(ExciteError, match="holds a run of another scenario") as caught:
        run(folder, {"seed": 4})
    assert str(folder) in str(caught.value) and pieces(folder) == before


# Results that say why -----------------------------------------------------------------------------------------------------


def fail(self, factor, order, data):
    raise ExciteError("ssarx: nothing could be found")


def test_a_method_that_fails_has_its_reason_in_the_row(tmp_path, monkeypatch):
    monkeypatch.setattr(Ssarx, "realize", fail)
    expect = {"arx.fit_one_step.median": "> 1.0"}
    code, out, _ = excite("run", write(tmp_path, {"expect": expect}), "-o", tmp_path / "out", "--jobs", "1")
    assert code == 0 and "nothing could be found" in out
    rows = scores(tmp_path / "out")["views"]["attitude"]["ranking"]
    assert (rows[-1]["method"], rows[-1]["reason"], rows[-1]["rank_value"]) == (
        "ssarx",
        "ssarx: nothing could be found",
        None,
    )
    assert rows[-1]["metrics"] == {} and rows[0]["reason"] is None


def test_expectations_on_a_failed_method_are_missed(tmp_path, monkeypatch):
    monkeypatch.setattr(Ssarx, "realize", fail)
    scenario = check_scenario(changed({"method/1": None, "expect": {"best.fit_clean.median": "> 0"}}), "short.toml")
    result = to_json(run_scenario(scenario, tmp_path / "out"))
    assert [e["met"] for e in result["expectations"]] == [False]
    assert json.loads((tmp_path / "out/scores.json").read_text())["expectations"][0]["value"] is None


def test_ranking_by_a_fit_puts_the_best_fit_first(tmp_path):
    rows = run(tmp_path / "out", {"score/rank_by": ["fit_one_step"]})["views"]["attitude"]["ranking"]
    fits = [row["metrics"]["fit_one_step"]["median"] for row in rows]
    assert fits == sorted(fits, reverse=True)


def test_roles_of_ones_own_need_no_truth_and_know_their_loop(tmp_path):
    method = {"method": [{"name": "arx", "order": 3}]}
    result = run(tmp_path / "outside", OWN | method)["views"]["mine"]
    assert result["truth_kind"] is None and result["floor"] is None and result["dt"] == 0.01
    assert "frf_error_h2" not in result["ranking"][0]["metrics"]
    inside = OWN | method | {"view/0/inputs": ["thrust_roll"], "view/0/outputs": ["p"], "view/0/decimate": 1}
    assert not check_scenario(changed(OWN | method), "").views[0].roles.closed
    assert check_scenario(changed(inside), "").views[0].roles.closed  # motors answer to the measured rates


def test_inexact_decimation_is_warned_of(tmp_path):
    warnings = run(tmp_path / "out", {"view/0/decimate": 7})["warnings"]
    assert any("decimation 7 is not exact, since the input is held for 25 samples" in w for w in warnings)


def test_parts_play_one_after_the_other_with_rest_between(tmp_path):
    parts = [
        {"kind": "multistep", "form": "doublet", "dt": 0.004, "unit_s": 0.4, "amplitude": 2.0, "rest_s": 0.5},
        {"kind": "prbs", "order": 5, "dt": 0.004, "hold": 25, "amplitude": 2.0},
    ]
    scenario = load_scenario(str(write(tmp_path, {"excitation": parts})))
    signal = scenario.design(scenario.seed)
    doublets = len(signal.u) - 125 - 31 * 25
    assert doublets > 0 and not signal.u[doublets : doublets + 125].any()
    assert (np.abs(signal.u[-31 * 25 :]) == 2.0).all() and signal.recipe.kind == "in_sequence"
    unknown = write(tmp_path, {"excitation": [parts[0] | {"unit_ms": 3}]})
    with pytest.raises(
        ExciteError, match=r"short\.toml: excitation\[0\]\.unit_ms: unknown key for a multistep; did you mean"
    ):
        load_scenario(str(unknown))


def test_a_plant_that_samples_at_uneven_times_is_refused_by_its_own_name(tmp_path):
    source = tomllib.loads(shipped()["thermal_step"].read_text(encoding="utf-8"))
    source["plant"].setdefault("parameters", {})["samples_per_decade"] = 20.0
    path = tmp_path / "uneven.toml"
    path.write_text(tomli_w.dumps(source), encoding="utf-8")
    code, _, err = excite("run", path, "-o", tmp_path / "out")
    assert (
        code == 2 and "plant.parameters: they have the plant sample at uneven times" in err and "log_times" not in err
    )
