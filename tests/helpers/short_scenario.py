"""A short scenario, and runs of it."""

import io
import json
import tomllib
from contextlib import redirect_stderr, redirect_stdout

import tomli_w

from scenarios.cli.main import status
from scenarios.run.run import run_scenario
from scenarios.scenario.reading import check_scenario

SHORT = """
name = "short"
seed = 3

[plant]
name = "quadrotor"

[excitation]
kind = "prbs"
order = 5
dt = 0.004
hold = 25
amplitude = [2.0, 2.0, 5.0]

[data]
estimation_runs = 2

[[view]]
name = "attitude"

[[method]]
name = "ssarx"
order = 5
settings = {past = 6, future = 5}

[[method]]
name = "arx"
orders = [2, 3]

[score]
horizons_s = [0.1]
"""


PIECES = ("recordings", "models")


def excite(*argv):
    """Run the command line in this process: (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def changed(changes):
    """The short scenario with the values at dotted paths replaced, or removed where None is given."""
    source = tomllib.loads(SHORT)
    for path, value in changes.items():
        *parents, key = path.split("/")
        table = source
        for parent in parents:
            table = table[int(parent)] if isinstance(table, list) else table.setdefault(parent, {})
        if isinstance(table, list):
            table[int(key) : int(key) + 1] = [] if value is None else [value]
        elif value is None:
            table.pop(key, None)
        else:
            table[key] = value
    return source


def write(folder, changes=()):
    path = folder / "short.toml"
    path.write_text(tomli_w.dumps(changed(dict(changes))), encoding="utf-8")
    return path


def run(folder, changes=(), runs=None, jobs=1):
    """Run the short scenario without its report; return what scores.json holds but for the folder's name."""
    scenario = check_scenario(changed({"data/estimation_runs": runs or 2, **dict(changes)}), "short.toml")
    run_scenario(scenario, folder, jobs)
    return scores(folder)


def scores(folder):
    result = json.loads((folder / "scores.json").read_text(encoding="utf-8"))
    del result["folder"]
    return result


def pieces(folder):
    """Every finished piece with the time it was written."""
    files = [p for room in PIECES for p in (folder / room).rglob("*") if p.is_file() and p.name[0] != "."]
    return {p.relative_to(folder): p.stat().st_mtime_ns for p in [*files, folder / "excitation.csv"]}


# Refused before anything flies ------------------------------------------------------------------------------------------

OWN = {
    "view/0/name": "mine",
    "view/0/inputs": ["roll_ref"],
    "view/0/outputs": ["roll"],
    "view/0/decimate": 5,
    "score/rank_by": ["fit_one_step"],
}
