"""What fails in one row, or in one plug-in, stays there; what is asked wrongly is refused by place and remedy."""

import json
import tomllib
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from breaking import breakers, excite, put_on_path, record, scenario, source
from installed import install, python

from excite.errors import ExciteError
from excite.types.experiment import Experiment
from identify.compare import compare
from identify.entries import Entry, entries
from identify.figures.registry import FIGURES
from identify.metrics.registry import METRICS
from identify.registry import load_method
from scenarios.run.design import make_design
from scenarios.run.pieces import stems_of
from scenarios.scenario.reading import check_scenario, shipped

ERRORS = {
    "LinAlgError": "LinAlgError: SVD did not converge",
    "MemoryError": "MemoryError",
    "ValueError": "ValueError: no such value",
    "SystemExit": "SystemExit: 3",
    "Odd": "Odd",
}


def rows_of(path):
    """Rows of comparison.json or of the one view of scores.json."""
    result = json.loads(path.read_text(encoding="utf-8"))
    return result["rows"] if "rows" in result else result["views"]["plant"]["ranking"]


def assert_one_row_failed(rows, err, reason):
    failed = [row for row in rows if row["method"] == "breaking"]
    assert len(rows) == 3 and rows[-1:] == failed and failed[0]["reason"] == reason
    assert all(row["reason"] is None and row["metrics"]["fit_simulation"]["median"] > 50 for row in rows[:-1])
    traceback = failed[0]["failures"][0]["traceback"]
    assert (
        traceback.startswith("Traceback")
        and "breakers.py" in traceback
        and failed[0]["failures"][0]["reason"] == reason
    )
    warnings = [line for line in err.splitlines() if line.startswith("warning:")]
    assert len(warnings) == 1 and reason in warnings[0] and "the traceback is in" in warnings[0]
    assert "Traceback" not in err


# A row fails alone ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("error", "reason"), ERRORS.items())
def test_whatever_a_method_raises_in_compare_is_that_rows_failure(error, reason, tmp_path, monkeypatch):
    breakers(tmp_path, monkeypatch)
    argv = ("--methods", f"arx,breaking(error={error}),ssarx", "--orders", "2", "-o", tmp_path / "out")
    for _ in range(2):  # the second time from the folder
        code, out, err = excite("compare", *record(tmp_path), *argv)
        assert code == 0 and f"breaking n=2 failed: {reason}" in out
        assert_one_row_failed(rows_of(tmp_path / "out/comparison.json"), err, reason)
    assert not (tmp_path / "out/breaking-n2.json").exists() and (tmp_path / "out/ssarx-n2.json").exists()


@pytest.mark.parametrize(
    ("error", "jobs"), [("LinAlgError", 1), ("MemoryError", 2), ("ValueError", 1), ("SystemExit", 2)]
)
def test_whatever_a_method_raises_in_a_run_is_that_rows_failure(error, jobs, tmp_path, monkeypatch):
    reason = ERRORS[error]
    breakers(tmp_path, monkeypatch)
    methods = source()["method"]
    methods.insert(1, {"name": "breaking", "order": 2, "settings": {"error": error}})
    path = scenario(tmp_path, method=methods)
    code, out, err = excite("run", path, "-o", tmp_path / "out", "--jobs", jobs)
    assert code == 0 and reason in out and (tmp_path / "out/report.html").exists()
    assert_one_row_failed(rows_of(tmp_path / "out/scores.json"), err, reason)
    assert reason.replace("'", "&#x27;") in (tmp_path / "out/report.html").read_text(encoding="utf-8")


