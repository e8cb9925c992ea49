"""Files of other programs: dialects, encodings, columns, time stamps."""

import h5py
import numpy as np
import pytest
import scipy.io
from paths import SHARED
from written_files import experiment, same

from excite.errors import ExciteError
from excite.files import load_experiment, load_signal, save_experiment
from excite.files.roles import uniform_step
from excite.types.channel import Channel

DRYER = SHARED / "data" / "daisy_dryer" / "dryer.dat"


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
