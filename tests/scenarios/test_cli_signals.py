"""Signals on the command line: limits, verdicts, proposals, parts, exports and figures, with their exit codes."""

import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from excite.files import load_signal, save_experiment
from excite.limits.limits import Limits, check
from excite.types.experiment import Experiment
from scenarios.cli.main import status

LIMITS = "amplitude = 4.0\nrate = 100.0\nbits = 12\nrange = [-5.0, 5.0]\n"
PARTS = """
channels = ["flap [deg]", "tab [deg]"]
[[excitation]]
kind = "multistep"
form = "doublet"
dt = 0.01
unit_s = 0.2
rest_s = 0.5
[[excitation]]
kind = "sweep"
dt = 0.01
start_hz = 0.5
stop_hz = 5.0
duration_s = 4.0
"""


def excite(*argv):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture
def loud(tmp_path):
    """A multisine beyond the limits, and the limits."""
    (tmp_path / "limits.toml").write_text(LIMITS)
    argv = ["--dt", ".01", "--period-s", "2", "--band-hz", "0.5,10", "--amplitude", "6", "--phases", "schroeder"]
    assert excite("design", "multisine", *argv, "-o", tmp_path / "loud.csv")[0] == 0
    return tmp_path


def test_check_tells_which_limits_are_exceeded(loud):
    code, out, _ = excite("check", loud / "loud.csv", "--limits", loud / "limits.toml", "--json")
    report = json.loads(out)["limits"]
    exceeded = {c["limit"] for c in report["checks"] if not c["ok"]}
    assert code == 3 and not report["ok"] and {"low", "high", "rate", "quantisation"} <= exceeded


def test_export_shapes_to_the_limits_and_certifies_what_is_played(loud):
    code, out, _ = excite(
        "export", loud / "loud.csv", "--to", "csv", "-o", loud / "u.csv", "--limits", loud / "limits.toml", "--json"
    )
    result, played = json.loads(out), load_signal(loud / "u.csv")
    limits = Limits(amplitude=4.0, rate=100.0, bits=12, range=(-5.0, 5.0))
    assert code == 0 and check(played, limits).ok and result["shaping"]["method"] == "quadratic program"
    assert result["certificate"]["peak"] == [np.abs(played.u).max()]
    assert excite("check", loud / "u.csv", "--limits", loud / "limits.toml")[0] == 0


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    amplitude=st.floats(0.5, 5.0), rate=st.floats(20.0, 200.0), fmt=st.sampled_from(["csv", "npz", "wav", "c_header"])
)
def test_limits_are_never_exceeded_after_export(loud, amplitude, rate, fmt):
    extension = {"csv": ".csv", "npz": ".npz", "wav": ".wav", "c_header": ".h"}[fmt]
    (loud / "free.toml").write_text(f"amplitude = {amplitude!r}\nrate = {rate!r}\n")
    target = loud / f"out{extension}"
    target.unlink(missing_ok=True)
    code, _, err = excite("export", loud / "loud.csv", "--to", fmt, "-o", target, "--limits", loud / "free.toml")
    if code == 3:
        assert "rounds it" in err and not target.exists()
    else:
        assert code == 0 and check(load_signal(target), Limits(amplitude=amplitude, rate=rate)).ok


def test_verdicts_name_the_method_and_set_the_exit_code(loud):
    base = ["check", loud / "loud.csv", "--method", "po_moesp", "--method", "arx"]
    code, out, _ = excite(*base, "--set", "block_rows=10")
    assert code == 0 and re.search(r"enough for po_moesp \(.*block_rows 10.*\) and order 4: yes", out)
    code, out, _ = excite(*base, "--set", "block_rows=60", "--json")
    verdicts = json.loads(out)["verdicts"]
    assert code == 3 and [v["status"] for v in verdicts] == ["no", "yes"] and "order 40 < 60" in verdicts[0]["text"]
    assert excite(*base, "--set", "blok_rows=3")[0] == 2


