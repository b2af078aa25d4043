"""The page of accepted submissions, in a browser."""

from pathlib import Path

import pandas as pd
import pytest
from playwright.sync_api import Browser, Page

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
    rows = tab.locator("#leaderboard tbody tr")
    assert rows.count() == len(board)
    own = tab.locator("#leaderboard tbody tr:not(.floor) td:nth-child(3)").all_inner_texts()
    assert set(own) == {"tempered_residual"}
    card = tab.locator(".cards article")
    assert card.locator("h3").all_inner_texts() == ["tempered_residual"]
    assert "Rothfuss" in card.first.inner_text()
    assert "20 rows run again, all the same" in tab.locator("#leaderboard").inner_text()
    tab.locator("#leaderboard thead th button", has_text="Cosine error").click()
    assert tab.locator("[aria-sort=ascending]").count() == 1
    with tab.expect_download() as told:
        tab.locator('button[data-table="accepted"]').click()
    assert len(pd.read_csv(told.value.path())) == len(board)
    assert complaints == []


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_cut(browser: Browser, place: Path, width: int) -> None:
    tab, complaints = open_page(browser, place.as_uri(), width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert complaints == []
