"""Tables of a submission follow from its rows."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from olne_bench.bench.report.study import USUAL
from olne_bench.bench.submission import boards
from olne_bench.bench.submission.boards import check_boards
from olne_bench.errors import UserError

TABLE = "estimator,error\na,1.0\nb,\n"
NOTHING = pd.DataFrame()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    made = {"leaderboard.csv": TABLE, "leaderboard.md": "| a |\n"}
    monkeypatch.setattr(boards, "board_files", lambda *_: made)
    for name, text in made.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def check(folder: Path, files: Any = ("leaderboard.csv", "leaderboard.md")) -> None:
    submission: Any = SimpleNamespace(folder=folder, files=files)
    check_boards(submission, NOTHING, USUAL)


@pytest.mark.parametrize(
    "text", [TABLE, TABLE.replace("1.0", "1.0000001"), TABLE.replace("\n", "\r\n")]
)
def test_tables_are_equal_but_for_last_digits(folder: Path, text: str) -> None:
    (folder / "leaderboard.csv").write_text(text, newline="")
    check(folder)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TABLE.replace("1.0", "1.1"), "is not the leaderboard of the rows beside it: see error"),
        (TABLE.replace("1.0", ""), "see error"),
        (TABLE.replace("1.0", "nan"), "see error"),
        (TABLE.replace("a,1", "c,1"), "see estimator"),
        (TABLE + "c,2\n", "is not the leaderboard"),
        (TABLE.replace("error", "cost"), "is not the leaderboard"),
        (TABLE.replace("b,", "b,2,3"), "is not the leaderboard"),
        ("", "is not the leaderboard"),
        ("," * 1_000_000, "is not the leaderboard"),
        ('"' + "x" * 200_000, "cannot be read"),
        ("\0", "is not the leaderboard"),
    ],
)
def test_others_are_refused_in_one_line(folder: Path, text: str, said: str) -> None:
    (folder / "leaderboard.csv").write_text(text)
    with pytest.raises(UserError, match=said) as caught:
        check(folder)
    assert "\n" not in str(caught.value)


def test_the_text_is_the_same_and_utf_8(folder: Path) -> None:
    (folder / "leaderboard.md").write_text("| b |\n")
    with pytest.raises(UserError, match="leaderboard.md is not the leaderboard of the rows"):  # noqa: RUF043
        check(folder)
    (folder / "leaderboard.md").write_bytes(b"\xff")
    with pytest.raises(UserError, match="leaderboard.md cannot be read"):  # noqa: RUF043
        check(folder)
    with pytest.raises(UserError, match="leaderboard.md is missing"):  # noqa: RUF043
        check(folder, ("leaderboard.csv",))


@pytest.mark.parametrize("error", [ValueError, TypeError, IndexError, KeyError])
def test_rows_of_which_no_table_can_be_made(folder: Path, monkeypatch, error: type) -> None:
    def broken(*_: object) -> dict[str, str]:
        raise error("cannot reshape array")

    monkeypatch.setattr(boards, "board_files", broken)
    with pytest.raises(UserError, match="no table can be made of its rows: .*cannot reshape"):  # noqa: RUF043
        check(folder)
