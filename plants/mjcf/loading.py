"""Reading a model file that somebody else wrote: what it names stays in its folder, and it is first compiled elsewhere."""

import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

import mujoco

from excite.errors import ExciteError

MOST_BYTES = 10_000_000
MOST_VELOCITIES, MOST_CHANNELS = 200, 200
SECONDS = 60
SUBMODELS = ("include", "model")  # elements whose file is another model
# Run in a process of its own: a model that crashes, hangs or eats memory takes only that with it.
TRIAL = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
except (ImportError, ValueError, OSError):
    pass
import mujoco
try:
    model = mujoco.MjModel.from_xml_path(sys.argv[1])
    data = mujoco.MjData(model)
    for _ in range(3):
        mujoco.mj_step(model, data)
except Exception as error:
    sys.exit(str(error))
"""


def load_model(path: Path) -> mujoco.MjModel:
    """Return the compiled model of an MJCF file.

    Raises ExciteError for a file that cannot be read, names anything outside its folder, uses plugins, does not compile,
    or crashes MuJoCo, which is tried in a process of its own first.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    return _tried(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _tried(path: Path, modified: int, size: int) -> mujoco.MjModel:
    """Return the model of a file in one state of it, compiled once."""
    _check(path, path.parent.resolve(), ())
    with tempfile.TemporaryDirectory() as elsewhere:  # MuJoCo writes its log into the current folder
        try:
            trial = subprocess.run(
                [sys.executable, "-c", TRIAL, str(path)], cwd=elsewhere, capture_output=True, text=True, timeout=SECONDS
            )
        except subprocess.TimeoutExpired:
            raise ExciteError(f"{path}: MuJoCo does not compile it in {SECONDS} s; make it smaller") from None
    if trial.returncode < 0:
        raise ExciteError(f"{path}: crashes MuJoCo (signal {-trial.returncode}); correct the model")
    if trial.returncode:
        raise ExciteError(f"{path}: MuJoCo refuses it ({' '.join(trial.stderr.split())}); correct it at that place")
    model = mujoco.MjModel.from_xml_path(str(path))
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise ExciteError(f'{path}: integrator RK4 cannot be linearised; use integrator="implicitfast", or Euler')
    if model.nhistory:
        raise ExciteError(
            f"{path}: delays actuators or sensors, which the linearisation does not see; drop delay and interval"
        )
    for what, count, most in (
        ("degrees of freedom", model.nv, MOST_VELOCITIES),
        ("actuators", model.nu, MOST_CHANNELS),
        ("sensor values", model.nsensordata, MOST_CHANNELS),
    ):
        if not 0 < count <= most:
            raise ExciteError(f"{path}: has {count} {what}; a plant has 1 to {most}")
    return model


def files_of(path: Path) -> tuple[Path, ...]:
    """Return a model file and every file that it names, directly or through others, of those that are there."""
    found, left, folder = {path.resolve()}, [path.resolve()], path.parent.resolve()
    while left:
        root = ElementTree.fromstring(left.pop().read_bytes())
        folders = {".", *(v for e in root.iter("compiler") for key, v in e.attrib.items() if key.endswith("dir"))}
        for element in root.iter():
            for value in (v for key, v in element.attrib.items() if key.startswith("file")):
                for target in {(folder / inside / value).resolve() for inside in folders}:
                    if target.is_file() and target not in found:
                        found.add(target)
                        left += [target] if element.tag in SUBMODELS else []
    return tuple(sorted(found))


def _check(path: Path, folder: Path, above: tuple[Path, ...]) -> None:
    """Refuse a file, and those that it includes, for what they name rather than for what they do with it."""
    if path in above:
        raise ExciteError(f"{path}: includes itself; drop that element")
    try:
        text = path.read_bytes() if path.stat().st_size <= MOST_BYTES else None
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if text is None:
        raise ExciteError(f"{path}: is larger than {MOST_BYTES // 1_000_000} MB; keep meshes in files of their own")
    if b"\0" in text or b"<!" in text.replace(b"<!--", b""):
        raise ExciteError(f"{path}: declares a document type or entities; a model needs none, drop them")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ExciteError(f"{path}: is no XML ({error}); give an MJCF file") from None
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise ExciteError(f"{path}: is no MJCF file: its root is <{root.tag}>, not <mujoco>")
    folders = {".", *(value for e in root.iter("compiler") for key, value in e.attrib.items() if key.endswith("dir"))}
    for element in root.iter():
        if element.tag in ("plugin", "extension"):
            raise ExciteError(f"{path}: uses plugins (<{element.tag}>), which are code; drop them")
        for key, value in element.attrib.items():
            if not (key.startswith("file") or (element.tag == "compiler" and key.endswith("dir"))):
                continue
            named = PureWindowsPath(value)  # takes / and \\ for separators, as MuJoCo does
            targets = [(folder / inside / value).resolve() for inside in folders]
            outside = any(not target.is_relative_to(folder) for target in targets)
            if named.drive or named.root or ".." in named.parts or outside:
                raise ExciteError(f"{path}: <{element.tag} {key}={value!r}> leaves the model's folder; copy it there")
            if key == "file" and element.tag in SUBMODELS:
                _check(folder / value, folder, (*above, path))
