"""The command line as tests call it: in this process, and what it must answer with."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout

import numpy as np

from scenarios.cli.main import status

ROLES = ("--inputs", "0", "--outputs", "1", "--dt", "0.1")


def excite(*argv):
    """Run the command line in this process: (exit code, stdout, stderr)."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = status([str(a) for a in argv])
    return code, out.getvalue(), err.getvalue()


def strict(text):
    """Parse one JSON object that holds no NaN or infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)


def refused(*argv, code=2):
    """Assert a refusal in words: nothing on stdout, no traceback; return the message."""
    got, out, err = excite(*argv)
    assert (got, out) == (code, ""), (got, out, err)
    assert "Traceback" not in err and err.strip()
    return err


def samples(count=300, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    return np.column_stack([u, np.convolve(u, [0, 1, 0.5, 0.2])[:count] + 0.01 * rng.standard_normal(count)])


def write(path, values):
    np.savetxt(path, values, delimiter=",")
    return path


# identify -------------------------------------------------------------------------------------------------------------


def identify(path, *more, method="po_moesp", roles=ROLES):
    return ("identify", path, *roles, "--method", method, *more)
