#!/usr/bin/env python3
"""Play an excitation signal on a Crazyflie: check, arm, take off, play, return to level, ramp down, stop.

Needs only Python and cflib (pip install cflib). Look at the plan first, then fly:

    python THIS_FILE --hover-thrust 38000 --dry-run
    python THIS_FILE --hover-thrust 38000 --uri radio://0/80/2M/E7E7E7E7E7

The set-points are roll and pitch (deg), yaw rate (deg/s) and thrust (10001 to 60000), open loop in height: fly in a net,
with goggles, and with the hover thrust that this craft needs on this battery. Ctrl-C returns to level and ramps down; a
second Ctrl-C cuts the motors. So do a lost link, a low battery, a large tilt and a computer that falls behind. When
set-points stop, the firmware levels after 500 ms and shuts down after 2 s.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

# --- plan (replaced on export)
PLAN = {"name": "example", "sha256": "", "dt_s": 0.02, "thrust": "offset", "rows": [[0.0, 0.0, 0.0, 0]] * 50}
# --- end of plan

MOST = {"roll": 30.0, "pitch": 30.0, "yawrate": 200.0}  # deg, deg, deg/s
LEAST_THRUST, MOST_THRUST = 10001, 60000
MOST_SECONDS = 180.0
LEAST_DT_S, MOST_DT_S = 0.01, 0.02  # 50 to 100 set-points a second
MOST_SILENCE_S = 0.25  # half of what the firmware's watchdog allows
UNLOCK_S, RAMP_UP_S, SETTLE_S, LEVEL_S, RAMP_DOWN_S = 1.0, 2.0, 1.0, 1.0, 3.0
LOW_BATTERY_READINGS = 5  # the voltage sags for a moment under load

Clock = Callable[[], float]
Sleep = Callable[[float], None]


class Abort(Exception):
    """The flight must end; the message says why."""


class Watch:
    """What ends a flight from outside: the lost link, a low battery, a large tilt."""

    def __init__(self, least_volts: float = 3.1, most_tilt_deg: float = 50.0) -> None:
        self.least_volts, self.most_tilt_deg = least_volts, most_tilt_deg
        self.reason: str | None = None
        self.linked, self.low_readings = True, 0

    def link_lost(self, uri: str, message: str = "") -> None:
        """Note that the link is gone (callback of Crazyflie.connection_lost)."""
        self.linked = False
        self.reason = self.reason or f"link lost: {message or uri}"

    def logged(self, timestamp: int, data: dict, config: Any) -> None:
        """Check one log packet (callback of LogConfig.data_received_cb)."""
        self.low_readings = self.low_readings + 1 if data["pm.vbat"] < self.least_volts else 0
        if self.low_readings >= LOW_BATTERY_READINGS:
            self.reason = self.reason or f"battery at {data['pm.vbat']:.2f} V"
        tilt = max(abs(data["stabilizer.roll"]), abs(data["stabilizer.pitch"]))
        if tilt > self.most_tilt_deg:
            self.reason = self.reason or f"tilt of {tilt:.0f} deg"


class Player:
    """Sends set-points on time and never one beyond the caps."""

    def __init__(self, commander: Any, watch: Watch, dt_s: float, clock: Clock, sleep: Sleep) -> None:
        self.commander, self.watch, self.dt_s, self.clock, self.sleep = commander, watch, dt_s, clock, sleep
        self.thrust, self.skipped = 0, 0

    def play(self, rows: Sequence, heed: bool = True) -> None:
        """Send rows at dt_s from now; rows whose time has passed are skipped. Raise Abort when the watch says so.

        Without `heed` only a lost link ends it: for the way down.
        """
        start = sent = self.clock()
        last = -1
        while True:
            if not self.watch.linked or (heed and self.watch.reason):
                raise Abort(self.watch.reason)
            now = self.clock()
            if heed and now - sent > MOST_SILENCE_S:
                raise Abort(f"this computer fell {now - sent:.2f} s behind")
            index = int((now - start) / self.dt_s + 1e-6)
            if index >= len(rows):
                self.skipped += len(rows) - 1 - last
                return
            if index > last:
                self.skipped += index - last - 1
                self.send(*rows[index])
                last, sent = index, now
            self.sleep(max(0.0, start + (last + 1) * self.dt_s - self.clock()))

    def send(self, roll: float, pitch: float, yawrate: float, thrust: int) -> None:
        """Send one set-point, or raise Abort when it is beyond the caps."""
        beyond = [k for (k, most), v in zip(MOST.items(), (roll, pitch, yawrate), strict=True) if not abs(v) <= most]
        if beyond or not (thrust == 0 or LEAST_THRUST <= thrust <= MOST_THRUST):
            raise Abort(f"set-point {(roll, pitch, yawrate, thrust)} is beyond the caps")
        self.commander.send_setpoint(roll, pitch, yawrate, int(thrust))
        self.thrust = int(thrust)

    def level(self, seconds: float, first: int, last: int) -> list[tuple]:
        """Return level rows whose thrust goes from first to last."""
        count = max(1, round(seconds / self.dt_s))
        return [(0.0, 0.0, 0.0, round(first + (last - first) * (k + 1) / count)) for k in range(count)]

    def land(self) -> None:
        """Return to level, ramp down, stop the motors; a KeyboardInterrupt stops them at once."""
        try:
            if self.thrust >= LEAST_THRUST:
                self.play(self.level(LEVEL_S, self.thrust, self.thrust), heed=False)
                self.play(self.level(RAMP_DOWN_S, self.thrust, LEAST_THRUST), heed=False)
        except (Abort, KeyboardInterrupt):
            pass
        finally:
            self.commander.send_setpoint(0.0, 0.0, 0.0, 0)
            self.commander.send_stop_setpoint()
            self.commander.send_notify_setpoint_stop()


def fly(
    cf: Any, plan: dict, hover_thrust: int, watch: Watch, clock: Clock = time.monotonic, sleep: Sleep = time.sleep
) -> str | None:
    """Unlock, arm, take off, play, come down; return None, or why the flight was cut short."""
    rows = flight_rows(plan, hover_thrust)
    player = Player(cf.commander, watch, plan["dt_s"], clock, sleep)
    try:
        player.play(player.level(UNLOCK_S / 2, 0, 0))  # a thrust of 0 unlocks the commander
        cf.supervisor.send_arming_request(True)
        player.play(player.level(UNLOCK_S / 2, 0, 0))
        player.play(player.level(RAMP_UP_S, LEAST_THRUST, hover_thrust))
        player.play(player.level(SETTLE_S, hover_thrust, hover_thrust))
        player.skipped = 0
        player.play(rows)
        return f"{player.skipped} of {len(rows)} set-points were skipped" if player.skipped else None
    except KeyboardInterrupt:
        return "interrupted"
    except Abort as reason:
        return str(reason)
    finally:
        player.land()
        cf.supervisor.send_arming_request(False)
        sleep(0.1)  # lets the last packets leave before the link is closed


def flight_rows(plan: dict, hover_thrust: int) -> list[tuple]:
    """Return the rows with absolute thrust; raise Abort when anything is beyond the caps."""
    rows, dt = plan["rows"], plan["dt_s"]
    if not LEAST_THRUST <= hover_thrust <= MOST_THRUST:
        raise Abort(f"--hover-thrust {hover_thrust}: give {LEAST_THRUST} to {MOST_THRUST}")
    if not (LEAST_DT_S - 1e-9 <= dt <= MOST_DT_S + 1e-9):
        raise Abort(f"dt of {dt} s; it must be {LEAST_DT_S} to {MOST_DT_S} s")
    if not 0 < len(rows) * dt <= MOST_SECONDS:
        raise Abort(f"{len(rows) * dt:.1f} s; at most {MOST_SECONDS} s are flown")
    offset = hover_thrust if plan["thrust"] == "offset" else 0
    rows = [(roll, pitch, yawrate, thrust + offset) for roll, pitch, yawrate, thrust in rows]
    for k, row in enumerate(rows):
        for (name, most), value in zip(MOST.items(), row[:3], strict=True):
            if not (math.isfinite(value) and abs(value) <= most):
                raise Abort(f"row {k}: {name} {value} is beyond {most}")
        if not LEAST_THRUST <= row[3] <= MOST_THRUST:
            raise Abort(f"row {k}: thrust {row[3]} is outside {LEAST_THRUST} to {MOST_THRUST}")
    return rows


def described(plan: dict, rows: list[tuple], hover_thrust: int) -> str:
    """Return what will be flown, in words."""
    peaks = [max(abs(row[k]) for row in rows) for k in range(3)]
    thrusts = [row[3] for row in rows]
    total = UNLOCK_S + RAMP_UP_S + SETTLE_S + len(rows) * plan["dt_s"] + LEVEL_S + RAMP_DOWN_S
    return "\n".join(
        [
            f"{plan['name']}: {len(rows)} set-points at {1 / plan['dt_s']:.4g} Hz, {len(rows) * plan['dt_s']:.2f} s",
            f"peaks: roll {peaks[0]:.4g} deg, pitch {peaks[1]:.4g} deg, yaw rate {peaks[2]:.4g} deg/s",
            f"thrust: {min(thrusts)} to {max(thrusts)}, hover {hover_thrust}",
            f"unlock {UNLOCK_S:g} s, ramp up {RAMP_UP_S:g} s, settle {SETTLE_S:g} s, play, level {LEVEL_S:g} s, "
            f"ramp down {RAMP_DOWN_S:g} s: {total:.1f} s in all",
        ]
    )


def watched(cf: Any, watch: Watch) -> None:
    """Start the log that feeds the watch."""
    from cflib.crazyflie.log import LogConfig

    config = LogConfig(name="watch", period_in_ms=100)
    for variable in ("pm.vbat", "stabilizer.roll", "stabilizer.pitch"):
        config.add_variable(variable, "float")
    cf.log.add_config(config)
    config.data_received_cb.add_callback(watch.logged)
    config.start()


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; return 0 flown, 1 cut short, 2 refused."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hover-thrust", type=int, required=True, help="thrust at which this craft hovers now")
    parser.add_argument("--uri", default="radio://0/80/2M/E7E7E7E7E7")
    parser.add_argument("--arm", action="store_true", help="fly without asking for the typed confirmation")
    parser.add_argument("--dry-run", action="store_true", help="check and print the plan, send nothing")
    parser.add_argument("--least-volts", type=float, default=3.1, help="come down below this battery voltage")
    parser.add_argument("--most-tilt-deg", type=float, default=50.0, help="come down beyond this tilt")
    given = parser.parse_args(arguments)
    try:
        rows = flight_rows(PLAN, given.hover_thrust)
    except Abort as reason:
        print(f"refused: {reason}", file=sys.stderr)
        return 2
    print(described(PLAN, rows, given.hover_thrust))
    if given.dry_run:
        return 0
    if not given.arm and (not sys.stdin.isatty() or input("Type FLY to arm the motors: ").strip() != "FLY"):
        print("not armed: type FLY when asked, or give --arm", file=sys.stderr)
        return 2

    import cflib.crtp
    from cflib.crazyflie import Crazyflie
    from cflib.crazyflie.syncCrazyflie import SyncCrazyflie

    watch = Watch(given.least_volts, given.most_tilt_deg)
    cflib.crtp.init_drivers()
    cf = Crazyflie()
    cf.connection_lost.add_callback(watch.link_lost)
    with SyncCrazyflie(given.uri, cf=cf):
        watched(cf, watch)
        cut_short = fly(cf, PLAN, given.hover_thrust, watch)
    print(f"cut short: {cut_short}" if cut_short else "flown", file=sys.stderr if cut_short else sys.stdout)
    return 1 if cut_short else 0


if __name__ == "__main__":
    sys.exit(main())
