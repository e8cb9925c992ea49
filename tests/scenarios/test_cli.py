"""The command line: exit codes, messages that name place, value and remedy, strict JSON, files that appear whole or not."""

import io
import json
import re
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from signal import SIGINT

import click
import numpy as np
import pytest
from paths import SHARED
from scipy.io import loadmat

from excite.files import load_recording, load_signal, save_experiment
from excite.files.formats import FORMATS
from excite.generators import GENERATORS
from identify.data.records import Kind
from identify.examples import example_of
from identify.metrics.registry import METRICS
from identify.registry import METHODS, load_method, method_class
from plants.registry import PLANTS
from scenarios.cli.main import COMMANDS, cli, status
from scenarios.scenario.spec import shipped

DRYER = SHARED / "data" / "daisy_dryer" / "dryer.dat"
ROLES = ("--inputs", "0", "--outputs", "1", "--dt", "0.1")


def excite(*argv):
    """Run the command line in this process: (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def strict(text):
    """Parse one JSON object that holds no NaN or infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)


def refused(*argv, code=2):
    """Assert a refusal in words: nothing on stdout, no traceback; return the message."""
    got, out, err = excite(*argv)
    assert (got, out) == (code, ""), (got, out, err)
    assert "Traceback" not in err and err.strip()
    return err


def samples(count=300, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    return np.column_stack([u, np.convolve(u, [0, 1, 0.5, 0.2])[:count] + 0.01 * rng.standard_normal(count)])


def write(path, values):
    np.savetxt(path, values, delimiter=",")
    return path


@pytest.fixture
def data(tmp_path):
    return write(tmp_path / "data.csv", samples())


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A short flight of the quadrotor, played by the commands themselves, and the folder it lies in."""
    folder = tmp_path_factory.mktemp("flight")
    design = ("--order", "5", "--dt", "0.1", "--channels", "3", "--amplitude", "2,2,5")
    assert excite("design", "prbs", *design, "-o", folder / "played.csv")[0] == 0
    assert (
        excite("simulate", "quadrotor", "--input", folder / "played.csv", "--seed", "4", "-o", folder / "flight.npz")[0]
        == 0
    )
    return folder


def commands():
    """Every command and subcommand as argument vectors."""
    context = click.Context(cli)
    for name in COMMANDS:
        command = cli.get_command(context, name)
        yield (name,), command
        if isinstance(command, click.Group):
            yield from (((name, sub), command.get_command(context, sub)) for sub in command.list_commands(context))


# Help, usage ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "command"), [pytest.param(w, c, id=" ".join(w)) for w, c in commands()])
def test_help_says_what_each_option_is_for(words, command):
    code, out, err = excite(*words, "--help")
    assert (code, err) == (0, "")
    assert command.help.split()[0] in out
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.hidden:
            assert parameter.opts[0] in out
            assert len(parameter.help.split()) >= 2, parameter.opts
    assert excite(*words, "-h") == (0, out, "")


def test_top_level_help_lists_every_command_and_exit_code():
    code, out, _ = excite("--help")
    assert code == 0
    assert [name for name in COMMANDS if f"\n  {name} " not in out] == []
    assert [c for c in ("0 ", "1 ", "2 ", "3 ", "70 ", "130 ") if c not in out.split("Exit codes:")[1]] == []


def test_design_offers_every_parameter_of_the_generator():
    assert set(cli.get_command(None, "design").list_commands(None)) == {*GENERATORS, "parts", "propose"}
    _, out, _ = excite("design", "prbs", "--help")
    assert "degree n, 2 to 32" in out and "[default: 1.0]" in out and "--duration-s" in out


@pytest.mark.parametrize("name", METHODS)
def test_methods_explain_every_setting(name):
    described, listed = excite("methods", name)[1].split("settings:")
    own = {each for names in re.findall(r"((?:\w+, )*\w+) : ", described) for each in names.split(", ")}
    for line in listed.strip().splitlines():
        setting, _, _, *meaning = line.split()
        assert meaning or setting in own, line


@pytest.mark.parametrize(
    ("argv", "remedy"),
    [
        (["identfy"], "did you mean 'identify'?"),
        (["identify", "x.csv", "--metod", "arx"], "--method"),
        (["design", "prsb"], "did you mean 'prbs'?"),
        (["plants", "quadroter"], "did you mean 'quadrotor'?"),
        (["methods", "po_mosp"], "did you mean 'po_moesp'?"),
        (["metrics", "frf_error"], "did you mean 'frf_error_h2'?"),
        (["formats", "hdf"], "did you mean 'hdf5'?"),
        (["guide", "indx"], "did you mean 'index'?"),
        (["scenarios", "quadrotor_prb"], "did you mean 'quadrotor_prbs'?"),
        (["run", "quadrotor_prb"], "did you mean 'quadrotor_prbs'?"),
        (["simulate", "quadroter", "--input", "x.csv", "-o", "y.npz"], "did you mean 'quadrotor'?"),
        (["identify", "x.csv", "--method", "po_mosp"], "did you mean 'po_moesp'?"),
        (["compare", "x.csv", "--methods", "arx,po_mosp", "-o", "y"], "did you mean 'po_moesp'?"),
        (["identify", "--method", "arx"], "Missing argument 'FILE...'"),
        (["identify", "x.csv"], "Missing option '--method'"),
        (["doctor", "please"], "unexpected extra argument"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_misspellings_are_met_with_the_nearest_name(argv, remedy, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert remedy in refused(*argv)
    assert list(tmp_path.iterdir()) == []


def test_no_arguments_show_the_commands():
    code, out, err = excite()
    assert (code, out) == (2, "") and "Commands:" in err


def test_a_bug_shows_its_traceback_and_70(monkeypatch):
    monkeypatch.setitem(COMMANDS, "doctor", "scenarios.cli.doctor:missing")
    code, _, err = excite("doctor")
    assert code == 70 and "Traceback" in err and "report it" in err


def test_interruption_is_130(monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("scenarios.cli.doctor.print_lines", interrupt)
    assert excite("doctor") == (130, "", "excite: interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="processes end otherwise there")
@pytest.mark.parametrize("module", ["excite.errors", "scenarios.cli.methods"])
def test_interruption_while_packages_load_is_quiet(module):
    code = f"""
import os, signal, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
sys.argv = ["excite", "methods"]
from scenarios.cli import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-SIGINT, "", "")


