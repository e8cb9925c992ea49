"""`excite identify`: what it reads, refuses and prints."""

from importlib import import_module

import numpy as np
import pytest
from command_line import ROLES, excite, identify, refused, samples, strict, write
from paths import SHARED

from excite.files import save_experiment
from identify.data.records import Kind
from identify.examples import example_of
from identify.registry import METHODS, load_method, method_class

DRYER = SHARED / "data" / "daisy_dryer" / "dryer.dat"


def test_files_that_cannot_be_read_are_named(tmp_path):
    values = samples()
    infinite, constant, uneven = (tmp_path / f"{n}.csv" for n in ("inf", "constant", "uneven"))
    values[5, 1] = np.inf
    write(infinite, values)
    values[:, 1] = values[:, 0]
    values[:, 0] = 3.0
    write(constant, values)
    uneven.write_text("1,2\n3,4,5\n")
    (tmp_path / "empty.csv").touch()
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)) * 8)
    (tmp_path / "folder.csv").mkdir()
    expected = {
        "absent.csv": "no such file",
        "folder.csv": "is a folder",
        "empty.csv": "is empty",
        "binary.csv": "not a text file",
        "uneven.csv": "line 2 has 3 columns",
        "inf.csv": "line 6, column 1 is infinite",
        "constant.csv": "input 'u1' is constant (3)",
    }
    for name, text in expected.items():
        message = refused(*identify(tmp_path / name, "--order", 2))
        assert name in message and text in message
    for name in list(expected)[:5]:
        message = refused("check", tmp_path / name, "--inputs", "0", "--dt", "0.1")
        assert name in message and expected[name] in message


