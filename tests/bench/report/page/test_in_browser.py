"""The page in a real browser, as a reader would use it."""

import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from olne_bench.bench.report.tables import tabulate

HOSTILE = "<img src=x onerror=\"document.title='broken'\"></script><b>&"


BOARD = "#board table >> nth=0"


def column(tab: Page, number: int, table: str = BOARD) -> list[str]:
    cells = tab.locator(f"{table} >> tbody tr:not([hidden]) > :nth-child({number})")
    return [text.strip() for text in cells.all_inner_texts()]


def pixels(tab: Page, selector: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(tab.locator(selector).screenshot())).convert("RGB"))


def test_sorting(tab: Page) -> None:
    assert column(tab, 1)[-1].startswith("uniform")
    head = tab.locator(f"{BOARD} >> thead th", has_text="Time")
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    head.locator("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    tab.locator(f"{BOARD} >> thead th button", has_text="Estimator").click()
    assert column(tab, 1) == sorted(column(tab, 1), key=str.lower)
    tab.locator(f"{BOARD} >> thead th button", has_text="Score").click()
    scores = [float(text.split()[0]) for text in column(tab, 2)]
    assert scores == sorted(scores)


def test_the_verdict_and_the_score_come_before_all_else(tab: Page) -> None:
    assert "has the smallest position errors" in tab.locator(".verdict").inner_text()
    assert tab.locator(f"{BOARD} >> thead th").count() == 5
    tables = tab.locator("#board details table")
    assert tables.first.is_hidden()
    tab.locator("#board details > summary").last.click()
    assert tables.first.is_visible()
    assert HOSTILE in tables.first.inner_text()


def test_tables_are_those_of_the_run_folder(tab: Page, small_study, usual) -> None:
    tab.locator("#board details > summary").last.click()
    tables = tabulate(small_study, usual).by_name()
    for name in ("scores", "leaderboard", "comparisons"):
        with tab.expect_download() as told:
            tab.locator(f'button[data-table="{name}"]').first.click()
        read = pd.read_csv(told.value.path())
        assert told.value.suggested_filename == f"{name}.csv"
        assert list(read) == list(tables[name]) and len(read) == len(tables[name])


def test_an_address_leads_to_a_trial(browser: Browser, page: Path) -> None:
    tab = browser.new_page()
    tab.goto(f"{page.as_uri()}#scenario=two_player&sigma=0.01&seed=0&seen=partial&step=3")
    assert tab.locator("#scenario").input_value() == "two_player"
    assert "σ = 0.01" in tab.locator("#trial option:checked").inner_text()
    assert tab.locator("#trial-sensor").input_value() == "partial"
    assert tab.locator("#time").input_value() == "3"
    tab.select_option("#scenario", label="highway_overtaking")
    assert "scenario=highway_overtaking" in tab.url
    tab.close()


def test_slider_and_player(tab: Page) -> None:
    end = pixels(tab, "#player")
    tab.locator(".stage details > summary").click()
    assert tab.locator("#values tbody tr").count() == 2
    tab.locator("#time").focus()
    tab.keyboard.press("Home")
    assert tab.locator("#clock").inner_text() == "0 / 19 s"
    assert {float(x) for x in tab.locator("#values td:nth-child(2)").all_inner_texts()} == {0.0}
    start = pixels(tab, "#player")
    assert (start != end).any()
    tab.keyboard.press("ArrowRight")
    assert tab.locator("#clock").inner_text() == "1 / 19 s"
    tab.locator("#play").click()
    expect(tab.locator("#clock")).to_have_text(re.compile("^[3-9] / 19 s"))
    tab.locator("#play").click()


def test_picking_estimators_and_scenarios(tab: Page) -> None:
    both = pixels(tab, "#player")
    tab.locator(".stage details > summary").click()
    chip = tab.locator("#estimators button", has_text="kkt_constrained")
    assert chip.get_attribute("aria-pressed") == "true"
    chip.click()
    assert chip.get_attribute("aria-pressed") == "false"
    assert tab.locator("#values tbody tr").count() == 1
    assert (pixels(tab, "#player") != both).any()
    tab.locator("#figures details > summary").first.click()
    assert tab.locator("#figures table >> nth=0 >> tbody tr:not([hidden])").count() == 2 * 5 * 4
    tab.select_option("#scenario", label="two_player")
    assert tab.locator("#figures table >> nth=0 >> tbody tr:not([hidden])").count() == 16
    assert tab.locator("#figures h2").inner_text() == "Figures of two_player"
    assert tab.locator("#plots figure").count() == 4
    assert tab.locator("#clock").inner_text() == "6 / 6 s"


@pytest.mark.parametrize("width", [390, 1200])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_looks(browser: Browser, page: Path, width: int, scheme: str) -> None:
    context = browser.new_context(
        viewport={"width": width, "height": 844},
        color_scheme=scheme,  # type: ignore[arg-type]
    )
    tab = context.new_page()
    tab.goto(page.as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    background = pixels(tab, "header").mean()
    assert background > 200 if scheme == "light" else background < 90
    for selector in ("#player", "#board .plot", "#plots figure >> nth=1"):
        shown = pixels(tab, selector)
        colours = np.unique(shown.reshape(-1, 3), axis=0)
        assert len(colours) > 50, f"{selector} is blank"
    context.close()


def test_paper_is_white_whatever_the_theme(browser: Browser, page: Path) -> None:
    context = browser.new_context(viewport={"width": 1200, "height": 844}, color_scheme="dark")
    tab = context.new_page()
    tab.goto(page.as_uri())
    on_screen = pixels(tab, "#player").mean()
    tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert pixels(tab, "header").mean() > 200
    assert pixels(tab, "#player").mean() > 200 > on_screen
    tab.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert pixels(tab, "#player").mean() < 90
    context.close()


def test_print_cuts_nothing(browser: Browser, page: Path) -> None:
    context = browser.new_context(viewport={"width": 1054, "height": 726})
    tab = context.new_page()
    tab.goto(page.as_uri())
    tab.emulate_media(media="print")
    cut = "(e) => e.scrollWidth > e.clientWidth + 1"
    assert not tab.evaluate(f"[...document.querySelectorAll('pre, .scroll, .plot')].some({cut})")
    assert tab.locator("select:visible, #play:visible, nav:visible").count() == 0
    shown = tab.locator(".chips button:visible .swatch")
    assert shown.count() == tab.locator(".chips button[aria-pressed=true]").count() > 0
    exact = "(e) => getComputedStyle(e).printColorAdjust"
    assert shown.first.evaluate(exact) == "exact"
    context.close()