def test_closed_loop_data_are_judged_by_their_joint_information(tmp_path):
    rng, y, u = np.random.default_rng(0), np.zeros(2000), np.zeros(2000)
    for t in range(2, 2000):
        y[t] = 1.2 * y[t - 1] - 0.5 * y[t - 2] + u[t - 1] + 0.4 * u[t - 2] + 0.1 * rng.standard_normal()
        u[t] = -0.3 * y[t]
    save_experiment(Experiment(u, y, dt=0.1), tmp_path / "quiet.csv")
    code, out, _ = excite("check", tmp_path / "quiet.csv", "--arx", "2,2")
    assert code == 3 and "rejected" in out
    assert excite("check", tmp_path / "quiet.csv", "--arx", "two")[0] == 2


def test_proposals_say_why_and_start_from_a_model(tmp_path):
    known = ["--bandwidth-hz", "5", "--settling-s", "2", "--limit", "1"]
    code, out, _ = excite("design", "propose", "prbs", *known, "-o", tmp_path / "u.csv", "--json")
    proposal = json.loads(out)["proposal"]
    assert code == 0 and proposal["reasons"]["order"].startswith("the shortest sequence")
    assert load_signal(tmp_path / "u.csv").recipe["order"] == proposal["parameters"]["order"]
    assert excite("design", "propose", "prbs", "--limit", "1", "-o", tmp_path / "v.csv")[0] == 2
    assert excite("design", "propose", "sweep", *known, "--dt", "0.2", "-o", tmp_path / "v.csv")[0] == 3
    assert not (tmp_path / "v.csv").exists()
    model = tmp_path / "m.json"
    rng = np.random.default_rng(1)
    u = rng.standard_normal(500)
    y = np.convolve(u, 0.8 ** np.arange(30))[:500] + 0.1 * rng.standard_normal(500)
    save_experiment(Experiment(u, y, dt=0.05), tmp_path / "d.csv")
    assert excite("identify", tmp_path / "d.csv", "--method", "arx", "--order", "1", "-o", model)[0] == 0
    code, out, _ = excite("design", "propose", "multisine", "--model", model, "--limit", "2", "-o", tmp_path / "w.csv")
    assert code == 0 and "every line learns the response equally well" in out


def test_parts_play_one_after_the_other(tmp_path):
    (tmp_path / "parts.toml").write_text(PARTS)
    assert excite("design", "parts", tmp_path / "parts.toml", "-o", tmp_path / "u.npz")[0] == 0
    signal = load_signal(tmp_path / "u.npz")
    assert signal.recipe.kind == "in_sequence" and [str(c) for c in signal.channels] == ["flap [deg]", "tab [deg]"]
    (tmp_path / "parts.toml").write_text(PARTS.replace("unit_s", "unit_ms"))
    code, _, err = excite("design", "parts", tmp_path / "parts.toml", "-o", tmp_path / "v.npz")
    assert code == 2 and "excitation[0].unit_ms: unknown key for a multistep" in err


@pytest.mark.parametrize("extension", [".png", ".svg", ".pdf"])
def test_plots_are_drawn(loud, extension):
    target = loud / f"figure{extension}"
    code, *_ = excite("check", loud / "loud.csv", "--limits", loud / "limits.toml", "--plot", target)
    assert code == 3 and target.stat().st_size > 2000
    assert excite("check", loud / "loud.csv", "--plot", loud / "figure.xyz")[0] == 2


def test_one_channel_formats_say_which_files_they_wrote(tmp_path):
    prbs = ["--order", "5", "--dt", "0.01", "--channels", "2"]
    assert excite("design", "prbs", *prbs, "-o", tmp_path / "u.csv")[0] == 0
    code, out, _ = excite("export", tmp_path / "u.csv", "--to", "keysight", "-o", tmp_path / "u.arb")
    written = [line.split(": ")[0] for line in out.splitlines()]
    assert code == 0 and len(written) == 2 and all((tmp_path / name).exists() for name in written)