@pytest.mark.parametrize("argv", [["plants", "--json"], ["methods"], ["--help"]], ids=" ".join)
def test_a_closed_pipe_ends_quietly(argv):
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "excite", *argv], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdout.close()
    err = process.stderr.read()
    assert (process.wait(60), err) == (0, "")


# identify -------------------------------------------------------------------------------------------------------------


def identify(path, *more, method="po_moesp", roles=ROLES):
    return ("identify", path, *roles, "--method", method, *more)


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


# score, compare ---------------------------------------------------------------------------------------------------------


def test_score_against_the_plants_truth(flight, tmp_path):
    model = tmp_path / "m.json"
    view = ("--view", "attitude", "--decimate", "5")
    assert excite("identify", flight / "flight.npz", *view, "--method", "arx", "--order", "3", "-o", model)[0] == 0
    code, out, _ = excite("score", model, flight / "flight.npz", *view, "--truth", "auto", "--json")
    values = strict(out)["values"]
    assert code == 0 and values["fit_one_step"] > 50 and 0 < values["frf_error_h2"] < 10
    assert (values["poles_missing"], values["poles_surplus"]) == (2, 0)  # three lags of three outputs against 11 states
    assert "pole_error_max" not in strict(excite("score", model, flight / "flight.npz", *view, "--json")[1])["values"]
    code, out, _ = excite("score", model, flight / "flight.npz", *view, "--truth", "auto")
    assert code == 0 and "frf_error_h2" in out
    assert "dt 0.02 s, the record 0.004 s" in refused("score", model, flight / "flight.npz", "--view", "attitude")
    roles = ("--inputs", "roll_ref", "--outputs", "roll")
    assert "drop --inputs" in refused("score", model, flight / "flight.npz", *roles, "--truth", "auto")


def test_score_refusals(data, tmp_path):
    model = tmp_path / "m.json"
    assert excite(*identify(data, "--order", "2", "-o", model))[0] == 0
    assert "not a recording" in refused("score", model, data, *ROLES, "--truth", "auto")
    assert "the record 0.2 s" in refused("score", model, data, *ROLES[:4], "--dt", "0.2")
    wide = write(tmp_path / "wide.csv", np.hstack([samples(), samples(seed=1)]))
    assert "1 outputs, the record 2" in refused(
        "score", model, wide, "--inputs", "0", "--outputs", "1,3", "--dt", "0.1"
    )
    broken = tmp_path / "broken.json"
    texts = {
        "": "not valid JSON",
        "[1]": "a JSON list, not a model",
        "{}": "key 'kind' is missing",
        '{"kind": "firr"}': "did you mean 'fir'",
        '{"kind": "fir"}': "key 'h' is missing",
    }
    for text, message in texts.items():
        broken.write_text(text)
        got = refused("score", broken, data, *ROLES)
        assert message in got and str(broken) in got
    broken.write_text(model.read_text()[:400])
    assert "not valid JSON" in refused("score", broken, data, *ROLES)
    assert "cannot be read" in refused("score", tmp_path / "absent.json", data, *ROLES)
    assert "cannot be read" in refused("score", tmp_path, data, *ROLES)


