"""Scenarios that are refused before anything flies."""

import pytest
from short_scenario import OWN, SHORT, changed, excite, write

from excite.errors import SimulationStopped
from plants.quadrotor.plant import Quadrotor
from scenarios.run.run import run_scenario
from scenarios.scenario.reading import check_scenario, load_scenario, shipped

REFUSALS = {
    # unknown keys, at every level
    "nam": ({"nam": "x"}, "short.toml: nam: unknown key; did you mean 'name'?"),
    "plant": ({"plant/presett": "2013"}, "short.toml: plant.presett: unknown key; did you mean 'preset'?"),
    "parameters": (
        {"plant/parameters": {"mas": 1.0}},
        "plant: quadrotor parameter 'mas' does not exist; did you mean 'mass'?",
    ),
    "noise": ({"noise/thurst": 0.1}, "short.toml: noise.thurst: unknown key; did you mean 'thrust'?"),
    "loop": ({"loop/injekt": "x"}, "short.toml: loop.injekt: unknown key; did you mean 'inject'?"),
    "excitation": (
        {"excitation/ordr": 4},
        "short.toml: excitation.ordr: unknown key for a prbs; did you mean 'order'?",
    ),
    "data": (
        {"data/estimation_run": 3},
        "short.toml: data.estimation_run: unknown key; did you mean 'estimation_runs'?",
    ),
    "view": ({"view/0/input": ["x"]}, "short.toml: view[0].input: unknown key; did you mean 'inputs'?"),
    "method": ({"method/0/ordr": 3}, "short.toml: method[0].ordr: unknown key; did you mean 'order'?"),
    "settings": ({"method/0/settings/pasts": 3}, "method[0].settings: ssarx: no setting 'pasts'; did you mean 'past'?"),
    "score": ({"score/rank": ["x"]}, "short.toml: score.rank: unknown key; did you mean 'rank_by'?"),
    "bands": (
        {"score/bands_hz": {"attitud": [1.0, 2.0]}},
        "short.toml: score.bands_hz.attitud: unknown key; did you mean",
    ),
    # wrong types and values
    "seed": ({"seed": "x"}, "short.toml: seed: 'x'; give a whole number"),
    "seed true": ({"seed": True}, "short.toml: seed: True; give a whole number"),
    "seed below 0": ({"seed": -1}, "short.toml: seed: -1; give at least 0"),
    "seed of 70 bits": ({"seed": 2**70}, "seed: 1180591620717411303424; give a whole number"),
    "plant list": ({"plant": [1]}, "short.toml: plant: [1]; give a table"),
    "plant name": ({"plant/name": "quadrotr"}, "plant 'quadrotr' does not exist; did you mean 'quadrotor'?"),
    "parameter text": (
        {"plant/parameters": {"mass": "x"}},
        "short.toml: plant: quadrotor parameter 'mass': 'x' is not a number",
    ),
    "noise nan": ({"noise/thrust": float("nan")}, "short.toml: noise.thrust: nan; give a finite number"),
    "noise switch": ({"noise/enabled": 1}, "short.toml: noise.enabled: 1; give true or false"),
    "method number": ({"method/0": 3}, "short.toml: method[0]: 3; give a table"),
    "no method": ({"method": None}, "short.toml: method: missing; give at least one [[method]]"),
    "method name": (
        {"method/0/name": "ssarxx"},
        "short.toml: method[0].name: method 'ssarxx' does not exist; did you mean",
    ),
    "view of method": ({"method/0/view": "rates"}, "method[0].view: 'rates' is not defined; known: attitude"),
    "no order": ({"method/0/order": None}, "short.toml: method[0].order: give either order"),
    "order 0": ({"method/0/order": 0}, "short.toml: method[0].order: 0; give at least 1"),
    "order -1": ({"method/0/order": -1}, "short.toml: method[0].order: -1; give at least 1"),
    "order in list": ({"method/1/orders": [2, 0]}, "short.toml: method[1].orders[1]: 0; give at least 1"),
    "order of horizon": (
        {"method/0/order": 13},
        "method[0]: view 'attitude', 155 samples of 0.02 s: ssarx: order 13 is above the largest possible, 12",
    ),
    "huge order": ({"method/0/order": 2**62}, "the largest possible, 12"),
    "horizon of data": ({"method/0/settings/past": 18}, "the largest possible past + future is 22"),
    "huge horizon": ({"method/0/settings/past": 2**62}, "the largest possible past + future is 22"),
    "twice": (
        {"method/1": {"name": "ssarx", "order": 5, "settings": {"past": 6, "future": 5}}},
        "method[1]: ssarx of order 5 stands in view 'attitude' twice",
    ),
    "view twice": (
        {"view": [{"name": "rates"}, {"name": "rates"}]},
        "short.toml: view[1].name: 'rates' is given twice",
    ),
    "view without method": (
        {"view": [{"name": "attitude"}, {"name": "rates"}], "method/0/view": "attitude", "method/1/view": "attitude"},
        "short.toml: view[1]: no method for 'rates'",
    ),
    "view name": (
        {"view/0/name": "attitud"},
        "'attitud' is no view of plant quadrotor excited at 'attitude_setpoint'; did you mean 'attitude'?",
    ),
    "path as name": ({"name": "../short"}, "short.toml: name: '../short'; use at most 60 letters, digits, _ and -"),
    "path as view": ({"view/0/name": "../rates"}, "short.toml: view[0].name: '../rates'; use at most 60 letters"),
    "long name": ({"name": "x" * 61}, "use at most 60 letters"),
    "decimate 0": ({"view/0/decimate": 0}, "short.toml: view[0].decimate: 0; give a whole number of at least 1"),
    "decimate all": ({"view/0/decimate": 1000}, "decimate: 1000 leaves one sample of 3.1 s; give at most 388"),
    "discard all": ({"data/discard_s": 4.0}, "short.toml: data.discard_s: 4 s discards the whole record of 3.1 s"),
    "discard most": ({"data/discard_s": 3.0}, "method[0]: view 'attitude', 5 samples"),
    "horizons_s": ({"score/horizons_s": [0.1, 0.0]}, "short.toml: score.horizons_s[1]: 0.0; give positive seconds"),
    "horizons_s beyond": (
        {"score/horizons_s": [1e12]},
        "short.toml: score.horizons_s[0]: 1e+12 s is beyond the 3.1 s of data",
    ),
    "rank_by": (
        {"score/rank_by": ["pole_error"]},
        "short.toml: score.rank_by[0]: 'pole_error' is no metric; did you mean",
    ),
    "rank_by empty": ({"score/rank_by": []}, "short.toml: score.rank_by: is empty"),
    "band": (
        {"score/bands_hz": {"attitude": [5.0, 1.0]}},
        "short.toml: score.bands_hz.attitude: [5.0, 1.0]; give [low, high]",
    ),
    "band over Nyquist": (
        {"score/bands_hz": {"attitude": [1.0, 60.0]}},
        "score.bands_hz.attitude[1]: 60 Hz exceeds the Nyquist frequency 25 Hz of this view (decimation 5)",
    ),
    # excitation
    "kind": ({"excitation/kind": "prsb"}, "short.toml: excitation.kind: 'prsb'; did you mean 'prbs'?"),
    "signal order": ({"excitation/order": 1}, "short.toml: excitation: prbs: order: 1"),
    "signal length": ({"excitation/order": 30}, "short.toml: excitation: prbs: order: 30"),
    "signal dt": (
        {"excitation/dt": 0.006},
        "short.toml: excitation: quadrotor: signal dt 0.006 s is not a whole multiple",
    ),
    # roles of one's own
    "role": (OWN | {"view/0/inputs": ["roll_rf"]}, "short.toml: view[0]: roles: no recorded channel 'roll_rf'; did"),
    "half of the roles": (OWN | {"view/0/outputs": None}, "short.toml: view[0].outputs: missing"),
    "role twice": (OWN | {"view/0/outputs": ["roll_ref"]}, "short.toml: view[0].outputs: 'roll_ref' is an input too"),
    "no decimation": (OWN | {"view/0/decimate": None}, "short.toml: view[0].decimate: missing"),
    "no truth to rank by": (
        OWN | {"score/rank_by": ["frf_error_h2"]},
        "score.rank_by[0]: 'frf_error_h2' needs a truth",
    ),
    # expectations
    "bound": (
        {"expect": {"best.fit_clean.median": "== 3"}},
        "expect.\"best.fit_clean.median\": '== 3'; give a comparison",
    ),
    "bound number": ({"expect": {"best.fit_clean.median": 3}}, "give a comparison such as"),
    "bound text": ({"expect": {"best.fit_clean.median": "<= 1e"}}, "give a comparison such as"),
    "key": ({"expect": {"fit_clean": "<= 3"}}, 'short.toml: expect."fit_clean": give "method.metric.statistic"'),
    "metric": ({"expect": {"best.fit_cln.median": "<= 3"}}, "'fit_cln' is not known here; did you mean 'fit_clean'?"),
    "statistic": ({"expect": {"best.fit_clean.medan": "<= 3"}}, "'medan' is not known here; did you mean 'median'?"),
    "method of key": ({"expect": {"iem.fit_clean.median": "<= 3"}}, "'iem' is not known here; known: arx, best, ssarx"),
    "view of key": ({"expect": {"rates.best.fit_clean.median": "<= 3"}}, "'rates' is not known here; known: attitude"),
    # what the plant cannot be
    "too heavy": ({"plant/parameters": {"mass": 1.0}}, "short.toml: plant: quadrotor: mass 1 kg needs"),
    "no truth": (
        {"plant/parameters": {"rate_kp": 0.0}},
        "plant.parameters: {'rate_kp': 0.0} leave view 'attitude' without",
    ),
}


