"""What a folder keeps: nothing finished is made twice, what has changed is made again, and nothing else is touched."""

import json
import os
import pickle
import signal
import subprocess
import sys
import time

import pytest
import tomli_w
from breaking import breakers, excite, put_on_path, record, scenario, source
from installed import install, python
from paths import ROOT

from excite.errors import ExciteError
from identify.compare import compare
from identify.examples import series
from identify.metrics.registry import METRICS
from identify.registry import METHODS, load_method
from scenarios.run.plan import make_plan
from scenarios.run.run import run_scenario
from scenarios.run.store import Store, hold, open_folder
from scenarios.scenario.reading import check_scenario

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
LOGGED = {"name": "logged", "order": 4}


def times(folder, room="."):
    """Every kept piece with the time it was written."""
    rooms = ("trials", "models", "recordings")
    files = [p for p in (folder / room).rglob("*") if p.is_file() and p.relative_to(folder).parts[0] in rooms]
    return {p.relative_to(folder).as_posix(): p.stat().st_mtime_ns for p in files}


def rows(path):
    """Rows of a result without what depends on the clock or the folder."""
    result = json.loads(path.read_text(encoding="utf-8"))
    return result.get("rows") or [view["ranking"] for view in result["views"].values()]


def run(folder, **changes):
    """Run the short scenario in a folder, in this process; return its notes and what is old."""
    result = run_scenario(check_scenario(source(**changes), "short.toml"), folder)
    return result.notes, result.old


# Killed ------------------------------------------------------------------------------------------------------------------


