"""Data files: bit-exact round trips, and the dialects of foreign files."""

import json
import os

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from written_files import experiment, same

from excite.errors import ExciteError
from excite.files import (
    FORMATS,
    export,
    load_experiment,
    load_recording,
    load_signal,
    read_table,
    save_experiment,
    save_recording,
    save_signal,
)
from excite.generators import prbs, regenerate
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal

WRITTEN = [".csv", ".npz", ".mat", ".h5"]  # the formats that lose nothing


FORMULA = "=cmd|' /C calc'!A0"


AWKWARD = [Channel("a [1]"), Channel("b; c", "m/s2"), Channel('say "hi"'), Channel(FORMULA), Channel("ä,ö", "°")]


def assert_same_experiment(a, b):
    for key in ("u", "y", "reference", "time_s"):
        assert same(getattr(a, key), getattr(b, key)), key
    for key in ("dt", "inputs", "outputs", "references", "period"):
        assert getattr(a, key) == getattr(b, key), key


def controller():
    return StateSpaceModel(
        [[0.5, 1 / 3], [0, 0.1]],
        [[1], [-0.0]],
        [[1, 2]],
        [[0.7]],
        0.01,
        K=[[0.1], [0.2]],
        innovation_cov=[[1e-300]],
        inputs=["error [1]"],
        outputs=["motor"],
        input_offset=[0.1],
    )


def recording(**changes):
    parts = {
        "time_s": np.arange(40) * 0.01 + 0.3,
        "values": np.random.default_rng(2).standard_normal((40, 4)),
        "channels": (Channel("ref", "deg"), Channel("motor"), Channel("rate", "rad/s"), Channel("-temperature")),
        "dt": 0.01,
        "period": 20,
        "default": "rates",
        "views": {
            "rates": Roles(("motor",), ("rate",), ("ref",), closed=True),
            "slow": Roles(("ref",), ("rate",), every=4),
        },
        "loop": Loop("closed", controller=controller(), sign=1, entry="plant input"),
        "origin": Origin("quadrotor", parameters={"mass_kg": 0.1, "list": [1, "a", None, True]}, seed=3, start_s=0.5),
        "level": "unknown",
    }
    return Recording(**parts | changes)


# ---- round trips


@pytest.mark.parametrize("extension", WRITTEN)
def test_outputs_alone_come_back_without_an_input(extension, tmp_path):
    saved = Experiment(
        None, np.random.default_rng(0).standard_normal((20, 2)), dt=0.1, outputs=["acc_1 [m/s2]", "acc_2"]
    )
    save_experiment(saved, tmp_path / f"ambient{extension}")
    loaded = load_experiment(tmp_path / f"ambient{extension}")
    assert_same_experiment(loaded, saved)
    assert loaded.u.shape == (20, 0)


def test_foreign_outputs_alone_need_an_empty_list_of_inputs(tmp_path):
    np.savetxt(tmp_path / "ambient.dat", np.arange(20.0).reshape(10, 2))
    with pytest.raises(ExciteError, match=r"give inputs \(--inputs\)"):
        load_experiment(tmp_path / "ambient.dat", outputs=[0, 1], dt=0.1)
    assert load_experiment(tmp_path / "ambient.dat", inputs=[], outputs=[0, 1], dt=0.1).u.shape == (10, 0)


@pytest.mark.parametrize("extension", WRITTEN)
def test_signal_round_trip(tmp_path, extension):
    signal = prbs(order=6, dt=0.1 / 3, hold=2, amplitude=0.1, channels=["roll [deg]", *AWKWARD], periods=2, seed=4)
    path = tmp_path / f"s{extension}"
    save_signal(signal, path, {"order": 63, "missing_hz": [], "condition": np.inf, "margin": np.float64(0.5)})
    again = load_signal(path)
    assert same(again.u, signal.u)
    assert (again.dt, again.channels, again.period) == (signal.dt, signal.channels, signal.period)
    assert again.recipe == signal.recipe
    assert regenerate(again.recipe).u.tobytes() == signal.u.tobytes()
    certificate = read_table(path).meta["certificate"]
    assert certificate == {"order": 63, "missing_hz": [], "condition": None, "margin": 0.5}


