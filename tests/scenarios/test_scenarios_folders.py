"""Run folders: foreign, locked, damaged, and what a killed run leaves."""

import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib

import pytest
from short_scenario import changed, excite, pieces, run, scores, write

from excite.errors import ExciteError
from scenarios.run.store import open_folder


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
