"""excite doctor: whether this installation can work."""

import platform
from collections.abc import Callable, Iterator
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path

import click

from excite.errors import in_words
from excite.registry import Registry
from scenarios.cli.output import print_lines

OURS = ("excite", "plants", "identify", "scenarios")
DISTRIBUTION = "excite-sysid"
CLASHING = ("identify", "scenarios")  # distributions on PyPI that install packages of our names
NEEDED = ("numpy", "scipy", "control", "mujoco", "matplotlib", "osqp", "h5py", "click", "filelock", "tomli-w")
REGISTRIES = (
    "excite.generators:GENERATORS",
    "excite.files.formats:FORMATS",
    "plants.registry:PLANTS",
    "identify.registry:METHODS",
    "identify.orders.rules:ORDER_RULES",
    "identify.steps.regions:REGIONS",
    "identify.figures.registry:FIGURES",
    "identify.metrics.registry:METRICS",
)

Finding = tuple[bool, str]  # whether it is as it should be, and what to say


@click.command()
def doctor() -> int:
    """Check whether this installation is well.

    Versions, clashing package names, plug-ins and plants; exit code 2 when something is wrong.
    """
    findings = [finding for check in CHECKS for finding in _safely(check)]
    wrong = sum(not well for well, _ in findings)
    lines = [f"python {platform.python_version()} on {platform.platform()}", *(line for _, line in findings)]
    print_lines([*lines, "all well" if not wrong else f"{wrong} thing(s) to correct"])
    return 2 if wrong else 0


def versions() -> Iterator[Finding]:
    """Tell which of the packages that we need are installed."""
    for name in NEEDED:
        try:
            yield True, f"{name} {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield False, f"{name} MISSING: pip install {name}"


def names() -> Iterator[Finding]:
    """Find other packages of our names: installed over ours, before ours on the path, or in the working folder."""
    home, owners = Path(import_module("excite").__path__[0]).parent, metadata.packages_distributions()
    for name in OURS:
        spec = find_spec(name)
        if spec is None or spec.origin != str(home / name / "__init__.py"):
            place = "nowhere" if spec is None else spec.origin or ", ".join(spec.submodule_search_locations or ())
            yield False, f"package '{name}' comes from {place}, not from {home}: something else shadows it"
        others = {*owners.get(name, ())} - {DISTRIBUTION} | ({name} if name in CLASHING and _installed(name) else set())
        for other in sorted(others):
            yield (
                False,
                f"distribution '{other}' is installed and overwrites our package '{name}': use a fresh environment",
            )
        for local in (Path.cwd() / f"{name}.py", Path.cwd() / name / "__init__.py"):
            if local.exists() and Path.cwd() != home:
                yield False, f"{local} hides our package '{name}' when Python is started in this folder: rename it"


def plugins() -> Iterator[Finding]:
    """Name the plug-ins that are in use, and those that were left out with the reason."""
    known = {}
    for place in REGISTRIES:
        module, attribute = place.split(":")
        registry = getattr(import_module(module), attribute)
        if isinstance(registry, Registry):
            known[registry.group] = registry
    for group, registry in known.items():
        for name in registry:
            if package := registry.distribution(name):
                yield True, f"plug-in: {registry.thing} {name}, from {' '.join(package)}"
        for name, reason in registry.skipped.items():
            yield False, f"plug-in of {group} left out: {name}: {reason}"
    for distribution in metadata.distributions():
        try:
            points = list(distribution.entry_points)
        except Exception as error:  # a damaged package
            yield False, f"distribution '{distribution.name}': its entry points cannot be read ({in_words(error)})"
            continue
        for point in points:
            if point.group.startswith("excite.") and point.group not in known:
                yield (
                    False,
                    f"plug-in {point.name} ({point.value}): there is no group {point.group}; known: {', '.join(known)}",
                )


def simulators() -> Iterator[Finding]:
    """Load every plant."""
    from plants.registry import list_plants, load_plant

    for name in list_plants():
        try:
            load_plant(name)
            yield True, f"plant {name} loads"
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a broken binary package or a plug-in raises is the finding
            yield False, f"plant {name} does not load: {in_words(error)}"


CHECKS: tuple[Callable[[], Iterator[Finding]], ...] = (versions, names, plugins, simulators)


def _safely(check: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Yield the findings of a check, and what ended it early: the doctor must outlive what it finds."""
    try:
        yield from check()
    except Exception as error:  # anything may be broken here
        yield False, f"{check.__name__} could not be checked: {in_words(error)}"


def _installed(name: str) -> bool:
    try:
        return bool(metadata.version(name))
    except metadata.PackageNotFoundError:
        return False
