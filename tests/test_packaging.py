"""The wheel holds what it must, nothing else, and works outside the checkout."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from paths import ROOT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    source, out = tmp_path_factory.mktemp("source") / "tree", tmp_path_factory.mktemp("wheel")
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in tracked:
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
    subprocess.run(build, check=True, capture_output=True)
    return next(out.glob("excite_sysid-*.whl"))


def test_the_wheel_holds_the_four_packages_their_data_and_the_licence(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {
        "excite",
        "plants",
        "identify",
        "scenarios",
    }
    assert "plants/quadrotor/model.xml" in names and "scenarios/library/quadrotor_prbs.toml" in names
    assert all(f"{package}/py.typed" in names for package in ("excite", "plants", "identify", "scenarios"))
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_it_works_outside_the_checkout(wheel, tmp_path):
    home, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(home)
    environment = {**os.environ, "PYTHONPATH": str(home)}
    script = (
        "import json, excite, plants, identify, scenarios; from scenarios.scenario.reading import load_scenario; "
        "from excite import prbs; q = plants.load_plant('quadrotor'); s = load_scenario('quadrotor_prbs'); "
        "r = q.run(prbs(order=3, dt=0.02, hold=5, amplitude=2.0, channels=3)); "
        "print(json.dumps([excite.__file__, s.name, len(r.values)]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=elsewhere, env=environment, capture_output=True, text=True, check=True
    )
    place, name, samples = json.loads(run.stdout)
    assert Path(place).is_relative_to(home) and name == "quadrotor_prbs" and samples == 350
