"""The command line: exit codes, messages that name place, value and remedy, strict JSON, files that appear whole or not."""

import re
import subprocess
import sys
from signal import SIGINT

import click
import pytest
from command_line import excite, refused, strict

from excite.files.formats import FORMATS
from excite.generators import GENERATORS
from identify.metrics.registry import METRICS
from identify.registry import METHODS
from plants.registry import PLANTS
from scenarios.cli.main import COMMANDS, cli
from scenarios.scenario.reading import shipped


def commands():
    """Every command and subcommand as argument vectors."""
    context = click.Context(cli)
    for name in COMMANDS:
        command = cli.get_command(context, name)
        yield (name,), command
        if isinstance(command, click.Group):
            yield from (((name, sub), command.get_command(context, sub)) for sub in command.list_commands(context))


# Help, usage ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "command"), [pytest.param(w, c, id=" ".join(w)) for w, c in commands()])
def test_help_says_what_each_option_is_for(words, command):
    code, out, err = excite(*words, "--help")
    assert (code, err) == (0, "")
    assert command.help.split()[0] in out
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.hidden:
            assert parameter.opts[0] in out
            assert len(parameter.help.split()) >= 2, parameter.opts
    assert excite(*words, "-h") == (0, out, "")


def test_top_level_help_lists_every_command_and_exit_code():
    code, out, _ = excite("--help")
    assert code == 0
    assert [name for name in COMMANDS if f"\n  {name} " not in out] == []
    assert [c for c in ("0 ", "1 ", "2 ", "3 ", "70 ", "130 ") if c not in out.split("Exit codes:")[1]] == []


def test_design_offers_every_parameter_of_the_generator():
    assert set(cli.get_command(None, "design").list_commands(None)) == {*GENERATORS, "parts", "propose"}
    _, out, _ = excite("design", "prbs", "--help")
    assert "degree n, 2 to 32" in out and "[default: 1.0]" in out and "--duration-s" in out


@pytest.mark.parametrize("name", METHODS)
def test_methods_explain_every_setting(name):
    described, listed = excite("methods", name)[1].split("settings:")
    own = {each for names in re.findall(r"((?:\w+, )*\w+) : ", described) for each in names.split(", ")}
    for line in listed.strip().splitlines():
        setting, _, _, *meaning = line.split()
        assert meaning or setting in own, line


@pytest.mark.parametrize(
    ("argv", "remedy"),
    [
        (["identfy"], "did you mean 'identify'?"),
        (["identify", "x.csv", "--metod", "arx"], "--method"),
        (["design", "prsb"], "did you mean 'prbs'?"),
        (["plants", "quadroter"], "did you mean 'quadrotor'?"),
        (["methods", "po_mosp"], "did you mean 'po_moesp'?"),
        (["metrics", "frf_error"], "did you mean 'frf_error_h2'?"),
        (["formats", "hdf"], "did you mean 'hdf5'?"),
        (["guide", "indx"], "did you mean 'index'?"),
        (["scenarios", "quadrotor_prb"], "did you mean 'quadrotor_prbs'?"),
        (["run", "quadrotor_prb"], "did you mean 'quadrotor_prbs'?"),
        (["simulate", "quadroter", "--input", "x.csv", "-o", "y.npz"], "did you mean 'quadrotor'?"),
        (["identify", "x.csv", "--method", "po_mosp"], "did you mean 'po_moesp'?"),
        (["compare", "x.csv", "--methods", "arx,po_mosp", "-o", "y"], "did you mean 'po_moesp'?"),
        (["identify", "--method", "arx"], "Missing argument 'FILE...'"),
        (["identify", "x.csv"], "Missing option '--method'"),
        (["doctor", "please"], "unexpected extra argument"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_misspellings_are_met_with_the_nearest_name(argv, remedy, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert remedy in refused(*argv)
    assert list(tmp_path.iterdir()) == []


def test_no_arguments_show_the_commands():
    code, out, err = excite()
    assert (code, out) == (2, "") and "Commands:" in err


def test_a_bug_shows_its_traceback_and_70(monkeypatch):
    monkeypatch.setitem(COMMANDS, "doctor", "scenarios.cli.doctor:missing")
    code, _, err = excite("doctor")
    assert code == 70 and "Traceback" in err and "report it" in err


def test_interruption_is_130(monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("scenarios.cli.doctor.print_lines", interrupt)
    assert excite("doctor") == (130, "", "excite: interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="processes end otherwise there")
@pytest.mark.parametrize("module", ["excite.errors", "scenarios.cli.methods"])
def test_interruption_while_packages_load_is_quiet(module):
    code = f"""
import os, signal, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
sys.argv = ["excite", "methods"]
from scenarios.cli import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-SIGINT, "", "")


@pytest.mark.parametrize("argv", [["plants", "--json"], ["methods"], ["--help"]], ids=" ".join)
def test_a_closed_pipe_ends_quietly(argv):
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "excite", *argv], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdout.close()
    err = process.stderr.read()
    assert (process.wait(60), err) == (0, "")


# What there is ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "known"),
    [("plants", PLANTS), ("methods", METHODS), ("scenarios", shipped()), ("formats", FORMATS), ("metrics", METRICS)],
)
def test_catalogues(command, known):
    code, out, _ = excite(command)
    assert code == 0 and [line.split()[0] for line in out.splitlines()] == sorted(known)
    assert set(strict(excite(command, "--json")[1])[command]) == set(known)
    for name in known:
        code, out, err = excite(command, name)
        assert (code, err) == (0, "") and len(out.splitlines()) > 3
        assert list(strict(excite(command, name, "--json")[1])[command]) == [name]


def test_a_shipped_scenario_is_printed_as_a_starting_point():
    assert excite("scenarios", "quadrotor_prbs")[1] == shipped()["quadrotor_prbs"].read_text(encoding="utf-8")


def test_the_installed_command_is_this_one():
    done = subprocess.run([sys.executable, "-m", "excite", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("excite, version ")
    done = subprocess.run([sys.executable, "-m", "excite", "plans"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "") and "did you mean 'plants'?" in done.stderr
