"""Crazyflie: the set-point table, and the player script flown on a fake link with cflib's own commander."""

import ast
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from crazyflie_flights import HOVER, FakeLink, exported, flight

from excite.errors import ExciteError
from excite.files import export, load_signal, read_table
from excite.files.crazyflie import setpoints
from excite.generators.prbs import prbs
from excite.persistency.certificate import certify
from excite.types.signal import Signal

# ---- the set-point table


def test_table_is_what_is_sent(tmp_path):
    original = flight(names=["thrust", "yawrate [deg/s]", "roll [deg]"])
    path = tmp_path / "s.csv"
    export(original, "crazyflie", path)
    assert path.read_text().splitlines()[0] == "time_s,u:roll [deg],c:pitch [deg],u:yawrate [deg/s],u:thrust"
    again = load_signal(path)
    assert [c.name for c in again.channels] == ["roll", "yawrate", "thrust"]
    assert (again.u[:, 2] == 40000).all()
    assert (again.u[:, :2] == original.u[:, [2, 1]].astype(np.float32)).all()
    np.testing.assert_allclose(again.u[:, :2], original.u[:, [2, 1]], rtol=2**-24)
    certificate = read_table(path).meta["certificate"]
    assert certificate["rms"] == list(certify(setpoints(original)).rms)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert rows.shape == (50, 5) and not rows[:, 2].any()


def test_table_without_thrust_names_the_remedy(tmp_path):
    for names in (["roll"], ["roll", "thrust_offset"]):
        with pytest.raises(ExciteError, match=r"absolute thrust; add a channel thrust .* or export crazyflie_player"):
            export(flight(names=names), "crazyflie", tmp_path / "s.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("dt", "hold", "sent"),
    [
        (0.01, 1, 0.01),
        (0.02, 1, 0.02),
        (0.015, 1, 0.015),
        (0.1, 1, 0.02),
        (0.05, 1, 0.05 / 3),
        (0.0205, 1, 0.01025),
        (0.002, 10, 0.02),
        (0.001, 15, 0.015),
        (0.005, 2, 0.01),
        (0.005, 20, 0.02),
        (1 / 300, 4, 4 / 300),
    ],
)
def test_held_signals_are_sent_at_50_to_100_hz_exactly(dt, hold, sent):
    original = prbs(order=5, dt=dt, hold=hold, amplitude=5, channels=["roll [deg]"], periods=4)
    played = setpoints(original)
    assert played.dt == pytest.approx(sent) and 0.01 - 1e-12 <= played.dt <= 0.02 + 1e-12
    at = np.arange(0.5, len(played.u)) * played.dt
    assert (played.u == original.u[(at / dt).astype(int)]).all()
    assert played.duration_s == pytest.approx(original.duration_s)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"dt": 0.004}, r"dt = 0.004 s is finer than the 0.01 s of the radio.*design the signal with a dt of"),
        ({"u": [[40.0]] * 9}, r"channel roll: 40 to 40, but the Crazyflie's cap is -30 to 30"),
        (
            {"channels": ["yaw rate [deg/s]"], "u": [[-201.0]] * 9},
            "channel yawrate: -201 to -201, .* cap is -200 to 200",
        ),
        ({"channels": ["thrust"], "u": [[10000.0]] * 9}, "channel thrust: 10000 to 10000, .* cap is 10001 to 60000"),
        ({"channels": ["thrust"], "u": [[60001.0]] * 9}, "channel thrust: 60001 to 60001"),
        ({"channels": ["flap [deg]"]}, r"channel 'flap \[deg\]' is no set-point of a Crazyflie; it takes roll \[deg\]"),
        ({"channels": ["roll [rad]"]}, r"channel 'roll \[rad\]' is no set-point"),
        ({"channels": ["roll", "Roll [deg]"], "u": [[1.0, 2.0]] * 9}, "name an axis twice"),
        ({"channels": ["thrust", "thrust_offset"], "u": [[20000.0, 2.0]] * 9}, "name an axis twice"),
        ({"u": [[1.0]] * 9001}, "180.02 s, but a flight plays at most 180 s"),
    ],
)
@pytest.mark.parametrize("fmt", ["crazyflie", "crazyflie_player"])
def test_what_a_crazyflie_does_not_take_is_refused(tmp_path, fmt, changed, message):
    parts = {"u": [[1.0], [2.0], [1.0]], "dt": 0.02, "channels": ["roll [deg]"]} | changed
    with pytest.raises(ExciteError, match=message):
        export(Signal(**parts), fmt, tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


# ---- the script as a user runs it


def run(path, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-I", path, *arguments],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=60,
        **options,
    )


def test_dry_run_prints_the_plan_and_sends_nothing(tmp_path):
    export(flight(), "crazyflie_player", tmp_path / "play.py")
    result = run(tmp_path / "play.py", "--hover-thrust", "38000", "--dry-run")
    assert result.returncode == 0 and "play: 50 set-points at 50 Hz, 1.00 s" in result.stdout
    assert "thrust: 40000 to 40000, hover 38000" in result.stdout and "9.0 s in all" in result.stdout


def test_it_never_arms_unasked(tmp_path):
    export(flight(), "crazyflie_player", tmp_path / "play.py")
    result = run(tmp_path / "play.py", "--hover-thrust", "38000")
    assert result.returncode == 2 and "not armed: type FLY when asked, or give --arm" in result.stderr
    assert run(tmp_path / "play.py").returncode == 2
    result = run(tmp_path / "play.py", "--hover-thrust", "61000", "--arm")
    assert result.returncode == 2 and "refused: --hover-thrust 61000" in result.stderr


def test_it_needs_cflib_and_the_standard_library_only(tmp_path):
    export(flight(), "crazyflie_player", tmp_path / "play.py")
    tree = ast.parse((tmp_path / "play.py").read_text())
    imports = {n.name for node in ast.walk(tree) if isinstance(node, ast.Import) for n in node.names}
    imports |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imports} - {*sys.stdlib_module_names} == {"cflib"}


