"""Flights for a Crazyflie, and their players."""

import importlib.util
import struct
from types import SimpleNamespace

import numpy as np

from excite.files import export
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
