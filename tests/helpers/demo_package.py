"""A package outside ours, installed for a test: a module, and entry points that name what stands in it."""

from uuid import uuid4


def install(folder, monkeypatch, group, module, entries):
    """Write module text and entry points (name -> attribute, or module:attribute) into a folder on the path."""
    name = f"demo_{uuid4().hex}"  # a module of the same name would still be loaded from an earlier test
    (folder / f"{name}.py").write_text(module, encoding="utf-8")
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: 1.0\n")
    lines = [f"{key} = {value if ':' in value else f'{name}:{value}'}" for key, value in entries.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]), encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    return name