@pytest.fixture
def grounded(monkeypatch):
    """Let the plant play no more than one sample."""
    fly = Quadrotor.run

    def one_sample(self, signal, **options):
        assert len(signal.u) == 1, "flew before refusing"
        return fly(self, signal, **options)

    monkeypatch.setattr(Quadrotor, "run", one_sample)


@pytest.mark.parametrize(("changes", "message"), REFUSALS.values(), ids=REFUSALS)
def test_refused_before_flight(changes, message, tmp_path, monkeypatch, grounded):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, changes)
    code, out, err = excite("run", "short.toml", "-o", "out", "--jobs", "1")
    assert (code, out) == (2, "") and message in err and "Traceback" not in err, err
    assert err.count("short.toml") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["short.toml"]


DULL = {"excitation/order": 3, "excitation/periods": 40, "view/0/decimate": 25}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"excitation/amplitude": [2.0, 31.0, 5.0]},
            "channel 'pitch_ref' reaches -31 deg, outside the plant's limits -30 to 30",
        ),
        (DULL, "ssarx n=5 needs an input persistently exciting of order 5, the design has order 2"),
    ],
    ids=["beyond the limits", "not exciting enough"],
)
def test_designs_that_are_refused(changes, message, tmp_path, grounded):
    code, out, err = excite("run", write(tmp_path, changes), "-o", tmp_path / "out", "--jobs", "1")
    assert (code, out) == (3, "") and message in err
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_scenario(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('name = "x"\nseed = = 3\n')
    code, _, err = excite("run", path)
    assert code == 2 and f"{path}: not a valid TOML file" in err and "line 2" in err
    path.write_bytes(b"\xff\xfe\x00\x01")
    assert excite("run", path)[0] == 2
    assert "neither a file nor shipped" in excite("run", tmp_path)[2]
    path.write_text("data = 3\n")
    assert "name: missing" in excite("run", path, "--runs", "3")[2]


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenarios_are_sound(name):
    scenario = load_scenario(name)
    assert scenario.name == name and scenario.description and scenario.expect


def test_a_byte_order_mark_does_no_harm(tmp_path):
    path = tmp_path / "short.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SHORT.replace("\n", "\r\n").encode())
    assert load_scenario(str(path)).name == "short"


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_crash_names_the_parameters_and_leaves_what_was_finished(jobs, tmp_path):
    changes = {"plant/parameters": {"hover_altitude": 0.1001}}
    scenario = check_scenario(changed(changes), "short.toml")
    named = r"estimation run \d with plant.parameters .*hover_altitude.*altitude 0"
    with pytest.raises(SimulationStopped, match=named) as caught:
        run_scenario(scenario, tmp_path / "out", jobs)
    assert caught.value.exit_code == 2
    assert not list((tmp_path / "out").rglob(".*.tmp"))
