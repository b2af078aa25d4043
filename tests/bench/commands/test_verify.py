"""What ``olne-bench verify`` asks for, says, and ends with."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.submission.again import Repeated
from olne_bench.bench.submission.drawn import DrawnErrors
from olne_bench.bench.submission.fresh import LEVEL, FreshErrors
from olne_bench.bench.submission.verify import Limits, Verdict

module = import_module("olne_bench.bench.commands.verify")

FRESH = FreshErrors("mine", "position_error", 12, 0.1234, 0.25, 0.5, decides=True)
DRAWN = DrawnErrors("mine", "merge", 12, 10.0, 38.4, 0.0596, 0.00183)
GOOD = Verdict(30, Repeated(same=12), fresh=[FRESH])


def call(*words: object) -> int:
    """The exit code of a command."""
    try:
        main([str(word) for word in ("verify", *words)])
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.fixture
def checked(monkeypatch) -> list[tuple[Path, Limits]]:
    """What was checked; folders that are called bad are refused."""
    asked: list[tuple[Path, Limits]] = []

    def check(folder: Path, limits: Limits) -> Verdict:
        asked.append((folder, limits))
        return (
            replace(GOOD, repeated=Repeated(differing=["a row"])) if folder.name == "bad" else GOOD
        )

    monkeypatch.setattr(module, "check", check)
    return asked


def lines(verdict: Verdict) -> list[str]:
    first, *rest = module._lines(Path("mine"), verdict, 7)
    assert first == f"mine: {verdict.rows} rows, complete; the leaderboard matches them"
    return [line.strip() for line in rest]


def test_every_folder_is_checked_within_the_limits_that_were_given(checked, capsys):
    words = ("one", "two", "--sample", 3, "--seed", 5, "--jobs", 4, "--memory", 1.5, "--strict")
    assert call(*words) == 0
    limits = Limits(3, 5, 4, 3 * 2**29, strict=True)
    assert checked == [(Path("one"), limits), (Path("two"), limits)]
    said = capsys.readouterr().out
    assert said.count("accepted (sample of seed 5)") == 2


def test_the_sample_is_another_every_time_and_told(checked, capsys):
    assert call("one") == 0
    assert call("one") == 0
    seeds = [limits.seed for _, limits in checked]
    assert seeds[0] != seeds[1]
    assert f"(sample of seed {seeds[0]})" in capsys.readouterr().out
    assert call("one", "--seed", 0) == 0
    assert checked[-1][1].seed == 0  # which is a seed as well
    assert not checked[-1][1].strict
    assert checked[-1][1].sample is None


@pytest.mark.parametrize(
    ("folders", "code"),
    [(["one"], 0), (["bad"], 1), (["one", "bad"], 1), (["bad", "one"], 1), (["one", "one"], 0)],
)
def test_all_have_to_be_accepted(checked, folders, code):
    assert call(*folders) == code
    assert [folder.name for folder, _ in checked] == folders


@pytest.mark.parametrize(
    ("option", "value", "code"),
    [
        ("--sample", 1, 0),
        ("--sample", 0, 2),
        ("--sample", 10**6, 0),
        ("--sample", 10**6 + 1, 2),
        ("--seed", -1, 2),
    ],
)
def test_numbers_have_limits(checked, option, value, code):
    assert call("one", option, value) == code
    assert len(checked) == (code == 0)


def test_a_page_shows_who_was_accepted(checked, monkeypatch, tmp_path, capsys):
    shown = []
    page = import_module("olne_bench.bench.submission.accepted_page")
    monkeypatch.setattr(module, "read_submission", lambda folder: folder.name)
    monkeypatch.setattr(page, "accepted_page", lambda found: shown.extend(found) or "a page")
    place = tmp_path / "page.html"
    assert call("bad", "--page", place) == 1
    assert not place.exists()  # there is nothing to show
    assert call("one", "bad", "--page", place) == 1
    assert place.read_text() == "a page"
    assert f"{place}: 1 accepted" in capsys.readouterr().out
    (one,) = shown
    assert "12 rows run again, all the same; 12 trials with fresh salts" in str(one)
    fixed = module._summary(replace(GOOD, fixed=("two_player",)))
    assert fixed.endswith("; not rankable where truths are fixed: two_player")
    asked = len(checked)
    assert call("one", "--page", place) == 2  # it exists by now
    assert call("one", "--page", tmp_path / "page.txt") == 2
    assert len(checked) == asked


def test_what_was_found_is_told_line_by_line():
    assert lines(GOOD) == [
        "12 of 12 rows run again are the same, bit by bit",
        "fresh salt  mine: median position_error 0.123 submitted, 0.25 in 12 fresh trials, p = 0.5",
        "accepted (sample of seed 7)",
    ]
    few = Confirmation(
        "two_way", "full", "mine", "", Versions(), (0.1,), 3, 20, "position_error", 0.01, 0.1, 1,
        confirmed=False
    )  # fmt: skip
    mixed = replace(GOOD, repeated=Repeated(12, ["x", "y"], 3), because="numpy", implausible=[few])
    assert lines(mixed)[:7] == [
        "of other versions, compared within 0.1 %: numpy",
        "12 of 17 rows run again are the same, within 0.1 %",
        "3 rows reached their time limit and were not compared",
        "DIFFERS  x",
        "DIFFERS  y",
        "to see whether versions are the reason, run again with those that are here",
        "IMPLAUSIBLE  mine in two_way, full: 3 rows far below the statistical limit, not "
        "confirmed: 0.1 m on fresh draws, 0.01 m here",
    ]
    assert lines(mixed)[-1] == "refused (sample of seed 7)"


@pytest.mark.parametrize(("number", "shown"), [(4, 4), (5, 5), (6, 5), (25, 5)])
def test_a_few_rows_that_differ_stand_for_all(number, shown):
    said = lines(replace(GOOD, repeated=Repeated(1, ["x"] * number)))
    assert said.count("DIFFERS  x") == shown
    assert (f"and {number - shown} more" in said) == (number > shown)
    unjudged = lines(replace(GOOD, unjudged=["x"] * number))
    assert unjudged.count("NOT JUDGED  x") == shown
    assert unjudged[-1].startswith("refused")


def test_fresh_errors_that_are_too_large_are_told():
    bad, few = replace(FRESH, p=LEVEL / 2), replace(FRESH, decides=False)
    assert "TOO GOOD  mine" in lines(replace(GOOD, fresh=[bad]))[1]
    assert lines(replace(GOOD, fresh=[bad]))[-1].startswith("refused")
    assert "TOO FEW  mine has too few draws to tell" in lines(replace(GOOD, fresh=[few]))[1]
    assert lines(replace(GOOD, fresh=[few]))[-1].startswith("refused")


def test_fixed_truths_are_told_and_who_knows_them():
    fixed = replace(GOOD, fresh=[], drawn=[DRAWN], fixed=("merge", "two_player"))
    assert lines(fixed)[1:] == [
        "drawn truths  mine in merge: median error 0.0596 on 12 drawn truths, 0.00183 of "
        "kkt_constrained; ratio 38, and 10 on the fixed ones",
        "NOT RANKABLE  fixed truths, which everyone can look up: merge, two_player",
        "accepted (sample of seed 7)",
    ]
    known = lines(replace(fixed, drawn=[replace(DRAWN, fixed=1e-9)]))
    assert known[1].startswith("KNOWS THE TRUTH  mine in merge: ")
    assert known[-1].startswith("refused")
    none = lines(replace(fixed, drawn=[replace(DRAWN, trials=0)]))
    assert none[1] == "drawn truths  mine in merge: there are none of this scenario"


def test_where_nothing_could_be_compared_nothing_is_accepted():
    empty = lines(replace(GOOD, repeated=Repeated(silent=3)))
    assert "NOTHING  could be compared" in empty
    assert empty[-1].startswith("refused")
    assert "NOTHING  could be compared" not in lines(GOOD)