def test_where_every_row_fails_the_report_is_written_and_the_code_is_2(tmp_path, monkeypatch):
    breakers(tmp_path, monkeypatch)
    code, out, err = excite(
        "compare", *record(tmp_path), "--methods", "breaking,nothing", "--orders", "2", "-o", tmp_path / "out"
    )
    assert code == 2 and "no method gave a model" in err and "breaking n=2 failed" in out
    reasons = {row["method"]: row["reason"] for row in rows_of(tmp_path / "out/comparison.json")}
    assert reasons["nothing"] == "nothing: realize returned a NoneType; it must return an Estimate"
    path = scenario(tmp_path, method=[{"name": "breaking", "order": 2}])
    code, out, err = excite("run", path, "-o", tmp_path / "run", "--jobs", "1")
    assert code == 2 and "no method gave a model" in err and "no such value" in out
    assert (tmp_path / "run/report.html").exists() and (tmp_path / "run/figures/excitation.svg").exists()
    assert rows_of(tmp_path / "run/scores.json")[0]["failures"][1]["data"] == "run 1"


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_a_plug_in_prints_is_no_result(jobs, tmp_path):
    site = breakers(tmp_path)
    argv = ("--methods", "arx,breaking", "--orders", "2", "-o", tmp_path / "out", "--json")
    code, out, err = python("-m", "excite", "compare", *record(tmp_path), *argv, path=[site])
    assert code == 0 and json.loads(out)["rows"] and "not for stdout" in err and "at import" in err
    path = scenario(tmp_path, method=[*source()["method"], {"name": "breaking", "order": 2}])
    argv = ("-m", "excite", "run", path, "-o", tmp_path / "run", "--jobs", jobs, "--json")
    code, out, err = python(*argv, path=[site])
    assert code == 0 and json.loads(out)["views"] and "not for stdout" in err


def test_an_interrupt_is_no_failure_of_a_row(tmp_path, monkeypatch):
    breakers(tmp_path, monkeypatch)
    argv = ("--methods", "arx,breaking(error=KeyboardInterrupt)", "--orders", "2", "-o", tmp_path / "out")
    code, out, err = excite("compare", *record(tmp_path), *argv)
    assert (code, out) == (130, "") and "finished fits are kept" in err
    assert [path.name for path in (tmp_path / "out/trials").iterdir()] == ["arx-n2.json"]
    settings = {"error": "KeyboardInterrupt"}
    path = scenario(tmp_path, method=[{"name": "breaking", "order": 2, "settings": settings}])
    assert excite("run", path, "-o", tmp_path / "run", "--jobs", "1")[0] == 130


METRIC = """
from identify.metrics.metric import Metric

def raising(judgement):
    raise SystemExit("no licence")

BROKEN = Metric("broken", "raises", raising, "Nothing.", "Nothing.", header="broken", unit="–")
TEXT = Metric("text", "no number", lambda judgement: "abc", "Nothing.", "Nothing.", header="text", unit="–")

def broken_figure(comparison):
    raise SystemExit("no ink")

def no_figure(comparison):
    from dataclasses import replace
    from identify.figures.ranking import ranking
    return replace(ranking(comparison), panels=(3,))
"""


def test_a_metric_or_a_figure_of_a_plug_in_that_raises_says_why_and_the_run_goes_on(tmp_path, monkeypatch):
    points = {
        "excite.metrics": {"broken": "judges:BROKEN", "text": "judges:TEXT"},
        "excite.figures": {"broken": "judges:broken_figure", "none": "judges:no_figure"},
    }
    put_on_path(
        install(tmp_path / "site", "excite-judges", {"judges.py": METRIC}, points), monkeypatch, METRICS, FIGURES
    )
    code, _, err = excite("run", scenario(tmp_path), "-o", tmp_path / "out", "--jobs", "1")
    assert code == 0 and "Traceback" not in err
    for row in rows_of(tmp_path / "out/scores.json"):
        assert row["reason"] is None and row["reasons"]["broken"] == "SystemExit: no licence"
        assert row["reasons"]["text"].startswith("ValueError: could not convert")
    assert "SystemExit: no ink" in (tmp_path / "out/figures/plant-broken.svg").read_text(encoding="utf-8")
    assert "plant-none could not" in (tmp_path / "out/figures/plant-none.svg").read_text(encoding="utf-8") or (
        "none could not be drawn" in (tmp_path / "out/report.html").read_text(encoding="utf-8")
    )


# Settings ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [{"a": 1}, {1, 2}, [{"a": 1}], [[{1}]]], ids=str)
def test_unhashable_settings_are_refused_in_python(value):
    with pytest.raises(
        ExciteError, match=r"ssarx\.past(\[0\])*: a (dict|set) cannot be a setting; give numbers, text, lists"
    ):
        load_method("ssarx", past=value)


