"""The page's address keeps what is shown, and restores it."""

from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Page, expect


def address_of(tab: Page) -> str:
    """The present address: ``tab.url`` is updated a little later."""
    return str(tab.evaluate("location.href"))


def told(tab: Page) -> dict[str, list[str]]:
    return parse_qs(urlsplit(address_of(tab)).fragment)


def state(tab: Page) -> dict[str, object]:
    """The visible sort order, filter and choice."""
    chips = "#sensors button, #estimators button"
    return {
        "rows": tab.locator("#board tbody tr:not([hidden])").all_inner_texts(),
        "sorted": tab.locator("#board [aria-sort]").all_inner_texts(),
        "chips": [c.get_attribute("aria-pressed") for c in tab.locator(chips).all()],
        "scenario": tab.locator("#scenario").input_value(),
        "trial": tab.locator("#trial").input_value(),
        "sensor": tab.locator("#trial-sensor").input_value(),
        "clock": tab.locator("#clock").inner_text(),
        "pair": tab.locator("#pair-error").input_value(),
    }


def test_nothing_chosen_leaves_the_address_bare(tab: Page) -> None:
    assert urlsplit(address_of(tab)).fragment == ""


def test_all_that_is_chosen_comes_back(tab: Page) -> None:
    at_first = state(tab)
    tab.locator("#board thead th button", has_text="Cosine error").first.click()
    tab.locator("#board thead th button", has_text="Cosine error").first.click()
    tab.fill("#filter", "player & kkt")
    tab.fill("#filter", "player")
    tab.select_option("#board-sensor", "partial")
    tab.select_option("#scenario", label="two_player")
    tab.locator("#estimators button", has_text="kkt_constrained").click()
    tab.locator("#sensors button", has_text="full").click()
    tab.select_option("#trial", index=4)
    tab.select_option("#trial-sensor", "partial")
    tab.locator("#time").fill("3")
    tab.select_option("#pair-error", "cosine_error")
    chosen, address = state(tab), address_of(tab)
    assert chosen != at_first
    assert chosen["sorted"] == ["Cosine error"]
    assert told(tab)["sort"] == ["-Cosine error"]
    assert told(tab)["without"] == ["kkt_constrained"]
    tab.goto("about:blank")
    tab.goto(address)
    assert state(tab) == chosen
    tab.evaluate("location.hash = ''")
    expect(tab.locator("#filter")).to_have_value("")
    assert state(tab) == at_first


@pytest.mark.parametrize(
    "fragment",
    ["scenario=gone&sort=nothing&sigma=9&seed=x&step=-4&pair=?", "%F0", "a=%E0%A4%A", "x"],
)
def test_an_address_that_says_nothing_is_no_harm(tab: Page, fragment: str) -> None:
    usual, place = state(tab), address_of(tab)
    tab.goto("about:blank")
    tab.goto(f"{place}#{fragment}")
    shown = state(tab)
    assert shown["rows"] == usual["rows"]
    assert shown["scenario"] == usual["scenario"]


def test_sections_are_part_of_the_address(tab: Page) -> None:
    tab.locator("nav a", has_text="Trajectories").click()
    assert told(tab) == {"at": ["trajectories"]}
    assert tab.evaluate("document.activeElement.id") == "trajectories"
    expect(tab.locator("#trajectories h2")).to_be_in_viewport()
    tab.fill("#filter", "two")
    assert told(tab) == {"at": ["trajectories"], "filter": ["two"]}


def test_a_plain_section_still_leads_there(tab: Page) -> None:
    tab.evaluate("location.hash = '#methods'")
    expect(tab.locator("#methods h2")).to_be_in_viewport()
