"""A package outside ours, as pip would install it: modules and entry points in a folder on the path."""

from textwrap import dedent


def install(folder, monkeypatch, registry, entries, **modules):
    """Write modules, and a distribution "outside" 1.2 whose entry points lead to them; the registry looks again.

    entries : name -> "module:attribute"; modules : name -> source text. All is gone when the test ends.
    """
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(dedent(source), encoding="utf-8")
    described = folder / "outside-1.2.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: outside\nVersion: 1.2\n", encoding="utf-8")
    lines = [f"[{registry.group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (described / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    # What a registry found is kept in its __dict__; a plug-in of one test must be no plug-in of the next.
    monkeypatch.setitem(registry.__dict__, "_plugins", None)
    del registry.__dict__["_plugins"]