def test_compare_ranks_by_validation_fit_and_writes_the_models(data, tmp_path):
    folder = tmp_path / "out"
    argv = ("compare", data, *ROLES, "--methods", "arx,po_moesp", "--orders", "1,3,500", "-o", folder)
    code, out, err = excite(*argv, "--json")
    report = strict(out)
    fits = [row["values"]["fit_simulation"] for row in report["rows"] if row["reason"] is None]
    assert code == 0 and len(fits) == 4 and fits == sorted(fits, reverse=True)
    failed = [row for row in report["rows"] if row["reason"] is not None]
    assert [row["order"] for row in failed] == [500, 500] and all("largest possible" in row["reason"] for row in failed)
    models = {f"{method}-n{order}.json" for method in ("arx", "po_moesp") for order in (1, 3)}
    kept = {"index", "trials", ".lock"}  # by which the same command goes on where it was
    assert {p.name for p in folder.iterdir()} - kept == {"comparison.json"} | models
    assert strict((folder / "comparison.json").read_text()) == report
    assert "identifying" in err and "identifying" not in out
    code, out, _ = excite(*argv)
    assert code == 0 and "po_moesp n=500 failed" in out and "largest possible" in out


@pytest.mark.parametrize("orders", ["a", "", "2:", "5:2", "0:3", "2,,3", "-1", "1:2:3", "2.5", "1:1000000000000"])
def test_orders_that_make_no_sense(orders, data, tmp_path):
    message = refused("compare", data, *ROLES, "--methods", "arx", "--orders", orders, "-o", tmp_path / "out")
    assert f"--orders {orders}" in message and not (tmp_path / "out").exists()


def test_compare_that_cannot_work_leaves_no_folder(data, tmp_path):
    few = write(tmp_path / "few.csv", samples(2))
    argv, out = ("--methods", "arx", *ROLES, "-o"), tmp_path / "out"
    assert "few.csv: 2 samples" in refused("compare", few, *argv, out)
    assert "absent.csv" in refused("compare", data, "--validation", tmp_path / "absent.csv", *argv, out)
    assert "none of arx has this setting" in refused("compare", data, "--set", "block_row=3", *argv, out)
    assert "is no folder" in refused("compare", data, *argv, data)
    assert "is no folder" in refused("compare", data, *argv, "")
    assert not out.exists()
    code, text, _ = excite("compare", data, *argv, out, "--orders", "900")
    assert code == 2 and "largest possible" in text  # a table of reasons, but no model


# What there is ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "known"),
    [("plants", PLANTS), ("methods", METHODS), ("scenarios", shipped()), ("formats", FORMATS), ("metrics", METRICS)],
)
def test_catalogues(command, known):
    code, out, _ = excite(command)
    assert code == 0 and [line.split()[0] for line in out.splitlines()] == sorted(known)
    assert set(strict(excite(command, "--json")[1])[command]) == set(known)
    for name in known:
        code, out, err = excite(command, name)
        assert (code, err) == (0, "") and len(out.splitlines()) > 3
        assert list(strict(excite(command, name, "--json")[1])[command]) == [name]


def test_a_shipped_scenario_is_printed_as_a_starting_point():
    assert excite("scenarios", "quadrotor_prbs")[1] == shipped()["quadrotor_prbs"].read_text(encoding="utf-8")


def test_the_installed_command_is_this_one():
    done = subprocess.run([sys.executable, "-m", "excite", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("excite, version ")
    done = subprocess.run([sys.executable, "-m", "excite", "plans"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "") and "did you mean 'plants'?" in done.stderr


# excite orders ----------------------------------------------------------------------------------------------------------


def test_orders_says_what_speaks_for_each(data, tmp_path):
    asked = ("orders", data, *ROLES, "--method", "po_moesp", "--orders", "1:6")
    code, out, _ = excite(*asked, "--plot", tmp_path / "o.png", "--json")
    table = strict(out)
    assert code == 0 and [row["order"] for row in table["orders"]] == [1, 2, 3, 4, 5, 6]
    assert set(table["chosen"]) == {"gap", "aic", "aicc", "bic"} and table["chosen"]["bic"] >= 2
    assert (tmp_path / "o.png").stat().st_size > 10_000
    text = excite(*asked)[1]
    assert f"BIC: {table['chosen']['bic']}" in text and text.splitlines()[0].split()[0] == "order"


def test_orders_that_cannot_be_fitted_are_refused_or_listed(data):
    assert "no order of 400 could be fitted: po_moesp: order 400 is above the largest" in refused(
        "orders", data, *ROLES, "--method", "po_moesp", "--orders", "400"
    )
    out = excite("orders", data, *ROLES, "--method", "po_moesp", "--orders", "2,400")[1]
    assert "largest possible" in out and "best order by singular-value gap: 2" in out


def test_only_flights_are_filmed_and_into_gif_files(flight, tmp_path):
    argv = ("simulate", "quadrotor", "--input", flight / "played.csv", "-o", tmp_path / "f.npz")
    assert "ends in .gif" in refused(*argv, "--clip", tmp_path / "f.mp4")
    assert "only flights of the quadrotor" in refused(
        *(a if a != "quadrotor" else "goland" for a in argv), "--clip", "f.gif"
    )
    assert not list(tmp_path.iterdir())
