"""The page of accepted submissions, in a browser."""

from pathlib import Path

import pandas as pd
import pytest
from playwright.sync_api import Browser, Page, expect

from olne_bench.bench.submission.accepted_page import Accepted, accepted_page
from olne_bench.bench.submission.manifest import read_submission

EXAMPLE = Path(__file__).parents[3] / "results/submissions/tempered_residual"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("accepted") / "index.html"
    found = Accepted(read_submission(EXAMPLE), "20 rows run again, all the same")
    path.write_text(accepted_page([found]), encoding="utf-8")
    return path


def open_page(browser: Browser, address: str, width: int = 1280) -> tuple[Page, list[str]]:
    complaints: list[str] = []
    tab = browser.new_context(viewport={"width": width, "height": 900}).new_page()
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.goto(address)
    return tab, complaints


def test_rows_are_those_of_the_submission(browser: Browser, place: Path) -> None:
    tab, complaints = open_page(browser, place.as_uri())
    board = pd.read_csv(EXAMPLE / "leaderboard.csv")
    assert tab.locator("#board tbody tr").count() == len(board)
    own = tab.locator("#board tbody tr:not(.floor) th").all_inner_texts()
    assert set(own) == {"tempered_residual"}
    card = tab.locator(".cards article")
    assert card.locator("h3").all_inner_texts() == ["tempered_residual"]
    assert "Rothfuss" in card.first.inner_text()
    assert "20 rows run again, all the same" in tab.locator("#provenance").inner_text()
    with tab.expect_download() as told:
        tab.locator('button[data-table="accepted"]').click()
    assert len(pd.read_csv(told.value.path())) == len(board)
    assert complaints == []


def test_sort_and_filter_come_back_with_the_address(browser: Browser, place: Path) -> None:
    tab, complaints = open_page(browser, place.as_uri())
    tab.locator("#board thead th button", has_text="Cosine error").click()
    tab.fill("#filter", "tempered_residual quick two")
    tab.select_option("#board-sensor", "partial")
    shown = tab.locator("#board tbody tr:not([hidden])").all_inner_texts()
    assert len(shown) == 3  # the filter looks at names of submissions, too
    again, more = open_page(browser, tab.evaluate("location.href"))
    assert again.locator("#board tbody tr:not([hidden])").all_inner_texts() == shown
    assert again.locator("[aria-sort=ascending]").inner_text() == "Cosine error"
    again.evaluate("location.hash = ''")
    expect(again.locator("#filter")).to_have_value("")
    assert complaints == more == []


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_cut(browser: Browser, place: Path, width: int) -> None:
    tab, complaints = open_page(browser, place.as_uri(), width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert complaints == []
