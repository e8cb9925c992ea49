"""A package of methods that break, wait, or write down that they were asked; and the data and scenario to try them on."""

import io
import tomllib
from contextlib import redirect_stderr, redirect_stdout

import numpy as np
import tomli_w
from installed import install

from identify.registry import METHODS
from scenarios.cli.main import status

MODULE = '''
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from identify.prediction_error.arx import Arx

print("at import")


class Odd(Exception):
    def __str__(self):
        raise RuntimeError("no message")


ERRORS = {
    "LinAlgError": np.linalg.LinAlgError("SVD did not\\nconverge"),
    "MemoryError": MemoryError(),
    "ValueError": ValueError("no such value"),
    "SystemExit": SystemExit(3),
    "KeyboardInterrupt": KeyboardInterrupt(),
    "Odd": Odd(),
}


@dataclass(frozen=True)
class Breaking(Arx):
    """Raises what it is told."""

    name = "breaking"
    summary = "raises"
    error: str = field(default="ValueError", metadata={"meaning": "what is raised"})

    def realize(self, compressed, order, data):
        print("not for stdout")
        raise ERRORS[self.error]


@dataclass(frozen=True)
class Logged(Arx):
    """Writes a line for every fit; waits, where it is told."""

    name = "logged"
    summary = "an arx that says when it is asked"

    def realize(self, compressed, order, data):
        with open(os.environ["EXCITE_TEST_LOG"], "a", encoding="utf-8") as stream:
            stream.write(f"{order} {self.delay}\\n")
        time.sleep(float(os.environ.get("EXCITE_TEST_WAIT", "0")))
        return super().realize(compressed, order, data)


@dataclass(frozen=True)
class Nothing(Arx):
    """Returns no estimate."""

    name = "nothing"
    summary = "returns nothing"

    def realize(self, compressed, order, data):
        return None
'''
METHOD_NAMES = {"breaking": "breakers:Breaking", "logged": "breakers:Logged", "nothing": "breakers:Nothing"}
SCENARIO = """
name = "short"
seed = 3
plant = {name = "two_mass_spring"}
excitation = {kind = "prbs", order = 6, dt = 0.1, hold = 5, amplitude = 1.0, periods = 3}
data = {estimation_runs = 2}
view = [{name = "plant", decimate = 5}]
method = [{name = "arx", order = 4}, {name = "ssarx", order = 4, settings = {past = 8, future = 6}}]
"""


def breakers(folder, monkeypatch=None, name="excite-breakers", entries=None, **more):
    """Install the package of breaking methods in a folder of its own, on the path of this process where asked."""
    install(folder / "site", name, {"breakers.py": MODULE}, {"excite.methods": entries or METHOD_NAMES, **more})
    if monkeypatch is not None:
        put_on_path(folder / "site", monkeypatch)
    return folder / "site"


def put_on_path(folder, monkeypatch, *registries):
    """Put a folder on the path, and have the registries look for their entry points again; undone after the test."""
    monkeypatch.syspath_prepend(folder)
    for registry in registries or (METHODS,):
        monkeypatch.setitem(registry.__dict__, "_plugins", None)
        del registry.__dict__["_plugins"]


def excite(*argv):
    """Run the command line in this process: (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def record(folder, samples=400):
    """Write a record of a system of order 2 with noise, and return what `compare` must be told to read it."""
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal(samples), np.zeros(samples)
    for k in range(2, samples):
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + u[k - 1] + 0.5 * u[k - 2] + 0.1 * rng.standard_normal()
    np.savetxt(folder / "record.csv", np.column_stack([u, y]), delimiter=",", header="u,y", comments="")
    return (folder / "record.csv", "--inputs", "0", "--outputs", "1", "--dt", "0.1")


def source(**changes):
    """Return the short scenario as a dictionary, with some of its keys replaced."""
    return tomllib.loads(SCENARIO) | changes


def scenario(folder, **changes):
    """Write the short scenario with some of its keys replaced."""
    path = folder / "short.toml"
    path.write_text(tomli_w.dumps(source(**changes)), encoding="utf-8")
    return path
