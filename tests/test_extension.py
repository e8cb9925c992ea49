"""What comes next fits by one file and one line: two packages outside ours, found through their entry points.

`tests/outside` holds one file per method and metric that ours does not have; the guide's page on plug-ins prints a second
package, with one of everything. Nothing in excite, identify, plants or scenarios knows of either.
"""

import json
import re
import shlex
import tomllib

import numpy as np
import pytest
from installed import install, plug_in, python
from paths import ROOT
from scipy.signal import lfilter

from excite.models.frequency_response import FrequencyResponse
from excite.registry import Registry
from excite.types.experiment import Experiment

OUTSIDE = ROOT / "tests" / "outside"
PAGE = (ROOT / "scenarios" / "guide" / "plug-ins.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (mine/\w+\.py)\n")

TANK = """
name = "tank"
plant = { name = "tank" }                                                                     # a plant of theirs
excitation = { kind = "square", dt = 1.0, half = 40, periods = 20 }                           # a generator of theirs
data = { estimation_runs = 2 }
view = [{ name = "plant", decimate = 1 }]
method = [
    { name = "etfe" },                                                                        # a response, no order
    { name = "frequency_subspace", order = 1, settings = { response = { method = "etfe", segment = 128 } } },
    { name = "chosen_lags", settings = { lags = [1, 3] } },                                   # a list
    { name = "bootstrapped", order = 1, settings = { inner = { method = "ssarx", past = 8, future = 8 } } },
    { name = "fir", order = "half" },                                                         # an order rule of theirs
    { name = "ssarx", order = 2, settings = { past = 8, future = 8, regions = ["damped"] } },
    { name = "ssarx", order = 2, settings = { past = 8, future = 8 } },                       # a second setting
]
score = { rank_by = ["gain_sd"] }                                                             # a metric of theirs
"""
LOOP = """
name = "loop"
plant = { name = "mercere_closed" }
excitation = { kind = "prbs", order = 8, dt = 1.0, periods = 12 }
data = { estimation_runs = 2 }
view = [{ name = "plant" }]
method = [
    { name = "two_stage", order = 4, settings = { inner = { method = "pi_moesp", block_rows = 15 } } },
    { name = "two_stage", order = 4, label = "arx behind" },
    { name = "bootstrapped", order = 4 },
]
"""
STEPS = """
name = "steps"
plant = { name = "thermal_ladder", parameters = { resistance = [2.0, 1.5], time_constant = [0.05, 6.0], dt = 0.005 } }
excitation = [{ kind = "multistep", form = "step", lead_s = 0.0, dt = 0.005, unit_s = 20.0, amplitude = 10.0 }]
view = [{ name = "plant", decimate = 1 }]
method = [{ name = "log_steps" }, { name = "sbr", order = 2, settings = { block_rows = 90, at_rest = true } }]
"""


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """Folders that hold both packages as if they were installed."""
    folder = tmp_path_factory.mktemp("packages")
    blocks = BLOCK.findall(PAGE)
    printed = tomllib.loads(next(text for language, text in blocks if language == "toml"))["project"]
    modules = {FILE.match(text)[1]: text for language, text in blocks if language == "python"}
    install(folder, printed["name"], modules, printed["entry-points"])
    outside = tomllib.loads((OUTSIDE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(folder, outside["name"], None, outside["entry-points"])
    return folder, OUTSIDE


@pytest.fixture(scope="session")
def excite(packages):
    """The command line with both packages, in a process of its own."""

    def run(line, cwd):
        return python("-m", "excite", *shlex.split(line), path=packages, cwd=cwd)

    return run


@pytest.fixture
def here(packages, monkeypatch):
    """Both packages, in this process."""
    from identify.metrics.registry import METRICS
    from identify.registry import METHODS
    from identify.steps.regions import REGIONS

    for folder in packages:
        for registry in (METHODS, METRICS, REGIONS):
            plug_in(monkeypatch, registry, folder)


@pytest.fixture(scope="session")
def finished(excite, tmp_path_factory):
    """The folders of three finished runs and what was printed."""
    home, printed = tmp_path_factory.mktemp("runs"), {}
    for name, text in (("tank", TANK), ("loop", LOOP), ("steps", STEPS)):
        (home / f"{name}.toml").write_text(text, encoding="utf-8")
        code, out, err = excite(f"run {name}.toml -o {name} --jobs 1", home)
        assert code == 0, (name, out, err)
        printed[name] = out, err
    return home, printed


def ranking(finished, name):
    """Rows of a run by their label."""
    scores = json.loads((finished[0] / name / "scores.json").read_text(encoding="utf-8"))
    return {row["label"]: row for row in scores["views"]["plant"]["ranking"]}


def recorded(count=2000, seed=0):
    """Input and output (count, 1) of two poles of modulus 0.84, with little noise."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    return u, lfilter([0, 1, 0.2], [1, -1.5, 0.7], u) + 0.02 * rng.standard_normal(count)


# Lists ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("methods", {"etfe", "frequency_subspace", "log_steps", "two_stage", "chosen_lags", "bootstrapped", "fir"}),
        ("metrics", {"gain_sd", "pole_radius"}),
        ("formats", {"one_column"}),
        ("plants", {"tank"}),
    ],
)
def test_plug_ins_are_listed_beside_ours(excite, tmp_path, command, names):
    code, out, err = excite(command, tmp_path)
    listed = {word for line in out.splitlines() for word in line.split()[:1]}
    assert code == 0 and names <= listed, (out, err)


def test_doctor_names_them_all(excite, packages, tmp_path):
    code, out, err = excite("doctor", tmp_path)
    assert code == 0 and "left out" not in out, (out, err)
    for file in packages[0].glob("*.dist-info/entry_points.txt"):
        for name in re.findall(r"^(\w+) = ", file.read_text(encoding="utf-8"), re.MULTILINE):
            assert re.search(rf"^.*plug-in: .*\b{name}\b", out, re.MULTILINE), (name, out)


# In a scenario ----------------------------------------------------------------------------------------------------------


def test_a_frequency_response_stands_beside_models_and_says_what_does_not_apply(finished):
    rows = ranking(finished, "tank")
    etfe = rows["etfe"]
    assert etfe["rank_value"] is None and etfe["order"] is None and "frf_error_h2" in etfe["metrics"]
    assert etfe["reasons"]["pole_error_max"] == "a FrequencyResponse has no poles"
    assert etfe["reasons"]["fit_simulation"] == "a FrequencyResponse cannot be simulated"
    assert list(rows)[-1] == "etfe"  # last, for the ranking metric does not apply
    printed = finished[1]["tank"][0]
    assert "not ranked by gain sd: a FrequencyResponse cannot be simulated" in printed


def test_a_method_on_frequency_responses_makes_one_of_the_records_and_says_so(finished):
    trial = json.loads(next(finished[0].glob("tank/models/plant/frequency_subspace*/run_00.json")).read_text())
    assert trial["estimate"]["settings"]["response"] == {"method": "etfe", "segment": 128}
    assert "frequency response estimated from the records by etfe" in trial["estimate"]["warnings"]


def test_lists_second_settings_order_rules_and_wrappers_make_rows(finished):
    rows = ranking(finished, "tank")
    twins = {label for label in rows if label.startswith("ssarx")}
    assert len(twins) == 2 and any("damped" in label for label in twins)
    assert rows["fir"]["order"] == "half" and re.search(r"fir n=half: .*order \d+ chosen", finished[1]["tank"][0])
    assert rows["chosen_lags"]["metrics"]["pole_error_max"]["median"] < 0.01
    assert rows["bootstrapped"]["metrics"]["pole_error_max"]["median"] < 0.01


def test_a_bootstrap_leaves_its_uncertainty_in_the_file_of_its_trial(finished):
    trial = json.loads(next(finished[0].glob("tank/models/plant/bootstrapped*/run_00.json")).read_text())
    known = trial["estimate"]["uncertainty"]
    true = np.exp(-1 / 20)
    sd = np.sqrt(known["pole_covariance"][0][0][0])
    assert known["kind"] == "bootstrap" and known["withheld"] is None
    assert 0 < sd and abs(trial["estimate"]["poles"][0]["re"] - true) < 5 * sd


def test_the_fisher_information_of_any_model_is_a_metric_that_ranks(finished):
    rows = ranking(finished, "tank")
    found = {label: row["metrics"]["gain_sd"]["median"] for label, row in rows.items() if "gain_sd" in row["metrics"]}
    assert {"fir", "chosen_lags", "frequency_subspace", "bootstrapped"} < found.keys()
    assert list(found.values()) == sorted(found.values()) and all(sd > 0 for sd in found.values())


def test_a_figure_of_theirs_is_drawn_into_the_report(finished):
    folder = finished[0] / "tank"
    assert "took longest" in (folder / "figures/plant-seconds.json").read_text(encoding="utf-8")
    assert 'id="figure-plant-seconds"' in (folder / "report.html").read_text(encoding="utf-8")


def test_a_closed_loop_wrapper_around_any_method(finished):
    rows = ranking(finished, "loop")
    best = next(row for label, row in rows.items() if label != "arx behind" and label.startswith("two_stage"))
    assert (
        best["metrics"]["pole_error_max"]["median"] < 0.03 < rows["arx behind"]["metrics"]["pole_error_max"]["median"]
    )
    assert "biased in closed loop" not in finished[1]["loop"][0]
    assert "the loop is closed, and replaying residuals holds in open loop" in rows["bootstrapped"]["reason"]


def test_log_spaced_steps_in_a_scenario(finished):
    row = ranking(finished, "steps")["log_steps"]
    assert row["reason"] is None and row["metrics"]["fit_clean"]["median"] > 99.8


# In a comparison --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def compared(excite, tmp_path_factory):
    home = tmp_path_factory.mktemp("compared")
    np.savetxt(home / "data.csv", np.column_stack(recorded()), delimiter=",", header="u,y", comments="")
    methods = (
        "etfe,frequency_subspace,chosen_lags(lags=[1,2,5]),bootstrapped(inner=ssarx),fir,ssarx(past=30),ssarx,"
        "two_stage,log_steps"
    )
    line = f"--methods '{methods}' --orders 2 --set regions='[\"damped\"]' -o out"
    code, out, err = excite(f"compare data.csv --inputs u --outputs y --dt 0.1 {line}", home)
    assert code == 0, (out, err)
    report = json.loads((home / "out/comparison.json").read_text(encoding="utf-8"))
    return {row["label"]: row for row in report["rows"]}, out


def test_all_stand_side_by_side(compared):
    rows, out = compared
    ranked = [label for label, row in rows.items() if row["reason"] is None]
    assert {"bootstrapped", "ssarx past=30", "ssarx past=20", "chosen_lags", "frequency_subspace", "fir"} <= set(ranked)
    for label in ("bootstrapped", "ssarx past=30", "ssarx past=20", "chosen_lags", "frequency_subspace"):
        assert rows[label]["values"]["fit_simulation"] > 99
    assert "needs the reference" in rows["two_stage"]["reason"]
    assert "the input moves after its first sample" in rows["log_steps"]["reason"]
    assert "etfe: no pole_radius: a FrequencyResponse has no poles" in out
    assert rows["ssarx past=30"]["values"]["gain_sd"] > 0


def test_steps_on_a_logarithmic_scale(excite, tmp_path):
    time_s = np.r_[0, np.logspace(-3, 2, 200)]
    for k in range(2):
        noise = 0.01 * np.random.default_rng(k).standard_normal(len(time_s))
        rise = 20 * -np.expm1(-time_s / 0.05) + 10 * -np.expm1(-time_s / 4) + noise
        columns = np.column_stack([time_s, np.full(len(time_s), 10.0), rise])
        np.savetxt(tmp_path / f"{k}.csv", columns, delimiter=",", header="t,P,T", comments="")
    read = "0.csv --inputs P --outputs T --time t --validation 1.csv --methods log_steps,arx --orders 1 -o out"
    code, out, err = excite(f"compare {read}", tmp_path)
    rows = {row["label"]: row for row in json.loads((tmp_path / "out/comparison.json").read_text())["rows"]}
    assert code == 0 and rows["log_steps"]["values"]["fit_simulation"] > 99.5, (out, err)
    assert "sampling is not uniform" in rows["arx"]["reason"]


def test_an_export_format_of_theirs_is_written_and_read(excite, tmp_path):
    line = "design prbs --order 5 --dt 0.1 -o u.one"
    assert excite(line, tmp_path)[0] == 0
    assert np.loadtxt(tmp_path / "u.one").shape == (31,)


# In Python --------------------------------------------------------------------------------------------------------------


def test_frequency_responses_are_compared_as_data(here):
    from excite_outside.frequency_subspace import FrequencySubspace

    from identify.compare import compare
    from identify.subspace.ssarx import Ssarx

    z = np.exp(2j * np.pi * np.linspace(0, 0.5, 129))
    G = FrequencyResponse(np.linspace(0, 5, 129), ((z + 0.2) / (z**2 - 1.5 * z + 0.7))[:, None, None], dt=0.1)
    u, y = recorded()
    found = compare(G, [FrequencySubspace(), Ssarx()], [2], validation=Experiment(u, y, dt=0.1))
    good, bad = found.rows
    assert good.label == "frequency_subspace" and good.summary["fit_simulation"]["median"] > 99
    assert np.abs(np.abs(good.trials[0].estimate.model.poles()) - np.sqrt(0.7)).max() < 1e-6
    assert "the data are a frequency response" in bad.reason


def test_a_region_of_theirs_holds_in_every_state_space_method(here):
    from identify.examples import example_of
    from identify.fit import fit
    from identify.method import with_settings
    from identify.registry import METHODS, list_methods, load_method

    names = [name for name in list_methods() if "regions" in METHODS[name].setting_names()]
    assert "frequency_subspace" in names and len(names) >= 15
    for name in names:
        method = with_settings(load_method(name), regions=("damped",))
        data, truth = example_of(method)
        poles = fit(data, method, len(truth.poles())).model.poles()
        assert np.abs(poles).max() <= 0.99 + 1e-9, name


@pytest.mark.parametrize(
    ("name", "settings"),
    [("chosen_lags", {}), ("etfe", {}), ("frequency_subspace", {}), ("two_stage", {"inner": "pi_moesp"})],
)
def test_methods_from_outside_conform(here, name, settings):
    from identify.conformance import check
    from identify.registry import load_method

    check(load_method(name, **settings))


def test_the_tables_are_all_open():
    from importlib import import_module

    from scenarios.cli.doctor import REGISTRIES

    tables = [getattr(import_module(module), name) for module, name in (place.split(":") for place in REGISTRIES)]
    assert len(tables) >= 8 and all(isinstance(table, Registry) for table in tables)
