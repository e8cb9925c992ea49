"""Bad data files: a clear message for each, nothing unpickled, nothing half written."""

import io
import json
import os
import pickle
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.files import load_experiment, load_recording, load_signal, read_table, save_experiment, save_signal
from excite.files.atomic import written
from excite.generators import prbs
from excite.plain import plain
from excite.types.experiment import Experiment
from excite.types.recipe import Recipe
from excite.types.signal import Signal

PLAIN = "time,u,y\n0,1,2.5\n0.1,3,\n0.2,5,6\n"


def experiment():
    rng = np.random.default_rng(1)
    return Experiment(rng.standard_normal((50, 2)), rng.standard_normal((50, 3)), dt=0.1)


BAD_TEXT = {
    "": r"is empty; it must hold at least one sample",
    "# only\n\n% comments\n": r"no data rows",
    "time,u,y\n": r"a header but no data rows",
    "t,u,y\n0,1,2\n1,2\n2,3,4\n": r"line 3 has 2 columns, line 2 has 3; every row",
    "t,u,y\n\n# c\n0,1,2\n1,2,3,4\n": r"line 5 has 4 columns, line 4 has 3; every row",
    "0 1 2\n1 2\n": r"line 2 has 2 columns, line 1 has 3; every row",
    "t,u,y\n0,1,2\n1,two,3\n": r"line 3, column 1: 'two' is not a number",
    "t,u,y\n0,1,2\n1,1_0,3\n": r"line 3, column 1: '1_0' is not a number",
    "oops,1,2\n0,1,2\n": r"line 1, column 0: 'oops' is not a number",
    "0 1 x\n0 1 2\n": r"line 1, column 2: 'x' is not a number",
    "t,u,y\ns,V,m\n0,1,2\n": r"line 2, column 0: 's' is not a number",
    "t,u,y\n0,1,2\n# c\n1,inf,3\n": r"line 4, column 1 is infinite",
    "t,u,y\n0,1,2\n1,1e999,3\n": r"line 3, column 1 is infinite",
    "t;u;y\n0;1,5;2\n1;1.5;3\n": r"line 2, column 1: '1,5' has a comma, other numbers a point",
    "t,u\n0,1,2\n1,2,3\n": r"the header names 2 columns, the data rows have 3; make them agree",
    "t,u,y\n0,1,2\n0,1,2\n": r"time does not increase after sample 0",
    "t,u,y\n0,1,2\n,1,2\n": r"column 0: the time of sample 1 is missing",
    "u,u,y\n0,1,2\n": r"several columns are called|duplicate names|give dt",
    "t,y\n0,1\n": r"give inputs \(--inputs\) by name or number from 0, or none .*columns: 0 't', 1 'y'",
    "a,b\n0,1\n": r"give inputs \(--inputs\) and outputs \(--outputs\) by name or number from 0; columns: 0 'a', 1 'b'",
    "u,y\n0,1\n": r"give dt in s \(--dt\) or the time column \(--time\); columns: 0 'u', 1 'y'",
    "a\0b": r"is not a text file",
    '"' + "x" * 200000 + '",1\n': r"not a table of numbers",
}


@pytest.mark.parametrize("text", BAD_TEXT, ids=range(len(BAD_TEXT)))
def test_bad_text_names_file_place_and_remedy(tmp_path, text):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ExciteError, match=BAD_TEXT[text]) as caught:
        load_experiment(path)
    assert str(caught.value).startswith(f"{path}: ") and len(str(caught.value)) < 1000


cells = st.text(alphabet='019.,;-+eE \t"#%[]_:uyrtinfa\ufeff\0°\r', max_size=6) | st.floats().map(str)
lines = st.lists(st.lists(cells, max_size=4).map(",".join) | st.lists(cells, max_size=4).map(" ".join), max_size=6)


@given(raw=lines.map("\n".join).map(str.encode) | st.binary(max_size=200))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_load_or_are_refused_in_words(tmp_path, raw):
    path = tmp_path / "any.csv"
    path.write_bytes(raw)
    for flags in ({}, {"inputs": [0], "outputs": [1], "dt": 1.0}, {"inputs": ["u"], "outputs": ["y"], "time": "t"}):
        try:
            load_experiment(path, **flags)
        except ExciteError as error:
            assert str(error).startswith(f"{path}: ")


