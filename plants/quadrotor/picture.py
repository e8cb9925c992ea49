"""Pictures and clips of a flight, rendered offscreen by MuJoCo."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from excite.errors import ExciteError, Unsupported
from excite.files.atomic import written
from excite.types.recording import Recording

POSE = ("x", "y", "altitude", "qw", "qx", "qy", "qz")
BACKENDS = ("egl", "glfw")  # for MUJOCO_GL, unless it is set
PATIENCE_S = 120.0


def picture(recording: Recording, time_s: float | None = None, *, width: int = 640, height: int = 480) -> np.ndarray:
    """Return one frame of a flight, (height, width, 3) uint8, at time_s, by default its last."""
    time_s = recording.time_s[-1] if time_s is None else time_s
    return _frames(recording, np.array([time_s]), width, height)[0]


def clip(recording: Recording, path: str | Path, *, fps: int = 25, width: int = 320, height: int = 240) -> None:
    """Write a flight as an animated GIF, at the speed of the flight."""
    from PIL import Image

    if Path(path).suffix.lower() != ".gif":
        raise ExciteError(f"{path}: a clip is a GIF file; give a name that ends in .gif")
    if not 0 < fps <= 50:
        raise ExciteError(f"clip: fps {fps!r}; give 1 to 50, since a GIF counts hundredths of a second")
    times = np.arange(recording.time_s[0], recording.time_s[-1], 1.0 / fps)
    first, *others = (Image.fromarray(frame) for frame in _frames(recording, times, width, height))
    with written(path) as temporary:
        first.save(temporary, "GIF", save_all=True, append_images=others, duration=1000 // fps, loop=0)


def _frames(recording: Recording, times_s: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return frames (T, height, width, 3) uint8, rendered in a process of their own.

    MuJoCo chooses its graphics library once, by the environment, when it is first imported, and a missing or broken one
    may take the process down.
    """
    if recording.origin.plant != "quadrotor":
        raise ExciteError(f"picture: the recording is of {recording.origin.plant!r}; pass one of the quadrotor")
    rows = np.clip(np.searchsorted(recording.time_s, times_s), 0, len(recording.time_s) - 1)
    asked = os.environ.get("MUJOCO_GL")
    with tempfile.TemporaryDirectory() as folder:
        flight, frames = Path(folder) / "flight.npz", Path(folder) / "frames.npy"
        names, values = zip(*recording.origin.parameters.items(), strict=True)
        np.savez(flight, names=names, values=values, poses=recording.columns(POSE)[rows], size=(width, height))
        reasons = []
        for backend in (asked,) if asked else BACKENDS:
            try:
                done = subprocess.run(
                    [sys.executable, "-m", "plants.quadrotor.renderer", flight, frames],
                    env={**os.environ, "MUJOCO_GL": backend},
                    capture_output=True,
                    text=True,
                    timeout=PATIENCE_S,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                reasons.append(f"{backend}: nothing in {PATIENCE_S:g} s")
                continue
            if done.returncode == 0:
                return np.load(frames)
            reasons.append(f"{backend}: {(done.stderr.strip().splitlines() or ['crashed'])[-1]}")
    raise Unsupported(
        f"picture: no graphics library renders offscreen here ({'; '.join(reasons)}); install EGL (libegl1 and a driver such as "
        "libgl1-mesa-dri), or set MUJOCO_GL to one that works"
    )
