"""Data files: bit-exact round trips, and the dialects of foreign files."""

import json
import os

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from paths import SHARED

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
from excite.files.roles import uniform_step
from excite.generators import prbs, regenerate
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal

WRITTEN = [".csv", ".npz", ".mat", ".h5"]  # the formats that lose nothing
DRYER = SHARED / "data" / "daisy_dryer" / "dryer.dat"
FORMULA = "=cmd|' /C calc'!A0"
AWKWARD = [Channel("a [1]"), Channel("b; c", "m/s2"), Channel('say "hi"'), Channel(FORMULA), Channel("ä,ö", "°")]


def same(a, b):
    return a is b is None or np.asarray(a).tobytes() == np.asarray(b).tobytes()


def assert_same_experiment(a, b):
    for key in ("u", "y", "reference", "time_s"):
        assert same(getattr(a, key), getattr(b, key)), key
    for key in ("dt", "inputs", "outputs", "references", "period"):
        assert getattr(a, key) == getattr(b, key), key


def experiment(**changes):
    rng = np.random.default_rng(1)
    y = rng.standard_normal((50, 3)) * 10.0 ** rng.integers(-300, 300, (50, 3))
    y[3, 1], y[4, 0] = np.nan, -0.0
    parts = {
        "u": rng.standard_normal((50, 2)),
        "y": y,
        "reference": rng.standard_normal(50),
        "dt": 1 / 3,
        "period": 25,
        "inputs": ["flap [deg]", "tab"],
        "outputs": ["acc_1 [m/s2]", "acc_2", "flap"],
        "references": ["flap_ref [deg]"],
        "name": "flight 7",
    }
    return Experiment(**parts | changes)


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


# ---- foreign files

DIALECTS = {
    "plain": "time,u,y\n0,1,2.5\n0.1,3,\n0.2,5,6\n",
    "bom, crlf": "\ufefftime,u,y\r\n0,1,2.5\r\n0.1,3,nan\r\n0.2,5,6\r\n",
    "old mac": "time,u,y\r0,1,2.5\r0.1,3,NaN\r0.2,5,6\r",
    "semicolons": "time;u;y\n0;1;2.5\n0.1;3;\n0.2;5;6\n",
    "decimal comma": "time;u;y\n0;1;2,5\n0,1;3;\n0,2;5;6\n",
    "quotes": '"time","u","y"\n"0","1","2.5"\n"0.1","3",""\n"0.2","5","6"\n',
    "quoted decimal comma": '"time","u","y"\n"0","1","2,5"\n"0,1","3",""\n"0,2","5","6"\n',
    "comments": "# made by hand\n% twice\n\ntime,u,y\n0,1,2.5\n# pause\n0.1,3,\n0.2,5,6\n\n",
    "trailing delimiter": "time,u,y,\n0,1,2.5,\n0.1,3,,\n0.2,5,6,\n",
    "trailing in the data": "time,u,y\n0,1,2.5,\n0.1,3,,\n0.2,5,6,\n",
    "tabs": "time\tu\ty\n0\t1\t2.5\n0.1\t3\t\n0.2\t5\t6\n",
    "blanks": "time [s]  u  y [m]\n 0  1  2.5\n 0.1 3 nan\n 0.2 5 6\n",
    "blanks, decimal comma": "time u y\n0,0 1,0 2,5\n0,1 3,0 nan\n0,2 5,0 6,0\n",
    "spaces": "time , u , y\n 0 , 1 , 2.5 \n 0.1 , 3 ,  \n 0.2 , 5 , 6 \n",
    "numpy": "0.0e+00,1.0e+00,2.5e+00\n1e-1,3,nan\n2E-1,+5,6.\n",
}


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("extension", [".csv", ".dat", ".TXT"])
def test_dialects(tmp_path, dialect, extension):
    path = tmp_path / f"f{extension}"
    path.write_text(DIALECTS[dialect], encoding="utf-8", newline="")
    flags = {"inputs": [1], "outputs": ["2"], "time": 0} if dialect == "numpy" else {}
    data = load_experiment(path, **flags)
    assert same(data.u[:, 0], np.array([1.0, 3, 5]))
    np.testing.assert_array_equal(data.y[:, 0], [2.5, np.nan, 6])
    assert data.dt == 0.1 and data.name == "f"
    assert [c.name for c in (*data.inputs, *data.outputs)] == (["u1", "y1"] if dialect == "numpy" else ["u", "y"])


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8"])
def test_encodings(tmp_path, encoding):
    (tmp_path / "f.csv").write_bytes("t,Klappe [°],y\n0,1,2\n1,3,4\n".encode(encoding))
    assert load_experiment(tmp_path / "f.csv", inputs=["Klappe"], outputs="y").inputs == (Channel("Klappe", "°"),)


