"""`excite design`, `check`, `export` and `simulate`: signals made, judged, written and played."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import excite, refused, strict, write
from scipy.io import loadmat

from excite.files import load_recording, load_signal

# check, export, design, simulate ---------------------------------------------------------------------------------------


def test_check_returns_3_when_the_order_is_not_reached(tmp_path):
    period = load_period(tmp_path)
    assert excite("check", period, "--order", "7")[0] == 0
    code, out, _ = excite("check", period, "--order", "8", "--json")
    result = strict(out)
    assert code == 3 and result["order"] == 7 and result["reached"] is False and result["line_order"] == 7
    assert excite("check", period)[0] == 0
    assert excite("check", period, "--order", "1000000000000")[0] == 3


def load_period(folder):
    """Write four periods of a sequence of 7 chips: persistently exciting of order 7, no more."""
    path = folder / "period.csv"
    assert excite("design", "prbs", "--order", "3", "--dt", "0.1", "--periods", "4", "-o", path)[0] == 0
    return path


def test_check_of_silence_is_strict_json(tmp_path):
    code, out, _ = excite(
        "check", write(tmp_path / "zero.csv", np.zeros((40, 1))), "--inputs", "0", "--dt", "1", "--json"
    )
    assert code == 0 and strict(out)["order"] == 0 and strict(out)["condition"] is None


def test_check_takes_our_recordings(flight):
    code, out, _ = excite("check", flight / "flight.npz", "--json")
    assert code == 0 and [c.split(" ")[0] for c in strict(out)["channels"]] == [
        "thrust_roll",
        "thrust_pitch",
        "thrust_yaw",
    ]


def test_design_prints_what_it_writes(tmp_path):
    path = tmp_path / "signal.csv"
    code, out, err = excite("design", "prbs", "--order", "4", "--dt", "0.5", "--hold", "2", "-o", path, "--json")
    written, signal = strict(out), load_signal(path)
    assert (code, err) == (0, "") and written["recipe"] == strict(json.dumps(signal.recipe.to_dict()))
    assert written["certificate"]["order"] > 0 and signal.period == 30 and signal.dt == 0.5
    assert json.loads((tmp_path / "signal.csv.json").read_text())["certificate"] == written["certificate"]


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--order", "1"], "order: 1"),
        (["--order", "five"], "order: 'five'"),
        (["--dt", "0"], "dt: 0"),
        (["--order", "33"], "orders from 2 to 32"),
        (["--order", "32"], "exceed"),
        (["--amplitude", "-1"], "amplitude: -1"),
        (["--amplitude", "1,2"], "amplitude: [1, 2]"),
        (["--channels", "0"], "channels: 0"),
        (["--seed", "-1"], "seed: -1"),
        (["--periods", "1", "--duration-s", "3"], "give one of the two"),
        (["--ordr", "4"], "--order"),
        (["--block-rows", "0"], "'--block-rows'"),
        (["-o", "signal.xyz"], "extension '.xyz'"),
        (["-o", "signal"], "extension ''"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_designs_are_refused_and_nothing_is_written(more, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert text in refused("design", "prbs", "--order", "4", "--dt", "0.1", "-o", "signal.csv", *more)
    assert list(tmp_path.iterdir()) == []


def test_export_keeps_the_signal_through_every_format(tmp_path):
    source, paths = load_period(tmp_path), [tmp_path / f"out.{e}" for e in ("npz", "mat", "csv")]
    for before, after in zip([source, *paths], paths, strict=False):
        assert excite("export", before, "--to", after.suffix[1:], "-o", after)[0] == 0
    first, *others = [load_signal(path) for path in (source, *paths)]
    for signal in others:
        assert np.array_equal(signal.u, first.u) and signal.dt == first.dt and signal.period == first.period
        assert signal.recipe.to_dict() == first.recipe.to_dict()
    assert np.array_equal(loadmat(tmp_path / "out.mat")["u"][:, -1], first.u[:, 0])


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--to", "npzz", "-o", "out.npz"], "did you mean 'npz'?"),
        (["--to", "npz", "-o", "out.csv"], "--to says npz"),
        (["--to", "csv", "-o", "period.csv"], "would overwrite"),
        (["--to", "csv", "-o", "no/out.csv"], "there is no folder no"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_export_refusals(more, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = load_period(tmp_path).read_bytes()
    assert text in refused("export", "period.csv", *more)
    assert Path("period.csv").read_bytes() == before and len(list(tmp_path.iterdir())) == 2


def test_simulate_depends_on_the_seed_alone(flight, tmp_path):
    def fly(name, *more):
        assert excite("simulate", "quadrotor", "--input", flight / "played.csv", "-o", tmp_path / name, *more)[0] == 0
        return load_recording(tmp_path / name).values

    again, other = fly("a.npz", "--seed", "4"), fly("b.npz", "--seed", "5")
    assert np.array_equal(again, load_recording(flight / "flight.npz").values)
    assert not np.array_equal(again, other)
    assert np.array_equal(fly("c.npz", "--seed", "4", "--no-noise"), fly("d.csv", "--seed", "5", "--no-noise"))


@pytest.mark.parametrize(
    ("more", "code", "text"),
    [
        (["--inject", "nose"], 2, "known: attitude_setpoint"),
        (["--preset", "2014"], 2, "did you mean '2013'?"),
        (["--set", "mas=1"], 2, "did you mean 'mass'?"),
        (["--set", "mass=heavy"], 2, "'heavy' is not a number"),
        (["--set", "mass=1"], 2, "mass 1 kg needs"),
        (["--set", "attitude_kp=50"], 2, "roll loop is not internally stable"),
        (["--set", "hover_altitude=0.1001"], 2, "m is below 0.1 m"),
        (["--seed", "-1"], 2, "'--seed'"),
        (["-o", "flight.xyz"], 2, "extension '.xyz'"),
        (["-o", "flight.dat"], 2, "extension '.dat'"),
        (["--input", "big.csv"], 3, "exceeds the limit -30 deg"),
        (["--input", "one.csv"], 2, "give 3: roll_ref, pitch_ref, yaw_rate_ref"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_flights_that_cannot_be(more, code, text, flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, channels in (("big.csv", "3"), ("one.csv", "1")):
        design = ("--order", "3", "--dt", "0.1", "--amplitude", "31", "--channels", channels)
        assert excite("design", "prbs", *design, "-o", name)[0] == 0
    before = set(tmp_path.iterdir())
    argv = ("simulate", "quadrotor", "--input", flight / "played.csv", "-o", "flight.npz", *more)
    assert text in refused(*argv, code=code)
    assert set(tmp_path.iterdir()) == before
