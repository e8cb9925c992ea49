"""Every scenario that comes with the package runs, meets its expectations, and leaves a whole folder."""

import json

import pytest

from scenarios.cli.main import status
from scenarios.scenario.reading import shipped

ELSEWHERE = {"quadrotor_prbs"}  # tests/test_main_job.py
LONG = {"quadrotor_prbs_seed", "aeroelastic_combined"}
NAMES = [
    pytest.param(name, marks=[pytest.mark.study] if name in LONG else []) for name in shipped() if name not in ELSEWHERE
]


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenario_meets_its_expectations(name, tmp_path):
    code = status(["run", name, "-o", str(tmp_path / "run"), "--jobs", "1"])
    scores = json.loads((tmp_path / "run" / "scores.json").read_text())
    missed = [e for e in scores["expectations"] if not e["met"]]
    assert (code, missed) == (0, []) and scores["expectations"]
    reasons = {row["method"]: row["reason"] for s in scores["views"].values() for row in s["ranking"] if row["reason"]}
    assert reasons == {}
    assert (tmp_path / "run" / "report.html").stat().st_size > 10_000