BAD_FLAGS = [
    ({"inputs": ["c"]}, r"inputs: no column 'c'; .*columns: 0 'time', 1 'u', 2 'y'"),
    ({"inputs": [3]}, r"inputs: no column 3; columns: 0 'time'"),
    ({"inputs": [-1]}, r"inputs: no column -1"),
    ({"inputs": [1.0]}, r"inputs: no column 1.0"),
    ({"inputs": [""]}, r"inputs: no column ''"),
    ({"outputs": []}, r"give outputs \(--outputs\)"),
    ({"inputs": [1, "u"]}, r"inputs: \[1, 'u'\] name a column twice"),
    ({"inputs": [2]}, r"column 2 is both input and output"),
    ({"outputs": ["why"]}, r"outputs: no column 'why'"),
    ({"reference": ["q"]}, r"reference: no column 'q'"),
    ({"time": "u"}, r"time: column 1 has another role too"),
    ({"time": "never"}, r"time: no column 'never'"),
    ({"dt": 0.2}, r"dt = 0.2 s is given, but column 0 steps by 0.1 s on average"),
    ({"dt": -1}, r"dt: -1 is not a positive"),
    ({"view": "rates"}, r"view 'rates' needs a recording"),
]


@pytest.mark.parametrize(("flags", "message"), BAD_FLAGS, ids=[str(flags) for flags, _ in BAD_FLAGS])
def test_bad_flags(tmp_path, flags, message):
    path = tmp_path / "f.csv"
    path.write_text(PLAIN)
    with pytest.raises(ExciteError, match=message) as caught:
        load_experiment(path, **flags)
    assert str(caught.value).startswith(f"{path}: ")


def test_times_in_other_units_and_without_a_grid(tmp_path):
    path = tmp_path / "f.csv"
    path.write_text("t [ms],u,y\n0,1,2\n1,1,2\n3,1,2\n")
    with pytest.raises(ExciteError, match=r"column 't \[ms\]' is not in seconds; convert it"):
        load_experiment(path, time=0)
    with pytest.raises(ExciteError, match="give dt in s"):
        load_experiment(path)
    path.write_text("t,u,y\n0,1,2\n1,1,2\n3,1,2\n")
    assert load_experiment(path).dt is None
    with pytest.raises(ExciteError, match="not uniform; resample it"):
        load_signal(path)


def test_a_missing_sample_cannot_be_played(tmp_path):
    (tmp_path / "f.csv").write_text("t,u\n0,1\n1,\n")
    with pytest.raises(ExciteError, match=r"f.csv: Signal.u: sample 1, column 0 is nan"):
        load_signal(tmp_path / "f.csv")


@pytest.mark.parametrize("extension", [".csv", ".npz", ".mat", ".dat", ".h5", ".wav", ".h", ".arb", ".raf", ".bin"])
def test_what_is_not_a_file(tmp_path, extension):
    path = tmp_path / f"f{extension}"
    with pytest.raises(ExciteError, match="no such file; check the path"):
        read_table(path)
    path.mkdir()
    with pytest.raises(ExciteError, match="is a folder; name a file in it"):
        read_table(path)
    path.rmdir()
    path.touch()
    with pytest.raises(ExciteError, match="is empty"):
        read_table(path)
    with pytest.raises(ExciteError, match="null character"):
        read_table(f"a\0b{extension}")
    if os.geteuid():
        path.write_text("1,2\n")
        path.chmod(0)
        with pytest.raises(ExciteError, match="cannot be read"):
            read_table(path)


