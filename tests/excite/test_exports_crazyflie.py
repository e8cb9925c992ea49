"""Crazyflie: the set-point table, and the player script flown on a fake link with cflib's own commander."""

import ast
import importlib.util
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.files import crazyflie_player as template
from excite.files import export, load_signal, read_table
from excite.files.crazyflie import setpoints
from excite.generators.prbs import prbs
from excite.persistency.certificate import certify
from excite.types.recipe import Recipe
from excite.types.signal import Signal

HOVER = 38000


def flight(seconds=1.0, dt=0.02, names=("roll [deg]", "thrust"), seed=0):
    count = round(seconds / dt)
    rng = np.random.default_rng(seed)
    u = {
        "roll": 10 * rng.standard_normal(count).clip(-2, 2),
        "pitch": np.full(count, 1 / 3),
        "thrust": np.full(count, 40000.3),
    }
    u |= {"yawrate": 30 * rng.standard_normal(count).clip(-2, 2), "thrust_offset": 2000 * rng.random(count) - 1000}
    return Signal(np.column_stack([u[name.split(" ")[0]] for name in names]), dt, list(names), recipe=Recipe("test"))


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


# ---- the player script


def exported(tmp_path, signal, name="play.py"):
    """Export the player and import the script as a module of its own."""
    export(signal, "crazyflie_player", tmp_path / name)
    spec = importlib.util.spec_from_file_location("exported_player", tmp_path / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class FakeLink:
    """Time that passes only when somebody sleeps, and a Crazyflie whose packets are recorded: (time, what, values)."""

    def __init__(self, events=(), protocol=12):
        from cflib.crazyflie.commander import Commander
        from cflib.crazyflie.supervisor import Supervisor

        self.now, self.calls, self.events = 100.0, [], sorted(events, key=lambda event: event[0])
        self.platform = SimpleNamespace(get_protocol_version=lambda: protocol)
        self.commander, self.supervisor = Commander(self), Supervisor(self)

    def add_port_callback(self, port, callback):
        pass

    def send_packet(self, packet, *rest, **named):
        data = bytes(packet.data)
        if packet.port == 3:
            what, values = "setpoint", struct.unpack("<fffH", data)
        elif packet.port == 7:
            what, values = ("stop" if packet.channel == 0 else "notify"), tuple(data)
        else:
            what, values = "arm" if data[1] else "disarm", tuple(data)
        self.calls.append((self.now - 100, what, values))

    def clock(self):
        return self.now

    def sleep(self, seconds):
        self.now += max(seconds, 1e-6)
        while self.events and self.now - 100 >= self.events[0][0]:
            self.events.pop(0)[1]()

    def setpoints(self):
        return np.array([(t, *values) for t, what, values in self.calls if what == "setpoint"])

    def names(self):
        return [what for _, what, _ in self.calls]


def fly(tmp_path, signal, events=(), hover=HOVER, **watch):
    player = exported(tmp_path, signal)
    watched = player.Watch(**watch)
    link = FakeLink([(t, lambda action=action: action(watched)) for t, action in events])
    reason = player.fly(link, player.PLAN, hover, watched, link.clock, link.sleep)
    return link, reason, player


def interrupt(watch):
    raise KeyboardInterrupt


def came_down(link, hover=HOVER):
    """Whether the flight ended level, ramped down, stopped, notified and disarmed."""
    rows = link.setpoints()
    assert link.names()[-3:] == ["stop", "notify", "disarm"] and tuple(rows[-1, 1:]) == (0, 0, 0, 0)
    down = rows[-1 - round(3 / 0.02) : -1]
    assert not down[:, 1:4].any() and (np.diff(down[:, 4]) <= 0).all() and down[-1, 4] == template.LEAST_THRUST
    level = rows[-1 - round(4 / 0.02) : -1 - round(3 / 0.02)]
    assert not level[:, 1:4].any() and (level[:, 4] == level[0, 4]).all()
    return True


def test_a_whole_flight(tmp_path):
    original = flight(names=["roll [deg]", "pitch [deg]", "thrust"])
    link, reason, player = fly(tmp_path, original)
    assert reason is None and came_down(link)
    rows = link.setpoints()
    armed = link.calls[link.names().index("arm")][0]
    assert not rows[rows[:, 0] < armed, 1:].any() and rows[0, 4] == 0  # a thrust of 0 first: it unlocks
    assert (np.diff(rows[:, 0]) <= 0.02 + 1e-6).all()
    start = np.flatnonzero(rows[:, 1])[0]
    up = rows[:start]
    assert up[-1, 4] == HOVER and (np.diff(up[:, 4]) >= 0).all()
    assert (up[up[:, 4] > 0, 4] >= template.LEAST_THRUST).all()
    played = rows[start : start + 50]
    np.testing.assert_allclose(played[:, 0] - played[0, 0], np.arange(50) * 0.02, atol=1e-5)
    expected = setpoints(original).u
    assert (played[:, 1] == expected[:, 0]).all() and (played[:, 2] == -expected[:, 1]).all()  # cflib flips pitch
    assert (played[:, 4] == 40000).all() and not played[:, 3].any()
    assert rows[start + 50, 1] == 0
    assert player.PLAN["rows"] == [[*row[:2], 0.0, int(row[2])] for row in expected.tolist()]


def test_thrust_offsets_are_about_the_hover_thrust(tmp_path):
    original = flight(names=["thrust_offset"])
    link, reason, _ = fly(tmp_path, original)
    assert reason is None
    thrust = link.setpoints()[:, 4]
    assert (HOVER + setpoints(original).u[:, 0].astype(int)).tolist() == thrust[200:250].tolist()


def lost(watch):
    watch.link_lost("radio://0", "Too many packets lost")


def sagging(watch):
    for volts in (3.0, 3.0, 3.0, 3.0, 3.5, 3.0, 3.0, 3.0, 3.0):
        watch.logged(0, {"pm.vbat": volts, "stabilizer.roll": 0, "stabilizer.pitch": 0}, None)


def empty(watch):
    for _ in range(5):
        watch.logged(0, {"pm.vbat": 3.0, "stabilizer.roll": 0, "stabilizer.pitch": 0}, None)


def tilted(watch):
    watch.logged(0, {"pm.vbat": 4.0, "stabilizer.roll": 3, "stabilizer.pitch": -51.0}, None)


@pytest.mark.parametrize("at", [0.2, 0.8, 1.7, 3.5, 4.5])
@pytest.mark.parametrize(
    ("event", "message"), [(interrupt, "interrupted"), (empty, "battery at 3.00 V"), (tilted, "tilt of 51 deg")]
)
def test_every_abort_returns_to_level_ramps_down_and_stops(tmp_path, event, message, at):
    link, reason, _ = fly(tmp_path, flight(), [(at, event)])
    assert reason == message
    rows = link.setpoints()
    if at > 1:
        assert came_down(link)
        assert rows[-1, 0] - at == pytest.approx(4.0, abs=0.05)
    else:  # the motors never ran
        assert not rows[:, 1:].any() and link.names()[-3:] == ["stop", "notify", "disarm"]
    after = rows[rows[:, 0] > at + 0.02]
    assert not after[:, 1:4].any() and (np.diff(after[:, 4]) <= 0).all()


def test_a_sag_is_no_empty_battery_and_limits_can_be_set(tmp_path):
    assert fly(tmp_path, flight(), [(4.5, sagging)])[1] is None
    assert fly(tmp_path, flight(), [(4.5, tilted)], most_tilt_deg=60)[1] is None


def test_a_lost_link_ends_it_at_once(tmp_path):
    link, reason, _ = fly(tmp_path, flight(), [(4.5, lost)])
    assert reason == "link lost: Too many packets lost"
    assert link.now - 100 < 4.7  # the firmware levels after 0.5 s and shuts down after 2 s
    assert link.names()[-3:] == ["stop", "notify", "disarm"]


def test_a_second_interrupt_cuts_the_motors(tmp_path):
    link, reason, _ = fly(tmp_path, flight(), [(4.5, interrupt), (5.0, interrupt)])
    assert reason == "interrupted" and link.names()[-3:] == ["stop", "notify", "disarm"]
    assert link.setpoints()[-1, 0] == pytest.approx(5.0, abs=0.03)


def test_a_link_lost_on_the_way_down_ends_it(tmp_path):
    link, reason, _ = fly(tmp_path, flight(), [(4.5, interrupt), (5.0, lost)])
    assert reason == "interrupted" and link.now - 100 < 5.3


def test_a_computer_that_falls_behind_aborts_and_a_hiccup_keeps_the_time(tmp_path):
    player = exported(tmp_path, flight())
    for pause, expected in ((0.3, "this computer fell 0.3"), (0.1, "5 of 50 set-points were skipped")):
        link = FakeLink()
        link.events = [(4.5, lambda link=link, pause=pause: setattr(link, "now", link.now + pause))]
        reason = player.fly(link, player.PLAN, HOVER, player.Watch(), link.clock, link.sleep)
        assert reason.startswith(expected) and came_down(link)
    rows = link.setpoints()
    index = np.searchsorted(rows[:, 0], 4.0 - 1e-6)
    assert rows[index + 44, 0] == pytest.approx(4.98, abs=1e-4)  # the last row comes at its own time


def test_an_error_while_flying_still_brings_it_down(tmp_path):
    def fail(watch):
        raise RuntimeError("radio driver")

    with pytest.raises(RuntimeError, match="radio driver"):
        fly(tmp_path, flight(), [(4.5, fail)])
    player = exported(tmp_path, flight())
    link = FakeLink([(4.5, lambda: fail(None))])
    with pytest.raises(RuntimeError):
        player.fly(link, player.PLAN, HOVER, player.Watch(), link.clock, link.sleep)
    assert came_down(link)


@pytest.mark.parametrize(
    ("plan", "hover", "message"),
    [
        ({"rows": [[31.0, 0.0, 0.0, 40000]]}, HOVER, "row 0: roll 31.0 is beyond 30"),
        ({"rows": [[0.0, float("nan"), 0.0, 40000]]}, HOVER, "row 0: pitch nan is beyond 30"),
        ({"rows": [[0.0, 0.0, -201.0, 40000]]}, HOVER, "yawrate -201.0 is beyond 200"),
        ({"rows": [[0.0, 0.0, 0.0, 10000]]}, HOVER, "thrust 10000 is outside 10001 to 60000"),
        ({"rows": [[0.0, 0.0, 0.0, 30000]], "thrust": "offset"}, HOVER, "thrust 68000 is outside"),
        ({"rows": []}, HOVER, "0.0 s"),
        ({"rows": [[0.0, 0.0, 0.0, 40000]] * 9001}, HOVER, "180.0 s; at most 180"),
        ({"dt_s": 0.5}, HOVER, "dt of 0.5 s"),
        ({"dt_s": 0.001}, HOVER, "dt of 0.001 s"),
        ({}, 10000, "--hover-thrust 10000: give 10001 to 60000"),
        ({}, 60001, "--hover-thrust 60001"),
    ],
)
def test_an_edited_plan_beyond_the_caps_never_flies(plan, hover, message):
    plan = {"dt_s": 0.02, "thrust": "absolute", "rows": [[0.0, 0.0, 0.0, 40000]]} | plan
    link = FakeLink()
    with pytest.raises(template.Abort, match=message):
        template.fly(link, plan, hover, template.Watch(), link.clock, link.sleep)
    assert link.calls == []


@given(rows=st.lists(st.tuples(*[st.floats(-400, 400)] * 3, st.integers(-5, 70000)), max_size=5))
@settings(max_examples=200, deadline=None)
def test_no_setpoint_beyond_the_caps_is_ever_sent(rows):
    link = FakeLink()
    player = template.Player(link.commander, template.Watch(), 0.02, link.clock, link.sleep)
    try:
        player.play(rows)
    except template.Abort as reason:
        assert "beyond the caps" in str(reason)
    for roll, pitch, yawrate, thrust in link.setpoints()[:, 1:] if link.calls else []:
        assert (
            abs(roll) <= 30 and abs(pitch) <= 30 and abs(yawrate) <= 200 and (thrust == 0 or 10001 <= thrust <= 60000)
        )


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