def test_nothing_in_a_name_gets_into_the_script(tmp_path):
    name = "x\"]}; import os; os.system('id') # \\ {0} %s.py"
    player = exported(tmp_path, flight(), name)
    assert player.PLAN["name"] == name.removesuffix(".py")
    tree = ast.parse((tmp_path / name).read_text())
    assert not any(isinstance(node, ast.Import) and node.names[0].name == "os" for node in ast.walk(tree))


def test_main_flies_through_cflib(tmp_path, monkeypatch):
    """Arming, log and link go through cflib's real classes; only the radio is missing."""
    import cflib.crazyflie
    import cflib.crazyflie.syncCrazyflie
    import cflib.crtp
    from cflib.crazyflie.log import LogConfig
    from cflib.utils.callbacks import Caller

    player = exported(tmp_path, flight())
    link, configs = FakeLink(), []
    link.connection_lost, link.log = Caller(), SimpleNamespace(add_config=configs.append)
    monkeypatch.setattr(cflib.crtp, "init_drivers", lambda: None)
    monkeypatch.setattr(cflib.crazyflie, "Crazyflie", lambda: link)

    class Opened(cflib.crazyflie.syncCrazyflie.SyncCrazyflie):
        def open_link(self):
            assert self.cf is link and self._link_uri == "radio://0/80/2M/E7E7E7E7E7"

        def close_link(self):
            link.calls.append((link.now, "closed", ()))

    monkeypatch.setattr(cflib.crazyflie.syncCrazyflie, "SyncCrazyflie", Opened)
    monkeypatch.setattr(LogConfig, "start", lambda self: None)
    real_fly = player.fly
    monkeypatch.setattr(player, "fly", lambda *arguments: real_fly(*arguments, link.clock, link.sleep))
    assert player.main(["--hover-thrust", "38000", "--arm"]) == 0
    assert link.names().count("arm") == 1 and link.names()[-1] == "closed"
    assert [v.name for v in configs[0].variables] == ["pm.vbat", "stabilizer.roll", "stabilizer.pitch"]

    link.events = [(link.now - 100 + 4.5, lambda: link.connection_lost.call("radio://0", "gone"))]
    assert player.main(["--hover-thrust", "38000", "--arm"]) == 1
    tumbling = {"pm.vbat": 4.0, "stabilizer.roll": 80.0, "stabilizer.pitch": 0.0}
    link.events = [(link.now - 100 + 4.5, lambda: configs[-1].data_received_cb.call(0, tumbling, None))]
    assert player.main(["--hover-thrust", "38000", "--arm"]) == 1

    monkeypatch.setattr(player.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    before = len(link.calls)
    for typed in ("", "fly", "yes"):
        monkeypatch.setattr("builtins.input", lambda prompt, typed=typed: typed)
        assert player.main(["--hover-thrust", "38000"]) == 2 and len(link.calls) == before
    monkeypatch.setattr("builtins.input", lambda prompt: "FLY")
    assert player.main(["--hover-thrust", "38000"]) == 0


def test_old_firmware_is_armed_too(tmp_path):
    player = exported(tmp_path, flight())
    link = FakeLink(protocol=8)
    with pytest.warns(UserWarning, match="legacy"):
        assert player.fly(link, player.PLAN, HOVER, player.Watch(), link.clock, link.sleep) is None
    assert "arm" in link.names() and link.names()[-1] == "disarm"
