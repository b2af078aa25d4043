"""Files of tracks as people have them: packed, in any encoding, with any separator, commented."""

import codecs
import csv
import gzip
import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pandas as pd

from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

#: Largest file of tracks [bytes], unpacked; those of the data sets are smaller.
MOST_BYTES = 2**31
_LONGEST_TITLES = 2**16  # characters of the line of column names
_SEPARATORS = ",;\t|"
BLANKS = r"\s+"
_NUMBER = r"[-+]?[\d.,]+(e[-+]?\d+)?"
_LOOKED_AT = 10_000  # characters that say whether decimals have commas
_SHOWN, _SHOWN_NAME = 8, 60  # names in a message, and characters of each
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
#: Columns by which a format is known.
_SIGNS = {
    "ind": {"trackid", "xcenter"},
    "highd": {"id", "frame", "xvelocity"},
    "ngsim": {"vehicle_id", "local_x"},
    "interaction": {"track_id", "timestamp_ms"},
    "csv": {"time", "player", "x", "y"},
}
_FOREIGN = {b"PAR1": "a Parquet file", b"<": "an XML file", b"\xd0\xcf\x11\xe0": "an Excel file"}


def read_bytes(kind: str, path: Path, most: int) -> bytes:
    """The content of a file, unpacked if gzip or zip has packed it, whatever its suffix."""
    check_input(kind, path, most)
    with (
        bad_input(f"{kind} {path} cannot be unpacked", OSError, RuntimeError),
        path.open("rb") as file,
    ):
        start = file.read(4)
        file.seek(0)
        if start[:2] == b"\x1f\x8b":
            data = gzip.GzipFile(fileobj=file).read(most + 1)
        elif start == b"PK\x03\x04":
            data = _only_one(path, ZipFile(file), most)
        else:
            return path.read_bytes()
    if len(data) > most:
        raise UserError(f"{kind} {path} has more than {most} bytes unpacked, no more are read")
    return data


def read_xml(kind: str, path: Path, most: int, root: str) -> ElementTree.Element:
    """The root of an XML file; ValueError if it has another name, and what parsers raise."""
    found = ElementTree.parse(BytesIO(read_bytes(kind, path, most))).getroot()
    if found.tag != root:
        raise ValueError(f"its root is <{found.tag}>, not <{root}>")
    return found


def _only_one(path: Path, archive: ZipFile, most: int) -> bytes:
    names = [
        name for name in archive.namelist() if not name.endswith("/") and "__MACOSX" not in name
    ]
    if len(names) != 1:
        raise UserError(
            f"{path} is an archive of {len(names)} files, expected one: {listed(names)}"
        )
    return archive.open(names[0]).read(most + 1)


def unpacked(path: Path) -> Path:
    """The path without the suffix of a packed file."""
    return path.with_suffix("") if path.suffix.lower() in (".gz", ".zip") else path


@dataclass(frozen=True)
class Sheet:
    """A table as text: its column names, and its rows of cells between separators."""

    path: Path
    titles: list[str]
    text: str  # rows, without titles; lines that are not rows are empty
    first: int  # number of the first line of the rows
    separator: str
    decimal: str

    def columns(
        self, needed: Sequence[str], optional: Sequence[str] = (), texts: Sequence[str] = ()
    ) -> pd.DataFrame:
        """Columns by name, whatever the case; ``texts`` are read as they are written.

        The index of a row, plus one, is its number among all lines of rows. UserError on a column
        that is absent or appears twice, and on a table without rows.
        """
        there = [title.lower() for title in self.titles]
        if not there:
            raise UserError(f"{self.path} is empty; expected the columns {', '.join(needed)}")
        absent = [name for name in needed if name.lower() not in there]
        if absent:
            raise UserError(
                f"{self.path}: missing column{'s'[: len(absent) > 1]} {', '.join(absent)}; "
                f"it has: {listed(self.titles)}{_looks_like(there)}"
            )
        found = [name for name in (*needed, *optional) if name.lower() in there]
        twice = [name for name in found if there.count(name.lower()) > 1]
        if twice:
            raise UserError(f"{self.path}: column {twice[0]!r} appears twice")
        places = [there.index(name.lower()) for name in found]
        with bad_input(f"{self.path} is not a CSV file", OSError):
            cells = self._cells(places, [there.index(name) for name in texts if name in there])
        if cells[len(there)].notna().any() or not isinstance(cells.index, pd.RangeIndex):
            raise UserError(
                f"{self.path} is not a CSV file: its rows have more cells than the {len(there)} "
                "column names"
            )
        rows = cells[places].set_axis(found, axis=1).dropna(how="all")
        if rows.empty:
            raise UserError(f"{self.path} has column names, but no rows")
        return rows

    def _cells(self, places: list[int], texts: list[int]) -> pd.DataFrame:
        """Columns by place, and the one after the last name, which pandas would cut silently."""
        after = len(self.titles)
        blank = " " if self.separator == BLANKS else self.separator
        found = pd.read_csv(
            StringIO(blank.join(map(str, range(after + 1))) + "\n" + self.text),
            usecols=[*places, after],
            sep=self.separator,
            decimal=self.decimal,
            dtype=dict.fromkeys(texts, str),
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
        )
        return found.set_axis(found.columns.astype(int), axis=1)


