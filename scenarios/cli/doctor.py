"""excite doctor: whether this installation can work."""

import platform
from importlib import import_module, metadata
from pathlib import Path

import click

from scenarios.cli.common import print_lines

OURS = ("excite", "plants", "identify", "scenarios")
CLASHING = ("identify", "scenarios")  # distributions on PyPI that install packages of our names
NEEDED = ("numpy", "scipy", "control", "mujoco", "matplotlib", "osqp", "h5py", "click", "filelock", "tomli-w")


@click.command()
def doctor() -> int:
    """Check versions, package names that clash, and that the simulator runs; exit code 2 when something is wrong."""
    lines, wrong = [f"python {platform.python_version()} on {platform.platform()}"], 0
    for name in NEEDED:
        try:
            lines.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            wrong += 1
            lines.append(f"{name} MISSING: pip install {name}")
    home = Path(import_module("excite").__file__).parents[1]
    for name in OURS:
        found = Path(import_module(name).__file__).parents[1]
        if found != home:
            wrong += 1
            lines.append(f"package '{name}' comes from {found}, not from {home}: another distribution shadows it")
    for name in CLASHING:
        try:
            version = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
        wrong += 1
        lines.append(
            f"distribution '{name}' {version} is installed and overwrites our package '{name}': use a fresh environment"
        )
    try:
        from plants.registry import list_plants, load_plant

        for name in list_plants():
            load_plant(name)
            lines.append(f"plant {name} loads")
    except Exception as error:  # whatever a broken binary package raises is the finding
        wrong += 1
        lines.append(f"plants do not load: {error}")
    lines.append("all well" if not wrong else f"{wrong} thing(s) to mend")
    print_lines(lines)
    return 2 if wrong else 0
