"""The main job: `excite run quadrotor_prbs`, from scenario to report, and what it claims."""

import json
import re

import pytest
from paths import ROOT

from scenarios.cli.main import status

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("main") / "run"
    assert status(["run", "quadrotor_prbs", "-o", str(target)]) == 0
    return target


@pytest.fixture(scope="module")
def scores(folder):
    return json.loads((folder / "scores.json").read_text())


def rows(scores, view):
    return scores["views"][view]["ranking"]


def median(row, metric):
    return row["metrics"][metric]["median"]


def test_every_expectation_is_met(scores):
    assert len(scores["expectations"]) >= 4 and all(e["met"] for e in scores["expectations"])


def test_the_truth_forgets_and_the_floor_is_that_of_the_facts(scores):
    assert scores["views"]["rates"]["predictor_spectral_radius"] < 0.97
    name, floor = scores["views"]["attitude"]["floor"]
    assert name == "fit_clean" and floor == pytest.approx(97.4, abs=1.0)


@pytest.mark.parametrize("view", ["rates", "attitude"])
def test_the_best_method_is_within_three_points_of_the_floor(scores, view):
    best = rows(scores, view)[0]
    name, floor = scores["views"][view]["floor"]
    assert median(best, "fit_below_floor") <= 3
    assert floor - median(best, name) <= 3


def test_the_open_loop_method_is_visibly_biased_in_closed_loop(scores):
    by_method = {row["method"]: row for row in rows(scores, "rates")}
    assert not by_method["po_moesp"]["consistent_in_closed_loop"]
    for sound in ("iem", "ssarx"):
        assert median(by_method["po_moesp"], "pole_error_max") > 2.5 * median(by_method[sound], "pole_error_max")
        assert median(by_method["po_moesp"], "frf_error_h2") > 1.3 * median(by_method[sound], "frf_error_h2")
        assert median(by_method[sound], "pole_error_max") < 0.06
    assert rows(scores, "rates")[0]["method"] in ("iem", "ssarx")


def test_decimation_and_horizons_are_shown_with_their_reason(scores):
    rates, attitude = (scores["views"][name] for name in ("rates", "attitude"))
    assert rates["dt"] == pytest.approx(0.002) and rates["decimation"] == 1
    assert attitude["dt"] == pytest.approx(0.004 * attitude["decimation"]) and attitude["decimation"] > 1
    for view in (rates, attitude):
        assert any("slowest pole" in note for note in view["rule"])
        assert any(note.startswith(f"past {view['past']} rows") for note in view["rule"])


def test_the_folder_holds_everything(folder):
    for name in (
        "scenario.toml",
        "excitation.csv",
        "excitation.csv.json",
        "certificate.json",
        "scores.json",
        "report.html",
    ):
        assert (folder / name).stat().st_size > 0, name
    assert len(list(folder.glob("recordings/*.npz"))) == 6
    assert len(list(folder.glob("models/*/*/run_*.json"))) == 32
    assert {"excitation", "rates-poles", "attitude-bode", "attitude-outputs"} <= {
        p.stem for p in folder.glob("figures/*.svg")
    }


def test_the_readme_shows_this_table(folder, capsys):
    assert status(["run", "quadrotor_prbs", "-o", str(folder)]) == 0
    printed = capsys.readouterr().out
    shown = re.search(r"<!-- table of excite run quadrotor_prbs -->\n```text\n(.*?)```", README, re.DOTALL)[1]
    assert table(shown) and table(shown).keys() == table(printed).keys()
    for key, values in table(shown).items():
        assert table(printed)[key] == pytest.approx(values, rel=0.1, abs=0.05), key


def table(text):
    """(view, rank, method) -> the numbers of each ranked row, quartiles aside."""
    found, view = {}, None
    for line in text.splitlines():
        if match := re.match(r"== (\w+):", line):
            view = match[1]
        elif match := re.match(r"\s+(\d+)\s+(\w+)\s+(\d+)\s+(.*)", line):
            numbers = re.sub(r"\[.*?\]", "", match[4]).replace("–", "0").split()
            found[view, int(match[1]), match[2]] = [float(v) for v in numbers]
    return found