@pytest.mark.parametrize("text", ["{a = 1}", "[{a = 1}]", "nan", "inf", "-3", "0", "1e30", "true", "1979-05-27", '""'])
def test_bad_settings_are_refused_on_the_command_line_and_in_a_scenario(text, tmp_path):
    argv = ("--orders", "2", "-o", tmp_path / "out")
    asked = (("ssarx", "--set", f"past={text}"), (f"ssarx(past={text})",))
    for methods in asked:
        code, out, err = excite("compare", *record(tmp_path), "--methods", *methods, *argv)
        assert (code, out) == (2, "") and "ssarx.past" in err and "give" in err and "Traceback" not in err
    value = tomllib.loads(f"v = {text}")["v"]
    path = scenario(tmp_path, method=[{"name": "ssarx", "order": 2, "settings": {"past": value}}])
    code, out, err = excite("run", path, "-o", tmp_path / "out")
    assert (code, out) == (2, "") and "short.toml: method[0].settings: ssarx.past" in err and "Traceback" not in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("size", [10**9, 2**63 - 1])
def test_huge_settings_are_a_reason_in_words(size, tmp_path):
    argv = ("--methods", f"arx,ssarx(past={size}),po_moesp(block_rows={size})", "--orders", "2", "-o", tmp_path / "out")
    code, _, err = excite("compare", *record(tmp_path), *argv)
    rows = rows_of(tmp_path / "out/comparison.json")
    assert code == 0 and "warning" not in err and rows[0]["reason"] is None
    assert all("the largest possible" in row["reason"] for row in rows[1:])


# Twins and labels ----------------------------------------------------------------------------------------------------------


def test_two_settings_of_one_method_stand_side_by_side(tmp_path):
    argv = ("--methods", "ssarx(past=30),ssarx", "--orders", "2,3", "-o", tmp_path / "out")
    assert excite("compare", *record(tmp_path), *argv)[0] == 0
    rows = rows_of(tmp_path / "out/comparison.json")
    labels = {row["label"] for row in rows}
    assert len(rows) == 4 and len(labels) == 2 and "ssarx past=30" in labels
    assert len(list((tmp_path / "out").glob("ssarx*-n?.json"))) == 4
    methods = [
        {"name": "ssarx", "order": 4, "label": label, "settings": {"past": past, "future": 6}}
        for label, past in (("short past", 8), ("long past", 16))
    ]
    path = scenario(tmp_path, method=methods, expect={"long past.fit_simulation.median": "> 50"})
    assert excite("run", path, "-o", tmp_path / "run", "--jobs", "1")[0] == 0
    assert {row["label"] for row in rows_of(tmp_path / "run/scores.json")} == {"short past", "long past"}
    kept = [json.loads(p.read_text()) for p in (tmp_path / "run/models/plant").glob("*_past-n4/run_00.json")]
    assert sorted(trial["estimate"]["settings"]["past"] for trial in kept) == [8, 16]


def test_equal_twins_are_refused(tmp_path):
    for methods in ("arx,arx", "arx(delay=1),arx"):
        code, out, err = excite("compare", *record(tmp_path), "--methods", methods, "-o", tmp_path / "out")
        assert (code, out) == (2, "") and "arx of order 2 stands there twice with the same settings" in err
    settings = {"past": 8, "future": 6}
    for other in ({}, {"stability_guard": load_method("ssarx").settings().get("stability_guard", True)}):
        twins = [
            {"name": "ssarx", "order": 4, "label": label, "settings": given}
            for label, given in (("a", settings), ("b", settings | other))
        ]
        code, out, err = excite("run", scenario(tmp_path, method=twins), "-o", tmp_path / "out")
        assert (code, out) == (2, "") and "twice" in err and "short.toml: method" in err
    assert not (tmp_path / "out").exists()
    assert len(entries(["arx"], [2, 2])[0].orders) == 1


HOSTILE = [
    "../x",
    "a/b",
    "a\\b",
    "",
    "x" * 300,
    "CON",
    "con",
    "nul.txt",
    "Con",
    "..",
    "/etc/x",
    "\0",
    "é",
    "É",
    "comparison",
]


def test_labels_name_files_in_the_folder_that_stay_apart():
    found = stems_of([Entry(label, load_method("arx"), (2, None)) for label in HOSTILE], reserved=("comparison",))
    stems = list(found.values())
    assert len({stem.casefold() for stem in stems}) == 2 * len(HOSTILE) and "comparison" not in stems
    assert all(
        0 < len(stem) < 100 and not set(stem) & set('/\\\0:*?"<>|') and stem.strip(".") == stem for stem in stems
    )
    assert not {stem.casefold() for stem in stems} & {"con", "nul", "nul.txt"}
    clash = stems_of([Entry("a-n2", load_method("arx"), (None,)), Entry("a", load_method("arx"), (2,))])
    assert len(set(clash.values())) == 2