@pytest.mark.parametrize("extension", [".npz", ".mat", ".h5"])
@pytest.mark.parametrize("damage", ["noise", "cut", "flipped"])
def test_damaged_binary_files(tmp_path, extension, damage):
    path = tmp_path / f"f{extension}"
    save_experiment(experiment(), path)
    raw = bytearray(path.read_bytes())
    if damage == "noise":
        raw = np.random.default_rng(0).bytes(500)
    elif damage == "cut":
        raw = raw[: len(raw) // 2]
    else:
        at = max(raw.find(experiment().u[:1, 0].tobytes()), 0) or len(raw) // 2  # in the samples, where they are plain
        raw[at : at + 20] = b"\xff" * 20
    path.write_bytes(raw)
    with pytest.raises(ExciteError, match=f"f{extension}: "):
        load_experiment(path)


@pytest.mark.parametrize(
    "meta",
    [
        {"kind": "recording"},
        {"dt": "soon"},
        {"dt": [1]},
        {"dt": 0.1, "loop": {"closed": True}},
        {"dt": -1},
        {"dt": 0.1, "loop": 3},
        [1],
        "x",
        {"dt": 0.1, "loop": {"closed": 1, "controller": 5, "sign": 1, "entry": "x"}},
    ],
)
def test_damaged_descriptions(tmp_path, meta):
    columns = np.array(json.dumps(["time_s", "u:a", "y:b"]))
    one = np.ones((3, 1))
    np.savez(tmp_path / "f.npz", time_s=np.arange(3.0), u=one, y=one, columns=columns, meta=np.array(json.dumps(meta)))
    with pytest.raises(ExciteError, match=r"f\.npz: "):
        load_experiment(tmp_path / "f.npz")


@pytest.mark.parametrize("columns", [["time_s", "u:a", "u:b"], ["time_s", "q:a"], [3], 5, ["time_s", "y:a"], {}])
def test_column_lists_that_do_not_fit(tmp_path, columns):
    arrays = {"time_s": np.arange(3.0), "u": np.ones((3, 1)), "meta": np.array("{}")}
    np.savez(tmp_path / "f.npz", columns=np.array(json.dumps(columns)), **arrays)
    with pytest.raises(ExciteError, match=r"f\.npz: "):
        read_table(tmp_path / "f.npz")


class Bomb:
    fired = False

    def __reduce__(self):
        return (setattr, (Bomb, "fired", True))


def test_pickled_objects_are_never_loaded(tmp_path):
    pickle.loads(pickle.dumps(Bomb()))
    assert Bomb.fired
    Bomb.fired = False
    np.savez(tmp_path / "f.npz", u=np.array([Bomb()], dtype=object), y=np.ones(3))
    with pytest.raises(ExciteError, match="object arrays are never loaded"):
        read_table(tmp_path / "f.npz")
    assert not Bomb.fired


def test_archives_that_unpack_beyond_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("excite.files.npz.MAX_BYTES", 1000)
    monkeypatch.setattr("excite.files.mat.MAX_BYTES", 1000)
    monkeypatch.setattr("excite.files.hdf5.MAX_BYTES", 1000)
    np.savez_compressed(tmp_path / "f.npz", u=np.zeros(10_000))
    scipy.io.savemat(tmp_path / "f.mat", {"u": np.zeros(10_000)}, do_compression=True)
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file.create_dataset("u", (10**15,), "f8", chunks=(1000,), compression="gzip")
    for name in ("f.npz", "f.mat", "f.h5"):
        with pytest.raises(ExciteError, match="split the file"):
            read_table(tmp_path / name)


def test_an_array_that_lies_about_its_size_is_refused(tmp_path):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    with zipfile.ZipFile(tmp_path / "f.npz", "w") as archive:
        archive.writestr("u.npy", stream.getvalue())
    with pytest.raises(ExciteError, match=r"cannot be read as \.npz"):
        read_table(tmp_path / "f.npz")


def test_a_lone_array_is_no_archive(tmp_path):
    np.save(tmp_path / "f.npy", np.ones(3))
    os.rename(tmp_path / "f.npy", tmp_path / "f.npz")
    with pytest.raises(ExciteError, match=r"is not an \.npz archive; write it with numpy.savez"):
        read_table(tmp_path / "f.npz")


def test_mat_structs_cells_and_complex_arrays_are_never_columns(tmp_path):
    cells = np.array(["a", 1.0], dtype=object)
    given = {"s": {"u": np.ones(3)}, "c": cells, "z": np.ones(3) * 1j}
    scipy.io.savemat(tmp_path / "f.mat", given)
    with pytest.raises(ExciteError, match=r"no real numeric array.*s \(struct\).*c \(cell\).*z \(complex128"):
        read_table(tmp_path / "f.mat")
    scipy.io.savemat(tmp_path / "f.mat", given | {"u": np.ones(3), "y": np.ones(3), "dt": 0.1})
    with pytest.raises(ExciteError, match=r"outputs: no column 's'.*s \(struct\)"):
        load_experiment(tmp_path / "f.mat", outputs=["s"])
    assert load_experiment(tmp_path / "f.mat").u.shape == (3, 1)


def test_a_damaged_mat_7_3_file_names_the_remedy(tmp_path):
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n".ljust(600, b"\0")
    (tmp_path / "f.mat").write_bytes(header)
    with pytest.raises(ExciteError, match=r"f\.mat: cannot be read as HDF5 .*; write it again"):
        read_table(tmp_path / "f.mat")


def test_hdf5_reads_nothing_but_plain_numbers_of_its_own(tmp_path):
    np.ones(3).tofile(tmp_path / "raw")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["u"] = np.ones(3)
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["link"] = h5py.ExternalLink("other.h5", "/u")
        file["soft"] = h5py.SoftLink("/u")
        file.create_dataset("raw", (3,), "f8", external=[(str(tmp_path / "raw"), 0, 24)])
        layout = h5py.VirtualLayout((3,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "u", (3,))
        file.create_virtual_dataset("virtual", layout)
        file["text"] = "import os"
        file["reference"] = np.array([file.ref], dtype=h5py.ref_dtype)
        file["pair"] = np.zeros(3, dtype=[("a", "f8"), ("b", "i4")])
        file["nothing"] = h5py.Empty("f8")
        file.create_group("struct")["u"] = np.ones(3)
    found = r"link \(ExternalLink\).*nothing \(empty\).*raw \(stored outside.*soft \(SoftLink\).*struct \(group\)"
    with pytest.raises(ExciteError, match=found + r".*text \(object\), virtual \(stored outside the file\)"):
        read_table(tmp_path / "f.h5")
    with h5py.File(tmp_path / "f.h5", "a") as file:
        file["u"] = np.arange(3.0)
    assert read_table(tmp_path / "f.h5").names == ("u",)


def test_unknown_extensions(tmp_path):
    for name in ("f.xyz", "f"):
        (tmp_path / name).write_text("1 2\n")
        with pytest.raises(
            ExciteError, match=r"is not known; known: .arb, .bin, .csv, .dat, .h, .h5, .hdf5, .mat, .npz, "
        ):
            read_table(tmp_path / name)
        with pytest.raises(ExciteError, match="is not known"):
            save_signal(prbs(order=3, dt=1.0), tmp_path / name)
    with pytest.raises(ExciteError, match=r"only read; write one of .csv, .npz, .mat, .h5"):
        save_signal(prbs(order=3, dt=1.0), tmp_path / "f.dat")


def test_load_recording_refuses_other_files(tmp_path):
    save_experiment(experiment(), tmp_path / "e.npz")
    with pytest.raises(ExciteError, match="not a recording of excite"):
        load_recording(tmp_path / "e.npz")


def test_plain_refuses_what_json_cannot_hold(tmp_path):
    with pytest.raises(ExciteError, match=r"meta.recipe.decisions.f\[1\]: a function cannot be written"):
        save_signal(Signal(np.ones(2), 1.0, recipe=Recipe("test", decisions={"f": [1, plain]})), tmp_path / "s.npz")


# ---- atomic writing


def test_written_replaces_only_on_success(tmp_path):
    path = tmp_path / "f"
    with written(path) as temporary:
        temporary.write_text("old")
    with pytest.raises(RuntimeError, match="halfway"), written(path) as temporary:
        temporary.write_text("new")
        raise RuntimeError("halfway")
    with pytest.raises(KeyboardInterrupt), written(path) as temporary:
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with written(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new"


def test_written_follows_a_link_to_its_target(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with written(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "real").read_text() == "new" and (tmp_path / "link").is_symlink()


def test_written_errors_name_the_path(tmp_path):
    with pytest.raises(ExciteError, match=r"no folder .*missing; create it first"), written(tmp_path / "missing/f"):
        pass
    with pytest.raises(ExciteError, match="is a folder"), written(tmp_path):
        pass
    with pytest.raises(ExciteError, match="null character"), written("a\0b"):
        pass
    with pytest.raises(ExciteError, match=r"f: cannot be written \(No space left"), written(tmp_path / "f"):
        raise OSError(28, "No space left on device")
    if os.geteuid():
        tmp_path.chmod(0o500)
        with pytest.raises(ExciteError, match="cannot be written"), written(tmp_path / "f"):
            pass
        tmp_path.chmod(0o700)
    assert list(tmp_path.iterdir()) == []