def test_columns_by_name_number_and_header(tmp_path):
    (tmp_path / "f.csv").write_text("a [V],b [m],7\n1,2,3\n4,5,6\n")
    for key in ("a", "a [V]", 0, "0", " a "):
        data = load_experiment(tmp_path / "f.csv", inputs=[key], outputs=["b", "7"], dt=0.5)
        assert data.inputs == (Channel("a", "V"),) and data.u[1, 0] == 4 and data.y[1].tolist() == [5, 6]


def test_the_dryer_record():
    if not DRYER.exists():
        pytest.skip("the DaISy hair dryer record is not beside the repository")
    data = load_experiment(DRYER, inputs=[0], outputs=[1], dt=0.08)
    assert data.u.shape == data.y.shape == (1000, 1)
    assert (data.u[0, 0], data.y[0, 0], data.dt) == (6.41, 4.7660989, 0.08)
    expected = np.array(DRYER.read_text().split(), float).reshape(1000, 2)
    assert same(data.u[:, 0], expected[:, 0].copy()) and same(data.y[:, 0], expected[:, 1].copy())


def test_a_single_column_is_a_signal(tmp_path):
    (tmp_path / "f.txt").write_text("flap angle [deg]\n1\n-1\n")
    signal = load_signal(tmp_path / "f.txt", inputs=[0], dt=0.1)
    assert signal.channels == (Channel("flap angle", "deg"),) and signal.u[:, 0].tolist() == [1, -1]
    assert signal.period is None and signal.recipe is None


def test_a_signal_from_an_experiment_takes_its_inputs(tmp_path):
    save_experiment(experiment(), tmp_path / "e.npz")
    signal = load_signal(tmp_path / "e.npz")
    assert same(signal.u, experiment().u) and signal.period == 25


@pytest.mark.parametrize("step", [0.1, 1 / 3, 0.08, 1e-6])
@pytest.mark.parametrize("start", [0.0, 12.3, 1.7e9])
def test_uniform_times_give_back_the_step(step, start):
    times = start + np.arange(1000) * step
    if start > 1e9 and step < 1e-3:
        return
    assert uniform_step(times) == pytest.approx(step, rel=1e-7)
    if start == 0:
        assert uniform_step(times) == step
    times[500:] += step
    assert uniform_step(times) is None


def test_rounded_time_stamps_are_uniform_and_dt_settles_the_rest(tmp_path):
    times = np.round(np.arange(300) / 30, 6)
    np.savetxt(tmp_path / "f.csv", np.column_stack([times, times, times]), delimiter=",", header="t,u,y", comments="")
    assert load_experiment(tmp_path / "f.csv").dt == pytest.approx(1 / 30, rel=1e-6)
    assert load_experiment(tmp_path / "f.csv", dt=1 / 30).dt == 1 / 30


def test_a_time_column_that_has_a_role_is_no_time(tmp_path):
    (tmp_path / "f.csv").write_text("t,y\n5,1\n4,2\n")
    assert load_experiment(tmp_path / "f.csv", inputs=["t"], outputs=["y"], dt=1.0).u[:, 0].tolist() == [5, 4]


def save_hdf5(path, **arrays):
    with h5py.File(path, "w") as file:
        for name, value in arrays.items():
            file[name] = value


def save_mat73(path, **arrays):
    """As MATLAB stores version 7.3: behind a user block, transposed, with its class."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in arrays.items():
            text = isinstance(value, str)
            data = np.frombuffer(value.encode("utf-16-le"), "<u2")[:, None] if text else np.atleast_2d(value).T
            file[name] = data
            file[name].attrs["MATLAB_class"] = np.bytes_(b"char" if text else b"double")
    with open(path, "rb+") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")


def save_mat(path, **arrays):
    scipy.io.savemat(path, arrays)


@pytest.mark.parametrize(
    ("extension", "save"), [(".npz", np.savez), (".mat", save_mat), (".h5", save_hdf5), (".mat", save_mat73)]
)
def test_foreign_arrays(tmp_path, extension, save):
    rng = np.random.default_rng(0)
    u, y, x = rng.standard_normal((30, 2)), rng.standard_normal(30), rng.standard_normal((1, 30))
    path = tmp_path / f"f{extension}"
    save(path, u=u, y=y, extra=x, A=np.eye(3), Ts=0.25, note="text")
    data = load_experiment(path)
    assert same(data.u, u) and same(data.y[:, 0], y) and data.dt == 0.25
    assert [c.name for c in data.inputs] == ["u_1", "u_2"]
    other = load_experiment(path, inputs=["u_2"], outputs=["extra"])
    assert same(other.y[:, 0], x[0])
    with pytest.raises(ExciteError, match=r"no column 'A'; .*not columns: .*A \(shape \(3, 3\)\)"):
        load_experiment(path, outputs=["A"])
    with pytest.raises(ExciteError, match=r"dt = 0.5 s is given, but the file says 0.25 s"):
        load_experiment(path, dt=0.5)
    save(path, u=u.T, y=y[None], t=np.arange(30.0))
    assert same(load_experiment(path).u, u) and load_experiment(path).dt == 1.0
