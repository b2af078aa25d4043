"""The page in a real browser, as a reader would use it."""

import io
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

HOSTILE = "<img src=x onerror=\"document.title='broken'\"></script><b>&"


def column(tab: Page, number: int) -> list[str]:
    cells = tab.locator(f"#board tbody tr:not([hidden]) > :nth-child({number})")
    return [text.strip() for text in cells.all_inner_texts()]


def keys(tab: Page, label: str) -> list[float]:
    cells = tab.locator(f'#board tbody tr:not([hidden]) > [data-label="{label}"]')
    return [float(cell.get_attribute("data-key") or "nan") for cell in cells.all()]


def pixels(tab: Page, selector: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(tab.locator(selector).screenshot())).convert("RGB"))


def test_sorting(tab: Page) -> None:
    given = keys(tab, "Position error [m]")
    head = tab.locator("#board thead th", has_text="Position error [m]").first
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert keys(tab, "Position error [m]") == sorted(given) != given
    head.locator("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert keys(tab, "Position error [m]") == sorted(given, reverse=True)
    tab.locator("#board thead th button", has_text="Scenario").click()
    assert column(tab, 1) == ["highway_overtaking"] * 6 + ["two_player"] * 6


def test_filtering(tab: Page) -> None:
    assert len(column(tab, 1)) == 12
    tab.fill("#filter", "two_player KKT")
    assert column(tab, 3) == ["kkt_constrained"] * 2
    assert tab.locator("#board-count").inner_text() == "2 of 12 rows"
    tab.select_option("#board-sensor", "partial")
    assert column(tab, 2) == ["partial"]
    tab.fill("#filter", "")
    assert len(column(tab, 1)) == 6
    assert HOSTILE in column(tab, 3)


def test_who_comes_first_is_said_before_all_else(tab: Page) -> None:
    cards = tab.locator(".verdicts article")
    assert cards.locator("h3").all_inner_texts() == ["highway_overtaking", "two_player"]
    first = cards.first.locator("dd").first.inner_text()
    assert re.match(r"(kkt_constrained|<img).* [0-9.]+\sm", first)


def test_a_phone_shows_the_main_numbers_and_the_others_on_demand(
    browser: Browser, page: Path
) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844})
    tab = context.new_page()
    tab.goto(page.as_uri())
    minor = tab.locator("#board tbody tr >> nth=0").locator(".minor").first
    assert minor.is_hidden()
    tab.locator("#board-all").click()
    assert minor.is_visible()
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    context.close()


def test_slider_and_player(tab: Page) -> None:
    end = pixels(tab, "#player")
    assert tab.locator("#values tbody tr").count() == 3
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
    tab.select_option("#trial", index=5)
    assert "crash" in tab.locator("#values").inner_text()


def test_picking_estimators_and_scenarios(tab: Page) -> None:
    both = pixels(tab, "#chart-position_error")
    assert tab.locator("#bundles figure").count() == 5
    chip = tab.locator("#estimators button", has_text="kkt_constrained")
    chip.click()
    assert chip.get_attribute("aria-pressed") == "false"
    assert tab.locator("#bundles figure").count() == 3
    assert (pixels(tab, "#chart-position_error") != both).any()
    tab.select_option("#scenario", label="two_player")
    assert tab.locator("#weights tbody tr:not([hidden])").count() == 16
    assert tab.locator("#clock").inner_text() == "6 / 6 s"


def test_values_on_hover_and_by_keyboard(tab: Page) -> None:
    tab.locator("#chart-position_error").scroll_into_view_if_needed()
    tab.locator("#chart-position_error").focus()
    tab.keyboard.press("ArrowRight")
    said = tab.locator("#tip").inner_text()
    assert "σ = " in said and "position error" in said
    tab.keyboard.press("ArrowRight")
    assert tab.locator("#tip").inner_text() != said
    tab.keyboard.press("Escape")
    assert tab.locator("#tip").is_hidden()
    box = tab.locator("#chart-cosine_error").bounding_box()
    assert box is not None
    found = False
    for x, y in product(np.arange(0.2, 0.9, 0.05), np.arange(0.1, 0.9, 0.05)):
        tab.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
        found = found or tab.locator("#tip").is_visible()
    assert found


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
    for selector in (
        "#chart-cosine_error",
        "#chart-position_error",
        "#player",
        "#bundles canvas >> nth=1",
    ):
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


def test_print_shows_all_that_a_card_says(browser: Browser, page: Path) -> None:
    context = browser.new_context(viewport={"width": 1054, "height": 726})
    tab = context.new_page()
    tab.goto(page.as_uri())
    tab.emulate_media(media="print")
    cut = "(e) => e.scrollWidth > e.clientWidth"
    assert not tab.evaluate(f"[...document.querySelectorAll('pre, .scroll')].some({cut})")
    assert tab.locator("button:visible").count() == tab.locator("#board th button").count()
    context.close()


def test_draws_won_of_all_scenarios_are_always_shown(tab: Page) -> None:
    def shown() -> list[tuple[str, str]]:
        rows = tab.locator("#win-table tbody tr:visible")
        told = rows.evaluate_all("rows => rows.map((r) => [r.dataset.scenario, r.dataset.error])")
        return [tuple(pair) for pair in told]

    assert shown() == [
        (name, "position_error") for name in ("", "highway_overtaking") for _ in "abc"
    ]
    tab.select_option("#scenario", label="two_player")
    tab.select_option("#pair-error", "cosine_error")
    assert shown() == [(name, "cosine_error") for name in ("", "two_player") for _ in "abc"]
