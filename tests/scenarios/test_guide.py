"""The guide: its pages are found, shipped and true: their code runs as it is printed."""

import io
import json
import re
import shlex
import subprocess
import sys
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module

import numpy as np
import pytest
from paths import ROOT

from excite.registry import Registry
from scenarios.cli.doctor import REGISTRIES
from scenarios.cli.guide import GUIDE, pages, title
from scenarios.cli.main import COMMANDS, status

PAGES = pages()
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (mine/\w+\.py)\n")


def excite(*argv):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def test_pages_are_listed_with_their_titles_and_printed():
    code, out, err = excite("guide")
    assert (code, err) == (0, "")
    assert [line.split(maxsplit=1) for line in out.splitlines()] == [
        [name, title(text)] for name, text in PAGES.items()
    ]
    assert list(PAGES)[:2] == ["index", "first-experiment"] and {"plug-ins", "threats", "which-method"} <= PAGES.keys()
    for name, text in PAGES.items():
        assert text.startswith("# ") and excite("guide", name) == (0, text, "")
    code, out, err = excite("guide", "plugins")
    assert (code, out) == (2, "") and "page 'plugins' does not exist; did you mean 'plug-ins'?" in err


def test_pages_are_package_data():
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["scenarios"]
    assert {path for pattern in data for path in GUIDE.parent.glob(pattern)} >= set(GUIDE.glob("*.md"))


@pytest.mark.parametrize("name", PAGES)
def test_links_and_commands_that_a_page_names_exist(name):
    links = re.findall(r"\]\(([\w.-]+)\.md\)", PAGES[name])
    assert set(links) <= PAGES.keys()
    assert set(re.findall(r"`excite (\w+)", PAGES[name])) <= set(COMMANDS)
    if name == "index":
        assert set(links) == PAGES.keys() - {"index"}


