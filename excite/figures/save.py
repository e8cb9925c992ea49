"""Figures into files."""

import os
from pathlib import Path

from excite.errors import ExciteError
from excite.figures.csv import to_csv
from excite.figures.figure import Figure
from excite.figures.json import to_json
from excite.figures.matplotlib_figure import house_style, to_matplotlib
from excite.figures.svg import to_svg
from excite.files.atomic import written

AS_TEXT = {".svg": to_svg, ".json": to_json, ".csv": to_csv}
PICTURES = (".png", ".pdf")


def save_figure(figure: Figure, path: str | os.PathLike) -> None:
    """Write a figure atomically; the extension says how: a picture (.png, .svg, .pdf), or its data (.json, .csv).

    Raises ExciteError for another extension, and where the file cannot be written.
    """
    extension = Path(path).suffix.lower()
    if extension not in (*AS_TEXT, *PICTURES):
        raise ExciteError(f"--plot {path}: extension '{extension}'; name a .png, .svg, .pdf, .json or .csv file")
    with written(path) as temporary:
        if extension in AS_TEXT:
            temporary.write_text(AS_TEXT[extension](figure), encoding="utf-8")
        else:
            metadata = {"CreationDate": None} if extension == ".pdf" else None
            with house_style():
                to_matplotlib(figure).savefig(temporary, format=extension[1:], metadata=metadata)
