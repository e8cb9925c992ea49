"""The README's code runs, its commands exist, and its table is what the main job prints."""

import re

import numpy as np
import pytest
from paths import ROOT

from identify.examples import series as example
from scenarios.cli.main import COMMANDS, status

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"))
def test_python_blocks_run(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})


def test_the_two_commands_come_first_and_set_everything_up():
    first, second, *_ = blocks("bash")
    for command in (first, second):
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install") and command.count("\n") == 1
    assert "excite run quadrotor_prbs" in first and "pytest" in second
    assert README.index(second) < 2500


def test_every_command_is_documented_and_every_documented_command_exists():
    documented = set(re.findall(r"^excite (\w+)", "".join(blocks("text")), re.MULTILINE)) | {"methods", "scenarios"}
    assert documented == set(COMMANDS)


def test_the_identify_example_runs_on_a_file_of_that_form(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data, _ = example()
    np.savetxt(tmp_path / "dryer.dat", np.column_stack([data.u[:, 0], data.y[:, 0]]))
    (line,) = (b for b in blocks("bash") if b.startswith("excite identify"))
    assert status(line.split()[1:]) == 0
    assert "po_moesp, order 4, dt 0.08 s" in capsys.readouterr().out


def test_files_and_folders_it_names_exist():
    for name in re.findall(r"`((?:excite|plants|identify|scenarios)/[\w./]*)`", README) + re.findall(
        r"\]\(([\w./]+)\)", README
    ):
        assert (ROOT / name).exists(), name
