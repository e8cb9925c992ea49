"""Scenario files and runs: refusals that name key and remedy, folders that are whole, resumed and never shared."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from excite.errors import ExciteError, SimulationStopped
from excite.files import load_recording, load_signal
from identify.estimate_json import load_estimate
from identify.subspace.ssarx import Ssarx
from plants.quadrotor.plant import Quadrotor
from scenarios.cli.main import status
from scenarios.run.results import to_json
from scenarios.run.run import run_scenario
from scenarios.run.store import open_folder
from scenarios.scenario.spec import check_scenario, load_scenario, shipped

SHORT = """
name = "short"
seed = 3

[plant]
name = "quadrotor"

[excitation]
kind = "prbs"
order = 5
dt = 0.004
hold = 25
amplitude = [2.0, 2.0, 5.0]

[data]
estimation_runs = 2

[[view]]
name = "attitude"

[[method]]
name = "ssarx"
order = 5
settings = {past = 6, future = 5}

[[method]]
name = "arx"
orders = [2, 3]

[score]
horizons_s = [0.1]
"""
PIECES = ("recordings", "models")


def excite(*argv):
    """Run the command line in this process: (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def changed(changes):
    """The short scenario with the values at dotted paths replaced, or removed where None is given."""
    source = tomllib.loads(SHORT)
    for path, value in changes.items():
        *parents, key = path.split("/")
        table = source
        for parent in parents:
            table = table[int(parent)] if isinstance(table, list) else table.setdefault(parent, {})
        if isinstance(table, list):
            table[int(key) : int(key) + 1] = [] if value is None else [value]
        elif value is None:
            table.pop(key, None)
        else:
            table[key] = value
    return source


def write(folder, changes=()):
    path = folder / "short.toml"
    path.write_text(tomli_w.dumps(changed(dict(changes))), encoding="utf-8")
    return path


def run(folder, changes=(), runs=None, jobs=1):
    """Run the short scenario without its report; return what scores.json holds but for the folder's name."""
    scenario = check_scenario(changed({"data/estimation_runs": runs or 2, **dict(changes)}), "short.toml")
    run_scenario(scenario, folder, jobs)
    return scores(folder)


def scores(folder):
    result = json.loads((folder / "scores.json").read_text(encoding="utf-8"))
    del result["folder"]
    return result


def pieces(folder):
    """Every finished piece with the time it was written."""
    files = [p for room in PIECES for p in (folder / room).rglob("*") if p.is_file() and p.name[0] != "."]
    return {p.relative_to(folder): p.stat().st_mtime_ns for p in [*files, folder / "excitation.csv"]}


def assert_close(a, b, place="scores"):
    """Assert that two JSON values agree, their numbers to 1e-9."""
    assert type(a) is type(b), place
    if isinstance(a, dict):
        assert a.keys() == b.keys(), place
        for key in a:
            assert_close(a[key], b[key], f"{place}.{key}")
    elif isinstance(a, list):
        assert len(a) == len(b), place
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_close(x, y, f"{place}[{i}]")
    elif isinstance(a, float):
        assert a == pytest.approx(b, rel=1e-9, abs=1e-15), place
    else:
        assert a == b, place


# Refused before anything flies ------------------------------------------------------------------------------------------

OWN = {
    "view/0/name": "mine",
    "view/0/inputs": ["roll_ref"],
    "view/0/outputs": ["roll"],
    "view/0/decimate": 5,
    "score/rank_by": ["fit_one_step"],
}
REFUSALS = {
    # unknown keys, at every level
    "nam": ({"nam": "x"}, "short.toml: nam: unknown key; did you mean 'name'?"),
    "plant": ({"plant/presett": "2013"}, "short.toml: plant.presett: unknown key; did you mean 'preset'?"),
    "parameters": (
        {"plant/parameters": {"mas": 1.0}},
        "plant: quadrotor parameter 'mas' does not exist; did you mean 'mass'?",
    ),
    "noise": ({"noise/thurst": 0.1}, "short.toml: noise.thurst: unknown key; did you mean 'thrust'?"),
    "loop": ({"loop/injekt": "x"}, "short.toml: loop.injekt: unknown key; did you mean 'inject'?"),
    "excitation": (
        {"excitation/ordr": 4},
        "short.toml: excitation.ordr: unknown key for a prbs; did you mean 'order'?",
    ),
    "data": (
        {"data/estimation_run": 3},
        "short.toml: data.estimation_run: unknown key; did you mean 'estimation_runs'?",
    ),
    "view": ({"view/0/input": ["x"]}, "short.toml: view[0].input: unknown key; did you mean 'inputs'?"),
    "method": ({"method/0/ordr": 3}, "short.toml: method[0].ordr: unknown key; did you mean 'order'?"),
    "settings": ({"method/0/settings/pasts": 3}, "method[0].settings: ssarx: no setting 'pasts'; did you mean 'past'?"),
    "score": ({"score/rank": ["x"]}, "short.toml: score.rank: unknown key; did you mean 'rank_by'?"),
    "bands": (
        {"score/bands_hz": {"attitud": [1.0, 2.0]}},
        "short.toml: score.bands_hz.attitud: unknown key; did you mean",
    ),
    # wrong types and values
    "seed": ({"seed": "x"}, "short.toml: seed: 'x'; give a whole number"),
    "seed true": ({"seed": True}, "short.toml: seed: True; give a whole number"),
    "seed below 0": ({"seed": -1}, "short.toml: seed: -1; give at least 0"),
    "seed of 70 bits": ({"seed": 2**70}, "seed: 1180591620717411303424; give a whole number"),
    "plant list": ({"plant": [1]}, "short.toml: plant: [1]; give a table"),
    "plant name": ({"plant/name": "quadrotr"}, "plant 'quadrotr' does not exist; did you mean 'quadrotor'?"),
    "parameter text": (
        {"plant/parameters": {"mass": "x"}},
        "short.toml: plant: quadrotor parameter 'mass': 'x' is not a number",
    ),
    "noise nan": ({"noise/thrust": float("nan")}, "short.toml: noise.thrust: nan; give a finite number"),
    "noise switch": ({"noise/enabled": 1}, "short.toml: noise.enabled: 1; give true or false"),
    "method number": ({"method/0": 3}, "short.toml: method[0]: 3; give a table"),
    "no method": ({"method": None}, "short.toml: method: missing; give at least one [[method]]"),
    "method name": (
        {"method/0/name": "ssarxx"},
        "short.toml: method[0].name: method 'ssarxx' does not exist; did you mean",
    ),
    "view of method": ({"method/0/view": "rates"}, "method[0].view: 'rates' is not defined; known: attitude"),
    "no order": ({"method/0/order": None}, "short.toml: method[0].order: give either order"),
    "order 0": ({"method/0/order": 0}, "short.toml: method[0].order: 0; give at least 1"),
    "order -1": ({"method/0/order": -1}, "short.toml: method[0].order: -1; give at least 1"),
    "order in list": ({"method/1/orders": [2, 0]}, "short.toml: method[1].orders[1]: 0; give at least 1"),
    "order of horizon": (
        {"method/0/order": 13},
        "method[0]: view 'attitude', 155 samples of 0.02 s: ssarx: order 13 is above the largest possible, 12",
    ),
    "huge order": ({"method/0/order": 2**62}, "the largest possible, 12"),
    "horizon of data": ({"method/0/settings/past": 18}, "the largest possible past + future is 22"),
    "huge horizon": ({"method/0/settings/past": 2**62}, "the largest possible past + future is 22"),
    "twice": (
        {"method/1": {"name": "ssarx", "order": 5, "settings": {"past": 6, "future": 5}}},
        "method[1]: ssarx of order 5 stands in view 'attitude' twice",
    ),
    "view twice": (
        {"view": [{"name": "rates"}, {"name": "rates"}]},
        "short.toml: view[1].name: 'rates' is given twice",
    ),
    "view without method": (
        {"view": [{"name": "attitude"}, {"name": "rates"}], "method/0/view": "attitude", "method/1/view": "attitude"},
        "short.toml: view[1]: no method for 'rates'",
    ),
    "view name": (
        {"view/0/name": "attitud"},
        "'attitud' is no view of plant quadrotor excited at 'attitude_setpoint'; did you mean 'attitude'?",
    ),
    "path as name": ({"name": "../short"}, "short.toml: name: '../short'; use at most 60 letters, digits, _ and -"),
    "path as view": ({"view/0/name": "../rates"}, "short.toml: view[0].name: '../rates'; use at most 60 letters"),
    "long name": ({"name": "x" * 61}, "use at most 60 letters"),
    "decimate 0": ({"view/0/decimate": 0}, "short.toml: view[0].decimate: 0; give a whole number of at least 1"),
    "decimate all": ({"view/0/decimate": 1000}, "decimate: 1000 leaves one sample of 3.1 s; give at most 388"),
    "discard all": ({"data/discard_s": 4.0}, "short.toml: data.discard_s: 4 s discards the whole record of 3.1 s"),
    "discard most": ({"data/discard_s": 3.0}, "method[0]: view 'attitude', 5 samples"),
    "horizons_s": ({"score/horizons_s": [0.1, 0.0]}, "short.toml: score.horizons_s[1]: 0.0; give positive seconds"),
    "horizons_s beyond": (
        {"score/horizons_s": [1e12]},
        "short.toml: score.horizons_s[0]: 1e+12 s is beyond the 3.1 s of data",
    ),
    "rank_by": (
        {"score/rank_by": ["pole_error"]},
        "short.toml: score.rank_by[0]: 'pole_error' is no metric; did you mean",
    ),
    "rank_by empty": ({"score/rank_by": []}, "short.toml: score.rank_by: is empty"),
    "band": (
        {"score/bands_hz": {"attitude": [5.0, 1.0]}},
        "short.toml: score.bands_hz.attitude: [5.0, 1.0]; give [low, high]",
    ),
    "band over Nyquist": (
        {"score/bands_hz": {"attitude": [1.0, 60.0]}},
        "score.bands_hz.attitude[1]: 60 Hz exceeds the Nyquist frequency 25 Hz of this view (decimation 5)",
    ),
    # excitation
    "kind": ({"excitation/kind": "prsb"}, "short.toml: excitation.kind: 'prsb'; did you mean 'prbs'?"),
    "signal order": ({"excitation/order": 1}, "short.toml: excitation: prbs: order: 1"),
    "signal length": ({"excitation/order": 30}, "short.toml: excitation: prbs: order: 30"),
    "signal dt": (
        {"excitation/dt": 0.006},
        "short.toml: excitation: quadrotor: signal dt 0.006 s is not a whole multiple",
    ),
    # roles of one's own
    "role": (OWN | {"view/0/inputs": ["roll_rf"]}, "short.toml: view[0]: roles: no recorded channel 'roll_rf'; did"),
    "half of the roles": (OWN | {"view/0/outputs": None}, "short.toml: view[0].outputs: missing"),
    "role twice": (OWN | {"view/0/outputs": ["roll_ref"]}, "short.toml: view[0].outputs: 'roll_ref' is an input too"),
    "no decimation": (OWN | {"view/0/decimate": None}, "short.toml: view[0].decimate: missing"),
    "no truth to rank by": (
        OWN | {"score/rank_by": ["frf_error_h2"]},
        "score.rank_by[0]: 'frf_error_h2' needs a truth",
    ),
    # expectations
    "bound": (
        {"expect": {"best.fit_clean.median": "== 3"}},
        "expect.\"best.fit_clean.median\": '== 3'; give a comparison",
    ),
    "bound number": ({"expect": {"best.fit_clean.median": 3}}, "give a comparison such as"),
    "bound text": ({"expect": {"best.fit_clean.median": "<= 1e"}}, "give a comparison such as"),
    "key": ({"expect": {"fit_clean": "<= 3"}}, 'short.toml: expect."fit_clean": give "method.metric.statistic"'),
    "metric": ({"expect": {"best.fit_cln.median": "<= 3"}}, "'fit_cln' is not known here; did you mean 'fit_clean'?"),
    "statistic": ({"expect": {"best.fit_clean.medan": "<= 3"}}, "'medan' is not known here; did you mean 'median'?"),
    "method of key": ({"expect": {"iem.fit_clean.median": "<= 3"}}, "'iem' is not known here; known: arx, best, ssarx"),
    "view of key": ({"expect": {"rates.best.fit_clean.median": "<= 3"}}, "'rates' is not known here; known: attitude"),
    # what the plant cannot be
    "too heavy": ({"plant/parameters": {"mass": 1.0}}, "short.toml: plant: quadrotor: mass 1 kg needs"),
    "no truth": (
        {"plant/parameters": {"rate_kp": 0.0}},
        "plant.parameters: {'rate_kp': 0.0} leave view 'attitude' without",
    ),
}


@pytest.fixture
def grounded(monkeypatch):
    """Let the plant play no more than one sample."""
    fly = Quadrotor.run

    def one_sample(self, signal, **options):
        assert len(signal.u) == 1, "flew before refusing"
        return fly(self, signal, **options)

    monkeypatch.setattr(Quadrotor, "run", one_sample)


@pytest.mark.parametrize(("changes", "message"), REFUSALS.values(), ids=REFUSALS)
def test_refused_before_flight(changes, message, tmp_path, monkeypatch, grounded):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, changes)
    code, out, err = excite("run", "short.toml", "-o", "out", "--jobs", "1")
    assert (code, out) == (2, "") and message in err and "Traceback" not in err, err
    assert err.count("short.toml") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["short.toml"]