@pytest.mark.parametrize("label", ["", "x" * 300, " x", "a.b", "\x1b[2J", "best"])
def test_labels_that_a_scenario_cannot_have(label):
    with pytest.raises(ExciteError, match=r"x: method\[0\]\.label: .*(at most 60 characters|the best method)"):
        check_scenario(source(method=[{"name": "arx", "order": 2, "label": label}]), "x")


def test_hostile_labels_write_nothing_outside_and_overwrite_nothing(tmp_path):
    labels = ["/tmp/x", "a/b", "a\\b", "CON", "A", "a", "<b>"]
    methods = [{"name": "arx", "order": 2, "label": label, "settings": {"delay": k}} for k, label in enumerate(labels)]
    home = tmp_path / "home"
    home.mkdir()
    path = scenario(home, method=methods)
    assert excite("run", path, "-o", home / "out", "--jobs", "1")[0] == 0
    assert [p.name for p in tmp_path.iterdir()] == ["home"] and {p.name for p in home.iterdir()} == {
        "out",
        "short.toml",
    }
    rows = rows_of(home / "out/scores.json")
    assert {row["label"] for row in rows} == set(labels)
    kept = [json.loads(p.read_text()) for p in (home / "out/models").rglob("run_00.json")]
    assert {(t["label"], t["estimate"]["settings"]["delay"]) for t in kept} == {(n, k) for k, n in enumerate(labels)}
    assert "<b>" not in (home / "out/report.html").read_text(encoding="utf-8")


def test_two_labels_of_a_notebook_are_two_rows():
    u = np.random.default_rng(0).standard_normal((200, 1))
    data = Experiment(u, np.vstack([[0.0], u[:-1]]), dt=1.0)
    chosen = [Entry("a", load_method("arx"), (1,)), Entry("A", load_method("arx", delay=0), (1,))]
    found = compare(data, chosen, validation=data)
    assert {row.label for row in found.rows} == {"a", "A"}


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"methods": [3]}, "methods: 3 is none; give names"),
        ({"methods": ["nope"]}, "method 'nope' does not exist"),
        ({"rank_by": []}, "rank_by: is empty"),
        ({"rank_by": ["nope"]}, "metric 'nope' does not exist"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_any_fit(given, text):
    data = Experiment(np.arange(20.0), np.arange(20.0), dt=1.0)
    with pytest.raises(ExciteError, match=text):
        compare(data, **{"methods": ["arx"], "orders": 2, **given}, store=FIXED)


FIXED = MappingProxyType({})  # nothing can be put there


# Old words, and parts --------------------------------------------------------------------------------------------------------


def test_old_words_are_refused_with_the_new_ones(tmp_path):
    given = source()
    given["setting"] = given.pop("view")
    with pytest.raises(ExciteError, match=r"x: setting: is called 'view' now.*rename \[\[setting\]\] to \[\[view\]\]"):
        check_scenario(given, "x")
    with pytest.raises(ExciteError, match=r"x: method\[0\]\.setting: is called 'view' now"):
        check_scenario(source(method=[{"name": "arx", "order": 2, "setting": "plant"}]), "x")
    for command in ("compare", "identify"):
        more = ("--methods", "arx") if command == "compare" else ("--method", "arx")
        code, out, err = excite(command, *record(tmp_path), *more, "--setting", "rates", "-o", tmp_path / "out")
        assert (code, out) == (2, "") and "--setting" in err and "--view" in err


@pytest.mark.parametrize("name", ["two_mass_spring", "quadrotor_prbs"])
def test_an_excitation_in_two_parts_is_judged_as_the_same_in_one(name):
    given = tomllib.loads(shipped()[name].read_text(encoding="utf-8"))
    del given["expect"]
    given["view"] = [{"name": view["name"]} for view in given["view"]]
    part = given["excitation"] | {"periods": 1}
    halves = check_scenario(given | {"excitation": [part, part]}, "x")
    parts = make_design(halves)
    one = replace(parts.signal, recipe=None)  # the same samples, and nothing that tells of parts
    whole = make_design(check_scenario(given | {"excitation": part | {"periods": 2}}, "x"), one)
    assert whole.signal.hold == parts.signal.hold == part["hold"]
    assert parts.horizons == whole.horizons and parts.warnings == whole.warnings
    assert all(rule.every > 1 for view, rule in parts.horizons.items() if view != "rates")
