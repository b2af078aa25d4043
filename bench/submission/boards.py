"""Compare the tables of a submission with those that its rows make."""

import csv
import io
import math

import pandas as pd

from olne_bench.bench.report.escapes import csv_safe
from olne_bench.bench.report.leaderboard_text import markdown
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.submission.files import read_file
from olne_bench.bench.submission.manifest import LEADERBOARD, LEADERBOARD_TEXT, ROWS, Submission
from olne_bench.errors import UserError

#: Tolerance of numbers in tables, whose last digits depend on the versions of libraries.
_RELATIVE, _ABSOLUTE = 1e-6, 1e-12


def board_files(table: pd.DataFrame, study: Study) -> dict[str, str]:
    """The leaderboard of rows, as the texts of the files of a submission."""
    board = tabulate(weighed(table), study).leaderboard
    return {
        LEADERBOARD: csv_safe(board).to_csv(index=False),
        LEADERBOARD_TEXT: markdown(board, study),
    }


def check_boards(submission: Submission, table: pd.DataFrame, study: Study) -> None:
    """Refuse a leaderboard that does not follow from the rows."""
    try:
        made = board_files(table, study)
    except (ValueError, TypeError, IndexError, KeyError) as error:  # such as weights of other games
        raise UserError(
            f"{submission.folder / ROWS}: no table can be made of its rows: {error}"
        ) from error
    for name, text in made.items():
        place = submission.folder / name
        if name not in submission.files:
            raise UserError(f"{place} is missing")
        try:
            stated = read_file(submission.folder, name).decode("utf-8")
            differs = _difference(stated, text) if name == LEADERBOARD else stated != text
        except (ValueError, csv.Error) as error:
            raise UserError(f"{place} cannot be read: {error}") from error
        if differs:
            where = f": see {differs}" if isinstance(differs, str) else ""
            raise UserError(f"{place} is not the leaderboard of the rows beside it{where}")


def _difference(stated: str, made: str) -> str | bool:
    """The column in which two tables differ; whether they do, if it is more than a column."""
    there, here = (list(csv.reader(io.StringIO(text, newline=""))) for text in (stated, made))
    if len(there) != len(here) or there[0] != here[0]:
        return True
    for one, other in zip(there[1:], here[1:], strict=True):
        if len(one) != len(other):
            return True
        for name, a, b in zip(here[0], one, other, strict=True):
            if not _alike(a, b):
                return name
    return False


def _alike(stated: str, made: str) -> bool:
    if stated == made:
        return True
    try:
        return math.isclose(float(stated), float(made), rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)
    except ValueError:
        return False
