"""Text tables: CSV in its many dialects and whitespace-separated columns."""

import codecs
import csv
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import Format
from excite.files.sidecar import read_sidecar, written_with_sidecar
from excite.files.table import Table

BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
DECIMAL_COMMA = re.compile(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?")
BARE_HEADER = re.compile(r'"[^"]*"|[^\s\[]+(?:\s*\[[^\]]*\])?')
ROWS_AT_ONCE = 100_000


def write(table: Table, path: Path) -> None:
    """Write CSV (comma, point, UTF-8, shortest text that reads back bit for bit) and its JSON sidecar.

    The sidecar holds the table's meta, the column headers and the SHA-256 of the CSV file.
    """
    with written_with_sidecar(path, table) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(table.names)
        for start in range(0, len(table.values), ROWS_AT_ONCE):
            writer.writerows(table.values[start : start + ROWS_AT_ONCE].tolist())


def read(path: Path) -> Table:
    """Return the table in a text file.

    Understood: UTF-8 with or without BOM, UTF-16 with BOM, else Latin-1; any line ends; comma, semicolon, tab or blanks
    between columns; decimal point, or decimal comma where the comma does not separate; quotes; one header row or none;
    blank lines and lines that start with # or %. An empty field or nan is a missing sample. A sidecar counts only while
    its SHA-256 is that of the file.
    """
    raw = readable(path).read_bytes()
    text = _decode(raw, path)
    rows = [line for _, line in _rows(text)]
    if not rows:
        raise ExciteError(f"{path}: no data rows; it must hold at least one sample")
    dialect = _Dialect(rows, path)
    names = dialect.header(rows[0])
    if names is not None:
        rows = rows[1:]
    if not rows:
        raise ExciteError(f"{path}: a header but no data rows; it must hold at least one sample")
    values = dialect.parse(rows, text)
    if np.isinf(values).any():
        row, column = np.argwhere(np.isinf(values))[0]
        line = next(islice(_rows(text), int(row) + (names is not None), None))[0]
        raise ExciteError(f"{path}: line {line}, column {column} is infinite; correct it, or leave it empty if missing")
    if dialect.trailing(rows[0]) and np.isnan(values[:, -1]).all():
        values = values[:, :-1]
        names = names if names is None or names[-1] else names[:-1]
    if names is not None and len(names) != values.shape[1]:
        counts = f"the header names {len(names)} columns, the data rows have {values.shape[1]}"
        raise ExciteError(f"{path}: {counts}; make them agree")
    meta = {key: value for key, value in read_sidecar(path, raw).items() if key != "columns"}
    return Table(tuple(names or [""] * values.shape[1]), values, str(path), meta)


def _decode(raw: bytes, path: Path) -> str:
    encoding = next((name for mark, name in BOMS.items() if raw.startswith(mark)), "utf-8")
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if "\0" in text:
        raise ExciteError(f"{path}: is not a text file; give CSV or columns of numbers, or the extension of its format")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _rows(text: str) -> Iterator[tuple[int, str]]:
    """Yield line number (from 1) and text of every line that is neither blank nor a comment."""
    for number, line in enumerate(text.split("\n"), 1):
        start = line.lstrip()[:1]
        if start and start not in "#%":
            yield number, line


def _is_number(cell: str) -> bool:
    """Whether a cell is a number or missing."""
    cell = cell.strip().replace(",", ".")
    try:
        return not cell or ("_" not in cell and bool(np.isreal(float(cell))))
    except ValueError:
        return False


class _Dialect:
    """How one file separates its cells, and the fast path to its numbers with a slow one that finds the bad cell."""

    def __init__(self, rows: list[str], path: Path) -> None:
        self.path = path
        self.delimiter: str | None = None
        sample = re.sub(r'"[^"]*"', "0", rows[min(1, len(rows) - 1)])
        cells = sample.split()
        if ";" in sample:
            self.delimiter = ";"
        elif "," in sample and not (len(cells) > 1 and all(DECIMAL_COMMA.fullmatch(cell) for cell in cells)):
            self.delimiter = ","
        elif "\t" in sample and (not all(map(_is_number, rows[0].split("\t"))) or "\t\t" in sample):
            self.delimiter = "\t"
        self.alone = self.delimiter is None and len(cells) == 1

    def header(self, row: str) -> list[str] | None:
        """Return the names in the first row, or None when it holds data."""
        cells = self.split(row)
        filled = [cell for cell in cells if cell.strip()]
        if 2 * sum(map(_is_number, filled)) > len(filled) or not filled or all(map(_is_number, filled)):
            return None
        if self.alone:
            return [row.strip().strip('"')]
        if self.delimiter is None:
            return [cell.strip('"') for cell in BARE_HEADER.findall(row)]
        return [cell.strip() for cell in cells]

    def split(self, row: str) -> list[str]:
        """Return the cells of one row."""
        if self.delimiter is None:
            return row.replace('"', "").split()
        try:
            return next(csv.reader([row], delimiter=self.delimiter, skipinitialspace=True))
        except csv.Error as error:
            raise ExciteError(f"{self.path}: not a table of numbers ({error}); use plain numbers and commas") from error

    def trailing(self, row: str) -> bool:
        """Whether a row ends with a delimiter, as some programs write behind the last cell."""
        return self.delimiter is not None and row.rstrip(" ").endswith(self.delimiter)

    def parse(self, rows: list[str], text: str) -> np.ndarray:
        """Return the numbers of the data rows as (N, c)."""
        delimiter = self.delimiter
        if any('"' in row for row in rows):
            delimiter = ";" if delimiter else None
            rows = [(delimiter or " ").join(self.split(row)) or "nan" for row in rows]
        if delimiter != "," and any("," in row for row in rows):
            if any("." in row for row in rows):
                raise self.locate(text, len(rows), mixed=True)
            rows = [row.replace(",", ".") for row in rows]
        try:
            return np.loadtxt(rows, delimiter=delimiter, comments=None, ndmin=2)
        except ValueError:
            if delimiter is None:
                raise self.locate(text, len(rows)) from None
        empty = re.compile(rf"(^|{delimiter}) *(?={delimiter}|$)")
        try:
            return np.loadtxt([empty.sub(r"\1nan", row) for row in rows], delimiter=delimiter, comments=None, ndmin=2)
        except ValueError:
            raise self.locate(text, len(rows)) from None

    def locate(self, text: str, count: int, mixed: bool = False) -> ExciteError:
        """Return the error that names the line and column which spoilt the file's `count` data rows."""
        numbered = list(_rows(text))[-count:]
        width = len(self.split(numbered[0][1]))
        for number, row in numbered:
            cells = self.split(row)
            if len(cells) != width:
                return ExciteError(
                    f"{self.path}: line {number} has {len(cells)} columns, line {numbered[0][0]} has {width}; "
                    "every row needs the same number"
                )
            for column, cell in enumerate(cells):
                if not _is_number(cell):
                    return ExciteError(
                        f"{self.path}: line {number}, column {column}: '{cell.strip()}' is not a number; "
                        "correct it, or leave it empty if missing"
                    )
                if mixed and "," in cell:
                    return ExciteError(
                        f"{self.path}: line {number}, column {column}: '{cell.strip()}' has a comma, other numbers a "
                        "point; use one decimal sign and no thousands separators"
                    )
        return ExciteError(f"{self.path}: cannot be read as a table of numbers; use plain numbers and commas")


CSV = Format("comma-separated values, any dialect read, roles and units in the header", (".csv",), read, write)
COLUMNS = Format("columns of numbers between blanks or tabs, as DaISy and many loggers write", (".dat", ".txt"), read)
