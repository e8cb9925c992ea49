"""Packages that look installed: a folder with their metadata, to be put on the path."""

import os
import subprocess
import sys

from paths import ROOT


def install(folder, name, modules=None, entry_points=None, top_level=()):
    """Write a distribution: modules, name -> text; entry_points, group -> name -> "module:attribute"."""
    info = folder / f"{name.replace('-', '_')}-0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    if top_level:
        (info / "top_level.txt").write_text("\n".join(top_level) + "\n")
    (info / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in points.items())
            for group, points in (entry_points or {}).items()
        )
    )
    for path, text in (modules or {}).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder


def python(*argv, path=(), cwd=None, **environment):
    """Run Python with our checkout and some folders on its path: (exit code, stdout, stderr)."""
    place = os.pathsep.join(map(str, (*path, ROOT)))
    environment = {**os.environ, "PYTHONPATH": place, **environment}
    done = subprocess.run(
        [sys.executable, *map(str, argv)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    return done.returncode, done.stdout, done.stderr


def plug_in(monkeypatch, registry, folder):
    """Put a folder on the path and let a registry look for its entry points; both are undone when the test ends."""
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(registry.__dict__, "_plugins", None)  # what it found is kept there, and comes back afterwards
    del registry.__dict__["_plugins"]
