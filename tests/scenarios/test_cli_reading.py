"""How commands are laid out, and the options by which every command that reads data does so."""

import inspect
import io
import json
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module

import click
import numpy as np
import pytest
from installed import python
from paths import ROOT

from excite.files import save_experiment
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from scenarios.cli.main import COMMANDS, status

DATA = ("check", "identify", "score", "orders", "compare")
READING = {"--inputs", "--outputs", "--reference", "--dt", "--time", "--view", "--loop", "--level", "--decimate"}


def excite(*argv):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def command(name):
    module, attribute = COMMANDS[name].split(":")
    return getattr(import_module(module), attribute)


@pytest.fixture
def data(tmp_path):
    rng = np.random.default_rng(0)
    u = rng.standard_normal(300)
    y = np.convolve(u, [0, 1, 0.5, 0.2])[:300] + 0.01 * rng.standard_normal(300)
    np.savetxt(tmp_path / "data.csv", np.column_stack([u, y]), delimiter=",")
    save_experiment(Experiment(u, y, dt=0.1, loop=Loop("closed")), tmp_path / "closed.csv")
    return tmp_path


def test_every_command_is_in_the_file_of_its_name():
    files = {path.stem for path in (ROOT / "scenarios" / "cli").glob("*.py")}
    helpers = {"__init__", "entry", "main", "loading", "common", "reading", "output"}
    assert files == helpers | set(COMMANDS)
    for name in COMMANDS:
        callback = command(name).callback
        assert inspect.getmodule(callback).__name__ == f"scenarios.cli.{name}"


@pytest.mark.parametrize("name", DATA)
def test_every_command_that_reads_data_has_the_same_options(name):
    options = {option for p in command(name).params if isinstance(p, click.Option) for option in p.opts}
    assert options >= READING


def commands_on(path, model, folder):
    return {
        "check": ("check", path, "--arx", "1,1"),
        "identify": ("identify", path, "--method", "arx", "--order", "2"),
        "score": ("score", model, path),
        "orders": ("orders", path, "--method", "po_moesp", "--orders", "1:3"),
        "compare": ("compare", path, "--methods", "arx", "--orders", "2", "-o", folder),
    }


@pytest.mark.parametrize("name", DATA)
def test_loop_and_level_are_carried_and_contradictions_refused(name, data, tmp_path):
    roles, model = ("--inputs", "0", "--outputs", "1", "--dt", "0.1"), tmp_path / "m.json"
    assert excite("identify", data / "data.csv", *roles, "--method", "arx", "--order", "2", "-o", model)[0] == 0
    foreign = commands_on(data / "data.csv", model, tmp_path / "a")[name]
    for said in (("--loop", "open"), ("--loop", "closed", "--level", "zero"), ("--loop", "unknown")):
        code, _, err = excite(*foreign, *roles, *said)
        assert code == 0, err
    code, out, err = excite(*foreign, *roles, "--level", "unknown")
    assert code == 0 or (
        code == 2 and "level unknown" in out + err
    )  # refused in words by what cannot estimate the level
    own = commands_on(data / "closed.csv", model, tmp_path / "b")[name]
    assert excite(*own)[0] == 0
    code, out, err = excite(*own, "--loop", "open")
    assert (code, out) == (2, "") and "closed.csv: loop 'open' is given, but the file says 'closed'" in err
    code, out, err = excite(*own, "--level", "unknown")
    assert (code, out) == (2, "") and "level 'unknown' is given, but the file says 'zero'" in err
    assert "'known' is not one of" in excite(*own, "--level", "known")[2]


def test_the_old_word_is_refused_with_the_new_one(data):
    code, out, err = excite("identify", data / "closed.csv", "--setting", "rates", "--method", "arx", "--order", "2")
    assert (code, out) == (2, "") and "--setting rates: is called --view now; write --view rates" in err


def test_formats_say_what_they_want():
    code, out, _ = excite("formats", "ardupilot")
    assert code == 0 and "recipe    sweep, form log, dwell_cycles 2" in out and "roll [deg/s]" in out
    described = json.loads(excite("formats", "rigol", "--json")[1])["formats"]["rigol"]
    assert described["one_channel"] and described["plays"] and described["extensions"] == [".arb"]
    assert "8 to 16384 points" in described["wants"]["samples"]
    assert excite("formats", "columns")[1].splitlines()[2] == "it is read"


def test_metrics_say_what_they_are():
    out = excite("metrics", "pole_error_max")[1]
    assert out.startswith("pole_error_max: ") and "smaller is better; 0 for a perfect model" in out
    assert "needs: a model with poles; " in out and "\ncannot tell: " in out
    assert excite("metrics", "fit_5_step")[1].startswith("fit_5_step: ")
    assert json.loads(excite("metrics", "--json")[1])["metrics"]["fit_simulation"]["smaller_is_better"] is False


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_no_encoding_of_the_output_is_a_crash(encoding):
    code, out, err = python("-m", "excite", "guide", "first-experiment", PYTHONIOENCODING=encoding)
    assert (code, err) == (0, "") and out.startswith("# A first experiment")
