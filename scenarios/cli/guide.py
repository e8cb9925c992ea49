"""excite guide."""

from pathlib import Path

import click

from excite.errors import ExciteError, did_you_mean
from scenarios.cli.output import print_lines

GUIDE = Path(__file__).parents[1] / "guide"
FIRST = ("index", "first-experiment", "reading-data", "which-method")  # then the others, by name


@click.command()
@click.argument("page", required=False)
def guide(page: str | None) -> int:
    """List the pages of the guide, or print one (Markdown)."""
    known = pages()
    if page is None:
        print_lines([f"{name:<18} {title(text)}" for name, text in known.items()])
    elif page not in known:
        raise ExciteError(f"page '{page}' does not exist; {did_you_mean(page, known)}")
    else:
        click.echo(known[page], nl=False)
    return 0


def pages() -> dict[str, str]:
    """Return the pages of the guide, name -> Markdown, those to begin with first."""
    names = sorted(path.stem for path in GUIDE.glob("*.md"))
    names.sort(key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST))
    return {name: (GUIDE / f"{name}.md").read_text(encoding="utf-8") for name in names}


def title(text: str) -> str:
    """Return the heading of a page."""
    return text.splitlines()[0].removeprefix("# ")