def test_missing_samples_are_left_out_and_said(tmp_path):
    values = samples()
    values[100, 1] = np.nan
    code, out, err = excite(*identify(write(tmp_path / "gap.csv", values), "--order", 2, "--json"))
    result = strict(out)
    assert (code, err) == (0, "") and "1 of 300 samples are incomplete (NaN): 2 gap-free parts" in result["warnings"][0]
    assert len(result["x0"]) == 1 and result["fit"]["simulation"][0] > 50


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--order", "0"], "order 0; give a whole number from 1 to 19"),
        (["--order", "-1"], "order -1; give a whole number from 1 to 19"),
        (["--order", "20"], "largest possible, 19"),
        (["--order", "99999999999"], "largest possible, 19"),
        (["--order", "two"], "'two' is not a valid integer"),
        (["--order", "2.5"], "'2.5' is not a valid integer"),
        (["--set", "block_rows=0"], "block_rows: 0; give a whole number of at least 1"),
        (["--set", "block_rows=51"], "the largest possible past + future is 100"),
        (["--set", "block_rows=1000000000000"], "the largest possible past + future is 100"),
        (["--set", "block_rows=2", "--order", "2"], "largest possible, 1"),
        (["--set", "block_rows=3.5"], "3.5; give a whole number"),
        (["--set", "block_rows=many"], "'many'; give a whole number"),
        (["--set", "feedthrough=1"], "1; give true or false"),
        (["--set", "block_row=3"], "did you mean 'block_rows'?"),
        (["--set", "block_rows"], "--set block_rows: give key=value"),
        (["--set", "block_rows="], "--set block_rows=: give key=value"),
        (["--set", "=3"], "--set =3: give key=value"),
        (["--decimate", "0"], "'--decimate'"),
        (["--dt", "0"], "dt: 0.0 is not a positive finite number"),
        (["--dt", "nan"], "dt: nan is not a positive finite number"),
        (["--outputs", "7"], "outputs: no column 7"),
        (["--outputs", "0"], "column 0 is both input and output"),
        (["--inputs", ","], "columns ',': give names or numbers"),
        (["--view", "rates"], "view 'rates' needs a recording"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_impossible_requests_name_value_and_remedy(more, text, data):
    assert text in refused(*identify(data, *more))


def test_arx_needs_an_order(data):
    assert "give the order" in refused(*identify(data, method="arx"))


WITHOUT_NOISE_MODEL = {
    "cobra",
    "io_realization",
}  # shift invariance of outputs or covariances says nothing of the noise


@pytest.mark.parametrize("method", [name for name in METHODS if Kind.SERIES not in method_class(name).takes])
def test_identify_takes_the_records_a_method_asks_for(method, tmp_path):
    records, _ = example_of(load_method(method))
    paths = [tmp_path / f"{k}.csv" for k in range(len(records))]
    for record, path in zip(records, paths, strict=True):
        save_experiment(record, path)
    asked = ("identify", *paths, "--method", method, "--order", "4")
    result = strict(excite(*asked, "--json")[1])
    assert excite(*asked)[1].startswith(f"{method}, order 4")
    assert result["method"] == method and np.shape(result["A"]) == (4, 4) and len(result["poles"]) == 4
    assert np.shape(result["x0"]) == (len(records), 4)


@pytest.mark.parametrize("method", [name for name in METHODS if Kind.SERIES in method_class(name).takes])
def test_identify_prints_one_strict_object(method, data):
    assert excite(*identify(data, "--order", "3", method=method))[1].startswith(f"{method}, order 3")
    code, out, _ = excite(*identify(data, "--order", "3", "--json", method=method))
    result = strict(out)
    assert code == 0 and result["method"] == method and result["order"] == 3 and result["dt"] == 0.1
    keys = {"schema_version", "kind", "poles", "singular_values", "fit", "uncertainty", "status", "warnings", "seconds"}
    assert keys <= set(result)
    if result["kind"] == "state_space":
        assert np.shape(result["A"]) == (3, 3) and np.shape(result["x0"]) == (1, 3)
    assert result["fit"]["simulation"][0] > 90
    if method in WITHOUT_NOISE_MODEL:
        assert result["K"] is None
    else:
        assert result["fit"]["one_step"][0] > 90
        if result["kind"] == "state_space":
            assert np.shape(result["innovation_cov"]) == (1, 1) and np.shape(result["K"]) == (3, 1)
    assert set(result["poles"][0]) == {"re", "im", "f_hz", "zeta", "tau_s"}


def test_identify_chooses_an_order_and_says_so(data):
    result = strict(excite(*identify(data, "--json"))[1])
    assert any("largest singular-value gap" in warning for warning in result["warnings"])


@pytest.mark.parametrize("rule", ["gap", "aic", "aicc", "bic"])
def test_identify_takes_the_rule_that_chooses_the_order(rule, data):
    result = strict(excite(*identify(data, "--order", rule, "--json"))[1])
    assert any(f"order {result['order']} chosen" in w and rule in w.lower() for w in result["warnings"])


def test_json_stays_strict_where_a_number_is_missing(tmp_path):
    values = samples()
    values[:, 1] = np.where(np.arange(300) < 200, values[:, 1], 2.0)
    train, flat = write(tmp_path / "train.csv", values[:200]), write(tmp_path / "flat.csv", values[200:])
    model = tmp_path / "m.json"
    assert excite(*identify(train, "--order", "2", "-o", model))[0] == 0
    code, out, _ = excite("score", model, flat, *ROLES, "--json")
    found = strict(out)
    assert code == 0 and "fit_simulation" not in found["values"]  # the fit to a constant output has no meaning
    assert "is constant on this record" in found["reasons"]["fit_simulation"]
    assert found["per_output"]["fit_simulation"] == [None]


def test_several_files_give_one_estimate(tmp_path):
    parts = [write(tmp_path / f"{k}.csv", samples(seed=k)) for k in range(2)]
    result = strict(excite("identify", *parts, *ROLES, "--method", "ssarx", "--order", "3", "--json")[1])
    assert np.shape(result["x0"]) == (2, 3)
    message = refused("identify", *parts, *ROLES, "--method", "ssarx", "--order", "0")
    assert str(parts[0]) in message and str(parts[1]) in message


def test_outputs_that_cannot_be_written_are_refused_before_any_work(data, tmp_path, monkeypatch):
    def never(*_):
        raise AssertionError("worked first")

    monkeypatch.setattr(import_module("identify.fit"), "fit", never)
    for out, text in (
        ("", "is a folder"),
        (tmp_path, "is a folder"),
        (tmp_path / "no" / "m.json", "there is no folder"),
        (data / "m.json", "there is no folder"),
        (data, "would overwrite what is read"),
    ):
        assert text in refused(*identify(data, "--order", "2", "-o", out))
    assert [p.name for p in tmp_path.iterdir()] == ["data.csv"]


def test_unwritable_folder(data, tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    try:
        (closed / "probe").touch()
    except PermissionError:
        assert str(closed) in refused(*identify(data, "--order", "2", "-o", closed / "m.json"))
    else:
        pytest.skip("this user may write everywhere")


def test_daisy_dryer():
    if not DRYER.is_file():
        pytest.skip(f"DaISy dryer data are not at {DRYER}")
    command = ("--method", "po_moesp", "--order", "4", "--set", "block_rows=15", "--json")
    code, out, _ = excite("identify", DRYER, "--inputs", "0", "--outputs", "1", "--dt", "0.08", *command)
    result = strict(out)
    poles = sorted((p["re"], p["im"]) for p in result["poles"])
    known = [(0.4758, -0.1999), (0.4758, 0.1999), (0.7456, 0.0), (0.9610, 0.0)]
    assert code == 0
    np.testing.assert_allclose(poles, known, atol=1e-3)
    values = np.array([69.8841, 14.9963, 3.6675, 1.9677, 0.3000])
    ratio = np.array(result["singular_values"][:5]) / values
    np.testing.assert_allclose(ratio / ratio[0], 1, atol=2e-4)
