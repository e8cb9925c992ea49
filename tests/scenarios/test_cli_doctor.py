"""`excite doctor`: it names what is wrong with an installation, and outlives it."""

import io
from contextlib import redirect_stderr, redirect_stdout

import pytest
from installed import install, python

from scenarios.cli.main import status


def excite(*argv):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def test_doctor_finds_nothing_here_and_names_what_is_missing(monkeypatch):
    code, out, _ = excite("doctor")
    assert code == 0 and "all well" in out
    monkeypatch.setattr("scenarios.cli.doctor.NEEDED", ("numpy", "no-such-distribution"))
    code, out, _ = excite("doctor")
    assert code == 2 and "pip install no-such-distribution" in out


def test_plugins_in_use_and_left_out_are_named(tmp_path):
    good = "from excite.files.formats import Format\nfrom excite.files.text import read\nMINE = Format('mine', ('.mine',), read)"
    points = {
        "excite.formats": {"mine": "one:MINE", "broken": "two:MINE", "csv": "one:MINE"},
        "excite.methods": {"mine": "one:MINE"},
        "excite.figurs": {"mine": "one:MINE"},
    }
    install(tmp_path, "excite-one", {"one.py": good, "two.py": "1 / 0"}, points)
    code, out, err = python("-m", "excite", "doctor", path=[tmp_path])
    assert (code, err) == (2, "")
    assert "plug-in: format mine, from excite-one 0.1" in out
    assert "plug-in of excite.formats left out: broken (two:MINE): ZeroDivisionError: division by zero" in out
    assert "plug-in of excite.formats left out: csv (one:MINE): the name is taken by excite" in out
    assert "plug-in of excite.methods left out: mine (one:MINE): is no subclass of identify.method.Method" in out
    assert "plug-in mine (one:MINE): there is no group excite.figurs; known: excite." in out
    assert out.endswith("4 thing(s) to correct\n")


@pytest.mark.parametrize(
    ("name", "package"), [("identify", "identify"), ("scenarios", "scenarios"), ("other", "plants")]
)
def test_distributions_that_install_packages_of_our_names_are_named(name, package, tmp_path):
    install(tmp_path, name, top_level=[package])
    code, out, _ = python("-m", "excite", "doctor", path=[tmp_path])
    assert code == 2 and f"distribution '{name}' is installed and overwrites our package '{package}'" in out


def test_a_file_of_our_name_in_the_working_folder_is_named(tmp_path):
    (tmp_path / "identify.py").write_text("print('mine')\n")
    script = "import sys; sys.path.remove(''); sys.argv = ['excite', 'doctor']; from scenarios.cli import main; main()"
    code, out, err = python("-c", script, cwd=tmp_path)
    assert (code, err) == (2, "") and f"{tmp_path / 'identify.py'} hides our package 'identify'" in out
    code, out, err = python("-m", "excite", "doctor", cwd=tmp_path)  # here Python looks into the working folder first
    assert (code, err) == (2, "") and f"package 'identify' comes from {tmp_path / 'identify.py'}" in out


def test_what_breaks_a_check_is_a_finding(monkeypatch):
    def versions():
        yield True, "so far so good"
        raise MemoryError("no more")

    monkeypatch.setattr("scenarios.cli.doctor.CHECKS", (versions,))
    code, out, err = excite("doctor")
    assert (code, err) == (2, "") and "so far so good" in out
    assert "versions could not be checked: MemoryError: no more" in out and "1 thing(s) to correct" in out
