"""The player script of a Crazyflie on a link that records what it is told."""

import numpy as np
import pytest
from crazyflie_flights import HOVER, FakeLink, exported, flight
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.files import crazyflie_player as template
from excite.files.crazyflie import setpoints


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