DULL = {"excitation/order": 3, "excitation/periods": 40, "view/0/decimate": 25}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"excitation/amplitude": [2.0, 31.0, 5.0]},
            "channel 'pitch_ref' reaches -31 deg, outside the plant's limits -30 to 30",
        ),
        (DULL, "ssarx n=5 needs an input persistently exciting of order 5, the design has order 2"),
    ],
    ids=["beyond the limits", "not exciting enough"],
)
def test_designs_that_are_refused(changes, message, tmp_path, grounded):
    code, out, err = excite("run", write(tmp_path, changes), "-o", tmp_path / "out", "--jobs", "1")
    assert (code, out) == (3, "") and message in err
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_scenario(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('name = "x"\nseed = = 3\n')
    code, _, err = excite("run", path)
    assert code == 2 and f"{path}: not a valid TOML file" in err and "line 2" in err
    path.write_bytes(b"\xff\xfe\x00\x01")
    assert excite("run", path)[0] == 2
    assert "neither a file nor shipped" in excite("run", tmp_path)[2]
    path.write_text("data = 3\n")
    assert "name: missing" in excite("run", path, "--runs", "3")[2]


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_are_sound(name):
    scenario = load_scenario(name)
    assert scenario.name == name and scenario.description and scenario.expect


def test_a_byte_order_mark_does_no_harm(tmp_path):
    path = tmp_path / "short.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SHORT.replace("\n", "\r\n").encode())
    assert load_scenario(str(path)).name == "short"


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_crash_names_the_parameters_and_leaves_what_was_finished(jobs, tmp_path):
    changes = {"plant/parameters": {"hover_altitude": 0.1001}}
    scenario = check_scenario(changed(changes), "short.toml")
    named = r"estimation run \d with plant.parameters .*hover_altitude.*altitude 0"
    with pytest.raises(SimulationStopped, match=named) as caught:
        run_scenario(scenario, tmp_path / "out", jobs)
    assert caught.value.exit_code == 2
    assert not list((tmp_path / "out").rglob(".*.tmp"))


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


# Folders ----------------------------------------------------------------------------------------------------------------


def test_foreign_folders_and_files_are_left_alone(tmp_path):
    scenario = write(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, _, err = excite("run", scenario, "-o", tmp_path, "--jobs", "1")
    assert code == 2 and "holds other files and no run" in err
    for out in (scenario, scenario / "inside"):
        code, _, err = excite("run", scenario, "-o", out, "--jobs", "1")
        assert code == 2 and "a file is in the way" in err
    assert sorted(tmp_path.iterdir()) == before


def test_an_unwritable_folder_is_named(tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    if os.access(closed, os.W_OK):
        pytest.skip("this user may write everywhere")
    code, _, err = excite("run", write(tmp_path), "-o", closed / "out", "--jobs", "1")
    assert code == 2 and str(closed) in err and "cannot be written" in err


def test_a_folder_in_use_is_refused_until_it_is_free(tmp_path):
    with (
        open_folder(tmp_path / "out", changed({})),
        pytest.raises(ExciteError, match="another run is working in this folder"),
    ):
        run(tmp_path / "out")
    assert run(tmp_path / "out")["views"]


def test_more_runs_go_on_from_fewer(tmp_path):
    run(tmp_path / "grown", runs=1)
    before = pieces(tmp_path / "grown")
    grown = run(tmp_path / "grown", runs=2)
    after = pieces(tmp_path / "grown")
    assert {name: after[name] for name in before} == before and len(after) == len(before) + 4
    assert tomllib.loads((tmp_path / "grown/scenario.toml").read_text())["data"]["estimation_runs"] == 2
    assert_close(grown, run(tmp_path / "once", runs=2))


def test_processes_change_nothing(tmp_path, whole):
    assert_close(run(tmp_path / "two", jobs=2), scores(whole))


@pytest.mark.parametrize(
    ("piece", "content"),
    [
        ("recordings/estimation_01.npz", b"garbage"),
        ("recordings/estimation_01.npz", 2000),
        ("recordings/validation_00.npz", b""),
        ("models/attitude/arx-n2/run_01.json", 200),
        ("models/attitude/arx-n2/run_01.json", b"[]"),
        ("models/attitude/arx-n2/run_01.json", b'{"estimate": {"kind": "polynomial"}, "score": {}}'),
    ],
    ids=lambda value: "" if isinstance(value, (bytes, int)) else value,
)
def test_a_damaged_piece_is_named_and_can_be_deleted(piece, content, tmp_path_factory, whole):
    folder = tmp_path_factory.mktemp("damaged") / "out"
    shutil.copytree(whole, folder)
    path = folder / piece
    path.write_bytes(path.read_bytes()[:content] if isinstance(content, int) else content)
    if piece.startswith("recordings"):  # one that is still needed
        (folder / "models/attitude/arx-n2/run_01.json").unlink()
    with pytest.raises(ExciteError) as caught:
        run(folder)
    assert f"{path}: is damaged" in str(caught.value) and "delete it" in str(caught.value)
    path.unlink()
    assert_close(run(folder), scores(whole))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(folder)
    return folder


def test_leftovers_of_a_killed_run_are_swept(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / ".lock").touch()
    (folder / ".scenario.toml.0123456789ab.tmp").touch()
    run(folder)
    assert list(folder.rglob("*.tmp")) == []


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


# Interrupted ----------------------------------------------------------------------------------------------------------------

LONG = {"excitation/periods": 8, "data/estimation_runs": 2}


def start(folder, changes):
    """Start a run of two processes in a session of its own and return once it has finished a flight."""
    scenario = write(folder, changes)
    process = subprocess.Popen(
        [sys.executable, "-m", "excite", "run", str(scenario), "-o", str(folder / "out"), "--jobs", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    give_up = time.monotonic() + 60
    while not list((folder / "out").glob("recordings/*.npz")):
        assert process.poll() is None and time.monotonic() < give_up, process.communicate()
        time.sleep(0.01)
    return process


def wait_until_gone(group):
    """Wait until no process of a group is left, or fail."""
    give_up = time.monotonic() + 20
    while time.monotonic() < give_up:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.killpg(group, signal.SIGKILL)
    pytest.fail("processes were left behind")


def assert_kept(before, folder):
    """Assert that pieces are as they were."""
    after = pieces(folder)
    assert len(before) > 1 and {name: after[name] for name in before} == before


@pytest.mark.skipif(sys.platform == "win32", reason="process groups and signals of POSIX")
def test_killed_run_goes_on_to_the_same_result(tmp_path):
    process = start(tmp_path, LONG)
    process.kill()
    process.communicate()
    wait_until_gone(process.pid)
    before = pieces(tmp_path / "out")
    assert not (tmp_path / "out" / "scores.json").exists()
    resumed = run(tmp_path / "out", LONG)
    assert_kept(before, tmp_path / "out")
    assert_close(resumed, run(tmp_path / "uninterrupted", LONG))


@pytest.mark.skipif(sys.platform == "win32", reason="process groups and signals of POSIX")
def test_second_run_is_refused_while_the_first_goes_on_and_ctrl_c_stops_it(tmp_path):
    process = start(tmp_path, LONG | {"data/estimation_runs": 40})
    code, _, err = excite("run", tmp_path / "short.toml", "-o", tmp_path / "out", "--jobs", "1")
    assert code == 2 and "another run is working in this folder" in err
    assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted" in err and "finished pieces are kept" in err and "Traceback" not in err, err
    wait_until_gone(process.pid)
    before = pieces(tmp_path / "out")
    assert run(tmp_path / "out", LONG, runs=1)["views"]["attitude"]["ranking"]
    assert_kept(before, tmp_path / "out")


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