def read_sheet(path: Path, usual: Sequence[str] = ()) -> Sheet:
    """Read a table: values between commas, semicolons, tabs, bars or blanks.

    Lines that begin with # are comments; the last one above the rows may have the column names.
    ``usual`` are those of a file that has none.
    """
    text = _decoded(path, read_bytes("tracks file", path, MOST_BYTES))
    above, line, start, end = "", "", 0, 0
    while end < len(text) and not line:
        start, end = end, text.find("\n", end) + 1 or len(text)
        if end - start > _LONGEST_TITLES:
            raise UserError(
                f"{path} is not a CSV file: it has a line of more than {_LONGEST_TITLES} "
                "characters above its rows"
            )
        line = text[start:end].strip()
        if line.startswith("#"):
            above, line = line.lstrip("# "), ""
        elif re.fullmatch("sep=.", line):  # as Excel writes it
            line = ""
    separator = _separator(line or above)
    titles = _cut(line, separator) if line else []
    if not line or re.fullmatch(_NUMBER, titles[0]):
        named = _cut(above, separator) if above else []
        titles = named if not line or len(named) == len(titles) else list(usual) or titles
        end = start if line else end
    rows = re.sub(r"(?m)^\s*#.*$", "", text[end:]) if "#" in text[end:] else text[end:]
    return Sheet(
        path, titles, rows, text.count("\n", 0, end) + 1, separator, _decimal(rows, separator)
    )


def _looks_like(titles: Sequence[str]) -> str:
    """Which format has such columns, for messages."""
    found = [name for name, columns in _SIGNS.items() if columns <= set(titles)]
    return f"; this looks like --format {found[0]}" if found else ""


def _decoded(path: Path, data: bytes) -> str:
    for start, what in _FOREIGN.items():
        if data[:_LOOKED_AT].lstrip().startswith(start):
            raise UserError(f"{path} is {what}, not a table of text")
    marks = (encoding for mark, encoding in _MARKS.items() if data.startswith(mark))
    encoding = next(marks, "utf-8")
    with bad_input(f"{path} is not a CSV file"):
        if encoding != "utf-16" and b"\0" in data:
            raise ValueError("it has zero bytes, which text has not")
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            if encoding != "utf-8":
                raise
            text = data.decode("cp1252")  # Windows, in western Europe
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _separator(line: str) -> str:
    """What separates names in a line."""
    bare = re.sub('"[^"]*"', "", line)
    best = max(_SEPARATORS, key=bare.count)
    return best if best in bare else BLANKS if " " in bare else ","


def _cut(line: str, separator: str) -> list[str]:
    if separator == BLANKS:
        return line.split()
    return [name.strip() for name in next(csv.reader([line], delimiter=separator))]


def _decimal(rows: str, separator: str) -> str:
    """A comma if it separates digits in the first rows, and not cells."""
    looked_at = rows[:_LOOKED_AT]
    return "," if separator != "," and re.search(r"\d,\d", looked_at) else "."


def listed(names: Sequence[str]) -> str:
    """The first few names as text, for messages."""
    more = len(names) - _SHOWN
    shown = (f"{n[:_SHOWN_NAME]}..." if len(n) > _SHOWN_NAME else n for n in names[:_SHOWN])
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