@pytest.mark.parametrize("name", [name for name in PAGES if name != "plug-ins"])
def test_code_of_a_page_runs_in_its_order(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for language, text in BLOCK.findall(PAGES[name]):
        if file := re.match(r"# (\w+\.toml)\n", text):
            (tmp_path / file[1]).write_text(text, encoding="utf-8")
        if language == "python":
            exec(compile(text, f"{name}.md", "exec"), names)
        for line in text.splitlines() if language == "bash" else ():
            assert line.startswith("excite "), line
            code, _, err = excite(*shlex.split(line)[1:])
            assert code == 0, (line, err)


def test_what_reading_data_says_is_refused_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for line in re.findall(r"^excite (.*mercere.*|design .*)$", PAGES["reading-data"], re.MULTILINE):
        assert excite(*shlex.split(line))[0] == 0
    code, _, err = excite("identify", "closed.npz", "--loop", "open", "--method", "ssarx", "--order", "2")
    assert code == 2 and "loop 'open' is given, but the file says 'closed'" in err
    assert "`loop 'open' is given, but the file says 'closed'`" in PAGES["reading-data"]


# The package of the page on plug-ins -----------------------------------------------------------------------------------


@pytest.fixture
def mine(tmp_path):
    """The package that the page prints, as an installed distribution: the folder it lies in, and its entry points."""
    blocks = BLOCK.findall(PAGES["plug-ins"])
    project = tomllib.loads(next(text for language, text in blocks if language == "toml"))["project"]
    info = tmp_path / "excite_mine-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = project["entry-points"]
    (info / "entry_points.txt").write_text(
        "".join(f"[{group}]\n{name} = {value}\n" for group, each in groups.items() for name, value in each.items())
    )
    (tmp_path / "mine").mkdir()
    for language, text in blocks:
        if language == "python":
            (tmp_path / FILE.match(text)[1]).write_text(text)
    assert {value.split(":")[0] for each in groups.values() for value in each.values()} == {
        f"mine.{path.stem}" for path in (tmp_path / "mine").iterdir()
    }
    return tmp_path, groups


def known():
    """The tables that take plug-ins, by their group."""
    found = (getattr(import_module(m), a) for m, a in (place.split(":") for place in REGISTRIES))
    return {table.group: table for table in found if isinstance(table, Registry)}


def run(mine, *argv, cwd=None):
    done = subprocess.run(
        [sys.executable, *argv],
        cwd=cwd,
        env={"PYTHONPATH": f"{mine}:{ROOT}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_the_page_names_the_group_of_every_table_and_doctor_finds_what_it_prints(mine):
    folder, groups = mine
    assert known().keys() <= groups.keys() and all(f"`{group}`" in PAGES["plug-ins"] for group in groups)
    _, out, err = run(folder, "-m", "excite", "doctor")
    for group, table in known().items():
        for name in groups[group]:
            assert f"plug-in: {table.thing} {name}, from excite-mine 0.1" in out, (out, err)
    assert "left out" not in out


def test_the_format_of_the_page_is_listed_written_and_read(mine, tmp_path):
    folder, _ = mine
    code, out, _ = run(folder, "-m", "excite", "formats", "one_column")
    assert code == 0 and "one number per line" in out and "from the package excite-mine 0.1" in out
    script = (
        "from excite import prbs; from excite.files import load_signal, save_signal; import numpy as np; "
        "s = prbs(order=4, dt=0.1); save_signal(s, 's.one'); assert np.array_equal(load_signal('s.one', dt=0.1).u, s.u)"
    )
    assert run(folder, "-c", script, cwd=tmp_path)[0] == 0


def test_what_the_page_prints_serves_on_the_command_line(mine, tmp_path):
    folder, _ = mine
    rng = np.random.default_rng(0)
    u = rng.standard_normal(300)
    y = np.convolve(u, [0, 1, 0.5, 0.2])[:300] + 0.01 * rng.standard_normal(300)
    np.savetxt(tmp_path / "data.csv", np.column_stack([u, y]), delimiter=",")
    data = ("data.csv", "--inputs", "0", "--outputs", "1", "--dt", "0.1")
    asked = ("-m", "excite", "identify", *data, "--json", "--method")
    fir = json.loads(run(folder, *asked, "fir", "--order", "3", cwd=tmp_path)[1])
    assert fir["fit"]["simulation"][0] > 95 and fir["warnings"] == []
    half = json.loads(run(folder, *asked, "fir", "--order", "half", cwd=tmp_path)[1])
    assert half["order"] == 75 and any("half of the largest, 150" in warning for warning in half["warnings"])
    held = json.loads(run(folder, *asked, "ssarx", "--order", "2", "--set", 'regions=["damped"]', cwd=tmp_path)[1])
    assert max(np.hypot(p["re"], p["im"]) for p in held["poles"]) <= 0.99
    compared = ("-m", "excite", "compare", *data, "--methods", "fir,arx", "--orders", "2,3", "-o", "out")
    code, out, err = run(folder, *compared, cwd=tmp_path)
    assert code == 0 and "fir" in out and "pole_radius" in out, (out, err)


def test_the_method_of_the_page_conforms(mine, monkeypatch):
    monkeypatch.syspath_prepend(mine[0])
    from identify import conformance

    method = import_module("mine.fir").Fir()
    for check in (conformance.check_deterministic, conformance.check_inputs_unmodified, conformance.check_hashable):
        check(method)


def test_the_generator_and_the_plant_of_the_page_play(mine, monkeypatch):
    monkeypatch.syspath_prepend(mine[0])
    signal = import_module("mine.square").square(dt=1.0, half=5, channels=["inflow [l/s]"])
    assert len(signal.u) == 40 and signal.period == 10 and signal.hold == 5 and signal.recipe["half"] == 5
    tank = import_module("mine.tank").tank()
    record = tank.run(signal)
    assert record.experiment().outputs[0].name == "level" and abs(tank.truth(record, "plant").poles[0] - 0.9512) < 1e-4