def killed_when(there, argv, site, log, wait_s="0.4"):
    """Start a command, kill it as soon as `there` says so, and return the lines that the logged method wrote."""
    path = os.pathsep.join(map(str, (site, ROOT)))
    environment = {**os.environ, "PYTHONPATH": path, "EXCITE_TEST_LOG": str(log), "EXCITE_TEST_WAIT": wait_s}
    process = subprocess.Popen(
        [sys.executable, "-m", "excite", *map(str, argv)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    give_up = time.monotonic() + 120
    while not there():
        assert process.poll() is None and time.monotonic() < give_up, process.communicate()
        time.sleep(0.005)
    process.kill()
    process.communicate()
    wait_until_gone(process.pid)
    return log.read_text(encoding="utf-8").splitlines()


def wait_until_gone(group):
    """Wait until no process of a group is left, or fail."""
    give_up = time.monotonic() + 30
    while time.monotonic() < give_up:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    os.killpg(group, signal.SIGKILL)
    pytest.fail("processes were left behind")


@POSIX
def test_killed_compare_goes_on_and_computes_nothing_twice(tmp_path, monkeypatch):
    site, log, out = breakers(tmp_path, monkeypatch), tmp_path / "log", tmp_path / "out"
    argv = ("compare", *record(tmp_path), "--methods", "logged,ssarx", "--orders", "1:6", "-o", out)
    killed_when(lambda: len(list(out.glob("trials/*.json"))) >= 2, argv, site, log)
    before = times(out)
    assert len(before) >= 2 and not (out / "comparison.json").exists()
    log.unlink()
    monkeypatch.setenv("EXCITE_TEST_LOG", str(log))
    assert excite(*argv)[0] == 0
    after, made = times(out), log.read_text(encoding="utf-8").splitlines()
    assert {name: after[name] for name in before} == before and len(after) == 12
    assert len(made) == len(set(made)) == 6 - len([name for name in before if "logged" in name])
    assert excite(*argv)[0] == 0 and log.read_text(encoding="utf-8").splitlines() == made and times(out) == after
    assert excite(*argv[:-1], tmp_path / "whole")[0] == 0
    assert rows(out / "comparison.json") == rows(tmp_path / "whole/comparison.json")
    assert not [p for p in out.rglob(".*") if p.name != ".lock"]


@POSIX
@pytest.mark.parametrize("jobs", [1, 2])
def test_killed_run_goes_on_and_computes_nothing_twice(jobs, tmp_path, monkeypatch):
    site, log, out = breakers(tmp_path, monkeypatch), tmp_path / "log", tmp_path / "out"
    path = scenario(tmp_path, method=[{"name": "logged", "orders": [1, 2, 3, 4]}], data={"estimation_runs": 3})
    argv = ("run", path, "-o", out, "--jobs", jobs)
    killed_when(lambda: len(list(out.rglob("models/plant/*/run_*.json"))) >= 2, argv, site, log, "0.3")
    before = times(out)
    log.unlink()
    monkeypatch.setenv("EXCITE_TEST_LOG", str(log))
    assert excite(*argv)[0] == 0
    after, made = times(out), log.read_text(encoding="utf-8").splitlines()
    assert {name: after[name] for name in before} == before
    assert len(made) == 12 - len([name for name in before if name.startswith("models/")])
    assert excite("run", path, "-o", tmp_path / "whole", "--jobs", "1")[0] == 0
    assert rows(out / "scores.json") == rows(tmp_path / "whole/scores.json")


# What changes, and what does not ---------------------------------------------------------------------------------------------


def test_one_methods_setting_remakes_its_trials_alone_and_the_rest_is_old(tmp_path):
    out = tmp_path / "out"
    ssarx = source()["method"][1]
    run(out)
    before = times(out)
    other = ssarx | {"settings": {"past": 9, "future": 6}}
    notes, old = run(out, method=[source()["method"][0], other])
    after = times(out)
    changed = {name for name in before if after[name] != before[name]}
    assert (notes, old) == ((), ()) and changed == {f"models/plant/ssarx-n4/run_0{k}.json" for k in range(2)}
    notes, old = run(out, method=[other])
    assert notes == () and old == tuple(f"models/plant/arx-n4/run_0{k}.json" for k in range(2))
    assert times(out) == after


def test_compare_lists_what_it_is_no_longer_asked_for(tmp_path):
    argv = ("compare", *record(tmp_path), "-o", tmp_path / "out", "--orders", "2,3", "--methods")
    assert excite(*argv, "arx,ssarx")[0] == 0
    before = times(tmp_path / "out")
    code, out, _ = excite(*argv, "ssarx")
    old = ["arx-n2.json", "arx-n3.json", "trials/arx-n2.json", "trials/arx-n3.json"]
    assert code == 0 and times(tmp_path / "out") == before and f"old: not asked for this time: {', '.join(old)}" in out
    assert json.loads((tmp_path / "out/comparison.json").read_text())["old"] == old


def test_a_model_of_other_data_does_not_outlive_a_fit_that_fails(tmp_path):
    argv = ("compare", *record(tmp_path), "-o", tmp_path / "out", "--methods", "arx,ssarx", "--orders", "6")
    assert excite(*argv)[0] == 0 and (tmp_path / "out/ssarx-n6.json").exists()
    record(tmp_path, 40)
    code, _, _ = excite(*argv)
    assert code == 0 and not (tmp_path / "out/ssarx-n6.json").exists() and (tmp_path / "out/arx-n6.json").exists()


def test_labels_remake_nothing_also_when_they_change_places(tmp_path, monkeypatch):
    breakers(tmp_path, monkeypatch)
    monkeypatch.setenv("EXCITE_TEST_LOG", str(tmp_path / "log"))
    out = tmp_path / "out"
    first, second = LOGGED | {"settings": {"delay": 1}}, LOGGED | {"settings": {"delay": 2}}
    for labels in (("a", "b"), ("b", "a"), ("a b", "a/b"), ("a/b", "a b"), ("c", "C")):
        notes, old = run(out, method=[first | {"label": labels[0]}, second | {"label": labels[1]}])
        kept = [json.loads(path.read_text(encoding="utf-8")) for path in out.glob("models/plant/*/run_*.json")]
        assert {(trial["label"], trial["estimate"]["settings"]["delay"]) for trial in kept} == {
            *zip(labels, (1, 2), strict=True)
        }
        assert (notes, old, len(kept)) == ((), (), 4) and len(list(out.glob("models/plant/*"))) == 2
    assert len((tmp_path / "log").read_text().splitlines()) == 4
    argv = ("compare", *record(tmp_path), "-o", tmp_path / "compared", "--orders", "2", "--methods")
    for methods in ("logged(delay=2),logged", "logged", "logged,logged(delay=2),arx", "logged(delay=2)"):
        assert excite(*argv, methods)[0] == 0
    assert len((tmp_path / "log").read_text().splitlines()) == 6


def test_another_seed_is_another_content_everywhere():
    def keys(seed):
        plan = make_plan(check_scenario(source(seed=seed), "x"))
        return {flight.key for flight in plan.flights}, set(plan.slots())

    for one, other in zip(keys(3), keys(30), strict=True):
        assert len(one) > 1 and not one & other
    assert keys(3) == keys(3)


def test_pieces_of_another_code_are_made_again_and_that_is_said_once(tmp_path, monkeypatch):
    out, argv = tmp_path / "out", ("compare", *record(tmp_path), "-o", tmp_path / "compared", "--methods", "arx,ssarx")
    run(out)
    assert excite(*argv)[0] == 0 and run(out) == ((), ())
    monkeypatch.setattr("scenarios.run.pieces.code_digest", lambda *packages: f"other {packages}")
    before, compared = times(out), times(tmp_path / "compared")
    (note,), old = run(out)
    after = times(out)
    assert note.startswith(f"{len(after) + 2} pieces were made by another version of the code") and old == ()
    assert all(after[name] != before[name] for name in before) and run(out) == ((), ())
    code, _, err = excite(*argv)
    assert code == 0 and err.count("10 pieces were made by another version of the code") == 1
    assert all(stamp != compared[name] for name, stamp in times(tmp_path / "compared").items())
    assert "another version" not in excite(*argv)[2]


def test_pieces_of_another_version_of_a_plug_in_are_made_again_alone(tmp_path, monkeypatch):
    site, out = breakers(tmp_path, monkeypatch), tmp_path / "out"
    monkeypatch.setenv("EXCITE_TEST_LOG", str(tmp_path / "log"))
    methods = [LOGGED, source()["method"][0]]
    run(out, method=methods)
    before = times(out)
    argv = ("compare", *record(tmp_path), "-o", tmp_path / "compared", "--orders", "2", "--methods", "logged,arx")
    assert excite(*argv)[0] == 0
    metadata = site / "excite_breakers-0.1.dist-info/METADATA"
    metadata.write_text(metadata.read_text().replace("Version: 0.1", "Version: 0.2"))
    monkeypatch.delitem(METHODS.__dict__, "_plugins")
    (note,), _ = run(out, method=methods)
    assert note.startswith("2 pieces were made by another version of the code or of a plug-in")
    changed = {name for name, stamp in times(out).items() if stamp != before[name]}
    assert changed == {f"models/plant/logged-n4/run_0{k}.json" for k in range(2)}
    assert "1 piece was made by another version" in excite(*argv)[2]


def test_a_metric_that_comes_with_a_package_is_found_for_what_was_kept(tmp_path, monkeypatch):
    run(tmp_path / "out")
    text = "from identify.metrics.fits import FIT_SIMULATION as MINE\n"
    site = install(
        tmp_path / "site", "excite-mine", {"mine_metric.py": text}, {"excite.metrics": {"mine": "mine_metric:MINE"}}
    )
    put_on_path(site, monkeypatch, METRICS)
    (note,), _ = run(tmp_path / "out")
    assert note.startswith("4 pieces were made by another version of the code or of a plug-in")
    for row in rows(tmp_path / "out/scores.json")[0]:
        assert row["metrics"]["mine"] == row["metrics"]["fit_simulation"]


# Damage, and folders of others -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b[:50] + bytes([b[50] ^ 1]) + b[51:], lambda b: b""]
)
@pytest.mark.parametrize("piece", ["trials/arx-n2.json", "excitation.csv", "recordings/estimation_00.npz"])
def test_a_damaged_piece_is_refused_by_name_with_the_remedy(piece, damage, tmp_path):
    if piece.startswith("trials"):
        argv = ("compare", *record(tmp_path), "-o", tmp_path / "out", "--methods", "arx", "--orders", "2")
    else:
        argv = ("run", scenario(tmp_path), "-o", tmp_path / "out", "--jobs", "1")
    assert excite(*argv)[0] == 0
    path = tmp_path / "out" / piece
    path.write_bytes(damage(path.read_bytes()))
    code, out, err = excite(*argv)
    assert (code, out) == (2, "") and f"{path}: is damaged" in err and "delete it, and the same command makes it" in err
    path.unlink()
    assert excite(*argv)[0] == 0


def test_a_piece_that_was_being_replaced_when_the_run_was_killed_is_made_again(tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(out)
    other = [source()["method"][0], source()["method"][1] | {"settings": {"past": 9, "future": 6}}]
    enter = Store._enter

    def killed(*given, **more):
        enter(*given, **more)
        raise KeyboardInterrupt

    monkeypatch.setattr(Store, "_enter", killed)
    with pytest.raises(KeyboardInterrupt):
        run(out, method=other)
    monkeypatch.undo()
    assert run(out, method=other) == ((), ()) and run(out) == ((), ())


def test_a_folder_of_before_the_index_is_refused_and_left_alone(tmp_path):
    old = tmp_path / "old"
    (old / "recordings").mkdir(parents=True)
    (old / "scenario.toml").write_text(tomli_w.dumps(source()))
    (old / "excitation.csv").write_text("t,u\n0,1\n")
    (old / "recordings/estimation_00.npz").write_bytes(b"PK")
    (old / "recordings/.mine.tmp").write_text("the user's own")
    before = {path: path.stat().st_mtime_ns for path in old.rglob("*")}
    code, out, err = excite("run", scenario(tmp_path), "-o", old, "--jobs", "1")
    assert (code, out) == (2, "") and "holds a run of an earlier version" in err and "choose another folder" in err
    argv = ("compare", *record(tmp_path), "--methods", "arx", "--orders", "2", "-o")
    code, out, err = excite(*argv, old)
    assert (code, out) == (2, "") and "holds a run of a scenario; choose another folder" in err
    assert {path: path.stat().st_mtime_ns for path in old.rglob("*")} == before
    compared = tmp_path / "compared"
    compared.mkdir()
    (compared / "comparison.json").write_text("{}")
    code, out, err = excite(*argv, compared)
    assert (code, out) == (2, "") and "holds a comparison of an earlier version" in err
    assert [path.name for path in compared.iterdir()] == ["comparison.json"]


def test_what_is_not_ours_stays_in_the_folder_of_a_comparison(tmp_path):
    mine = [tmp_path / "out/.git/.index.tmp", tmp_path / "out/.notes.tmpl", tmp_path / "out/figures/own.svg"]
    for path in mine:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    argv = ("compare", *record(tmp_path), "--methods", "arx", "--orders", "2", "-o", tmp_path / "out")
    assert excite(*argv)[0] == 0 and all(path.read_text() == "mine" for path in mine)


def test_a_second_process_in_one_folder_is_refused(tmp_path):
    argv = ("compare", *record(tmp_path), "--methods", "arx", "--orders", "2", "-o", tmp_path / "out")
    assert excite(*argv)[0] == 0
    with hold(tmp_path / "out"):
        code, out, err = python("-m", "excite", *argv)
    assert (code, out) == (2, "") and "another run is working in this folder; wait for it" in err
    assert excite(*argv)[0] == 0
    with open_folder(tmp_path / "run", source()):
        code, out, err = python("-m", "excite", "run", scenario(tmp_path), "-o", tmp_path / "run", "--jobs", "1")
    assert (code, out) == (2, "") and "another run is working in this folder" in err


@pytest.mark.parametrize("room", ["trials", "index", "comparison.json"])
def test_what_is_in_the_way_is_named(room, tmp_path):
    out = tmp_path / "out"
    (out / "index").mkdir(parents=True)
    if room == "comparison.json":
        (out / room).mkdir()
    else:
        (out / "index").rmdir()
        (out / room).write_text("a file")
    argv = ("compare", *record(tmp_path), "--methods", "arx", "--orders", "2", "-o", out)
    code, stdout, err = excite(*argv)
    assert (code, stdout) == (2, "") and str(out / room) in err and "Traceback" not in err
    if room == "index":
        code, _, err = excite("run", scenario(tmp_path), "-o", out, "--jobs", "1")
        assert code == 2 and str(out / room) in err and "Traceback" not in err


@pytest.mark.parametrize("folder", ["", "x" * 300, "a/" * 3000], ids=["empty", "long", "deep"])
def test_what_is_no_path_is_refused(folder, tmp_path, monkeypatch):
    compared = ("compare", *record(tmp_path), "--methods", "arx", "--orders", "2", "-o", folder)
    ran = ("run", scenario(tmp_path), "-o", folder, "--jobs", "1")
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for argv in (compared, ran):
        code, out, err = excite(*argv)
        assert (code, out) == (2, "") and err.startswith("excite: -o '") and "Traceback" not in err
    assert not list((tmp_path / "work").iterdir())


def test_a_folder_that_cannot_be_written_is_an_error_in_words(tmp_path, monkeypatch):
    argv = ("compare", *record(tmp_path), "--methods", "arx,ssarx", "--orders", "2", "-o", tmp_path / "out")

    def full(source, target):
        if "trials" in str(target):
            raise OSError(28, "No space left on device")
        return replace(source, target)

    replace = os.replace
    monkeypatch.setattr(os, "replace", full)
    code, out, err = excite(*argv)
    assert (code, out) == (2, "") and "cannot be written (No space left on device)" in err and "Traceback" not in err
    monkeypatch.undo()
    assert excite(*argv)[0] == 0 and len(times(tmp_path / "out")) == 2


def test_a_dictionary_keeps_trials_too():
    data, _ = series()
    store: dict = {}
    first = compare(data, ["arx"], [2], validation=data, store=store)
    again = compare(data, ["arx", load_method("arx", delay=0)], [2], validation=data, store=store)
    assert len(store) == 2 and any(row.trials[0].estimate is first.rows[0].trials[0].estimate for row in again.rows)


# Pieces -----------------------------------------------------------------------------------------------------------------------


def test_pieces_are_self_contained(tmp_path):
    plan = make_plan(check_scenario(source(), "short.toml"))
    pieces = [*plan.flights, *plan.identifications]
    here, there = tmp_path / "here", tmp_path / "there"
    for piece in pieces:
        piece.make(str(here))
    (tmp_path / "pieces").write_bytes(pickle.dumps(pickle.loads(pickle.dumps(pieces))))
    script = "import pickle, sys\nfor piece in pickle.load(open(sys.argv[1], 'rb')): piece.make(sys.argv[2])"
    assert python("-c", script, tmp_path / "pieces", there, cwd=tmp_path) == (0, "", "")
    names = sorted(times(here))
    assert len(names) == 8 and names == sorted(times(there))
    for name in names:
        one, other = (home / name for home in (here, there))
        if name.endswith(".npz"):
            assert one.read_bytes() == other.read_bytes()
        else:
            one, other = (json.loads(path.read_text()) for path in (one, other))
            assert one["estimate"].pop("seconds") > 0 < other["estimate"].pop("seconds")
            assert one == other


def test_a_piece_names_what_is_not_there(tmp_path):
    piece = make_plan(check_scenario(source(), "short.toml")).identifications[0]
    with pytest.raises(ExciteError, match=r"recordings/estimation_00\.npz"):
        piece.make(str(tmp_path))
