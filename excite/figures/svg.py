"""A figure as SVG: text stays text, the same data give the same characters, numbers have two decimals."""

import io
import re

from excite.figures.figure import Figure
from excite.figures.matplotlib_figure import house_style, printable, to_matplotlib

# The first is the one that the layout was made with; Verdana is nearly as wide, the others are narrower.
FONTS = "'DejaVu Sans', Verdana, Geneva, 'Segoe UI', Helvetica, Arial, sans-serif"
TAG = re.compile(r"<[^<>]+>")  # text and attributes hold neither < nor >: they are escaped
DIGITS = re.compile(r"(\.\d\d)\d+")
UNTURNED = re.compile(r' transform="rotate\(-?0 [^"]*"')
FONT = re.compile(r"font-family: [^;\"]*(; |(?=\"))")


def to_svg(figure: Figure) -> str:
    """Return the figure as an SVG element, with its title and its caption as metadata."""
    drawing, buffer = to_matplotlib(figure), io.BytesIO()
    about = " ".join(filter(None, (figure.verdict, figure.caption)))
    metadata = {
        "Date": None,
        "Creator": None,
        "Title": printable(figure.title),
        "Description": printable(about) or None,
    }
    with house_style():
        drawing.savefig(buffer, format="svg", metadata=metadata)
    text = buffer.getvalue().decode("utf-8")
    text = TAG.sub(_tidy, text[text.index("<svg") :])
    return text.replace("</style>", f"text{{font-family: {FONTS}}}</style>", 1)


def _tidy(tag: re.Match[str]) -> str:
    """Shorten the numbers of one tag, and leave the font to the style sheet."""
    text = tag[0]
    if text.startswith("<text"):
        text = UNTURNED.sub("", FONT.sub("", text))
    if text.startswith(("<path", "<use", "<text", "<rect", "<image")):
        text = re.sub(r' (?:d|x|y|transform)="[^"]*"', lambda attribute: DIGITS.sub(r"\1", attribute[0]), text)
    return text