@pytest.mark.parametrize("extension", WRITTEN)
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"reference": None, "references": None},
        {"outputs": AWKWARD[:3], "inputs": AWKWARD[3:]},
        {"dt": None, "time_s": np.logspace(-6, 3, 50)},
        {"time_s": np.arange(50) / 3 + 17.3},
        {"u": np.ones(1), "y": np.ones((1, 3)), "inputs": None, "reference": None, "references": None},
    ],
    ids=["plain", "no reference", "awkward names", "log-spaced times", "late start", "one sample"],
)
def test_experiment_round_trip(tmp_path, extension, changes):
    original = experiment(**changes)
    path = tmp_path / f"e{extension}"
    save_experiment(original, path)
    again = load_experiment(path)
    assert_same_experiment(again, original)
    assert again.name == "flight 7"


@pytest.mark.parametrize("extension", WRITTEN)
@pytest.mark.parametrize("loop", [Loop("open"), Loop("closed"), recording().loop], ids=["open", "unknown", "known"])
def test_recording_round_trip(tmp_path, extension, loop):
    original = recording(loop=loop)
    path = tmp_path / f"r{extension}"
    save_recording(original, path)
    again = load_recording(path)
    assert same(again.values, original.values) and same(again.time_s, original.time_s)
    for key in ("channels", "dt", "views", "default", "period", "origin", "level"):
        assert getattr(again, key) == getattr(original, key), key
    assert (again.loop.closed, again.loop.sign, again.loop.entry) == (loop.closed, loop.sign, loop.entry)
    if loop.controller is None:
        assert again.loop.controller is None
    else:
        for key in ("A", "B", "C", "D", "K", "innovation_cov", "input_offset", "output_offset"):
            assert same(getattr(again.loop.controller, key), getattr(loop.controller, key)), key
        assert again.loop.controller.inputs == loop.controller.inputs
    assert_same_experiment(load_experiment(path), original.experiment())
    assert_same_experiment(load_experiment(path, view="slow"), original.experiment("slow"))


def test_a_recording_in_csv_needs_no_sidecar_for_its_default_view(tmp_path):
    original = recording()
    save_recording(original, tmp_path / "r.csv")
    (tmp_path / "r.csv.json").unlink()
    again = load_experiment(tmp_path / "r.csv")
    assert same(again.u, original.experiment().u) and same(again.y, original.experiment().y)
    assert again.references == (Channel("ref", "deg"),)
    chosen = load_experiment(tmp_path / "r.csv", inputs="ref", outputs=["rate", "-temperature"])
    assert [c.name for c in chosen.outputs] == ["rate", "-temperature"]


def test_the_loop_of_a_recording_stays_with_chosen_roles(tmp_path):
    save_recording(recording(), tmp_path / "r.npz")
    chosen = load_experiment(tmp_path / "r.npz", inputs=["motor"], outputs=["rate"])
    assert chosen.loop.closed and chosen.loop.controller is not None


def test_export_names_the_format(tmp_path):
    signal = prbs(order=4, dt=0.1)
    export(signal, "mat", tmp_path / "out.bin")
    os.rename(tmp_path / "out.bin", tmp_path / "out.mat")
    assert same(load_signal(tmp_path / "out.mat").u, signal.u)
    with pytest.raises(ExciteError, match=r"export: format 'matt'; did you mean 'mat'\?"):
        export(signal, "matt", tmp_path / "out")


def test_mat_of_a_signal_is_what_from_workspace_takes(tmp_path):
    signal = prbs(order=5, dt=0.1, channels=2)
    export(signal, "mat", tmp_path / "s.mat")
    loaded = scipy.io.loadmat(tmp_path / "s.mat")
    assert (loaded["u"] == np.column_stack([signal.time_s, signal.u])).all()
    assert loaded["dt"].item() == 0.1
    assert [name.item() for name in loaded["names"].ravel()] == ["time_s", "u:u1", "u:u2"]


def test_every_lossless_format_is_tested_here():
    lossless = [given for given in map(FORMATS.__getitem__, FORMATS) if given.write and given.quantise is None]
    assert sorted({extension for given in lossless for extension in given.extensions}) == sorted([*WRITTEN, ".hdf5"])


def test_csv_header_and_sidecar(tmp_path):
    save_experiment(experiment(), tmp_path / "e.csv")
    header = (tmp_path / "e.csv").read_text().splitlines()[0]
    assert header == "time_s,u:flap [deg],u:tab,y:acc_1 [m/s2],y:acc_2,y:flap,r:flap_ref [deg]"
    sidecar = json.loads((tmp_path / "e.csv.json").read_text())
    assert sidecar["file"] == "e.csv" and sidecar["columns"] == header.split(",") and len(sidecar["sha256"]) == 64


def test_no_header_cell_is_a_spreadsheet_formula(tmp_path):
    names = ["=1+1", "+1", "-1", "@SUM(A1)"]
    original = Recording(np.arange(3.0), np.ones((3, 4)), tuple(map(Channel, names)), dt=1.0)
    save_recording(original, tmp_path / "r.csv")
    header = (tmp_path / "r.csv").read_text().splitlines()[0]
    assert not any(cell.strip('"')[0] in "=+-@" for cell in header.split(","))
    assert load_recording(tmp_path / "r.csv").channels == original.channels


@pytest.mark.parametrize(("name", "unit"), [("a", "x]"), ("[", "]"), ("a\tb", ""), ("a\rb", ""), ("a\x1b[2J", "")])
def test_names_that_cannot_be_written_are_refused(tmp_path, name, unit):
    with pytest.raises(ExciteError, match="rename it"):
        save_signal(Signal(np.ones(3), 1.0, (Channel(name, unit),)), tmp_path / "s.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_sidecar_counts_only_for_its_own_file(tmp_path):
    signal, path = prbs(order=5, dt=0.1), tmp_path / "s.csv"
    save_signal(signal, path)
    path.write_text(path.read_text().replace("1.0\n", "2.0\n", 1))
    edited = load_signal(path)
    assert edited.period is None and edited.recipe is None and edited.dt == 0.1
    save_signal(signal, path)
    for damaged in ("{", "[]", '{"sha256": 1}', "\0"):
        (tmp_path / "s.csv.json").write_text(damaged)
        assert load_signal(path).period is None


letters = {"codec": "utf-8", "exclude_categories": ("Cc", "Cs", "Zl", "Zp")}


names = st.text(st.characters(**letters, exclude_characters="["), min_size=1, max_size=8).map(str.strip).filter(bool)


units = st.text(st.characters(**letters, exclude_characters="[]"), max_size=4)


numbers = st.floats(allow_infinity=False, allow_nan=True)


@given(
    values=arrays(float, st.tuples(st.integers(1, 6), st.just(3)), elements=numbers),
    channels=st.lists(st.builds(Channel, names, units), min_size=3, max_size=3, unique_by=lambda c: c.name),
    dt=st.floats(1e-6, 1e6),
)
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_csv_round_trip_of_anything(tmp_path, values, channels, dt):
    original = Experiment(values[:, :1], values[:, 1:], dt=dt, inputs=channels[:1], outputs=channels[1:])
    save_experiment(original, tmp_path / "e.csv")
    again = load_experiment(tmp_path / "e.csv")
    np.testing.assert_array_equal(np.isnan(again.y), np.isnan(original.y))
    for key in ("u", "y", "time_s"):
        a, b = getattr(again, key), getattr(original, key)
        assert a[~np.isnan(a)].tobytes() == b[~np.isnan(b)].tobytes()
    assert (again.dt, again.inputs, again.outputs) == (original.dt, original.inputs, original.outputs)
