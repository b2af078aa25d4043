"""A click on a point of a chart plays its trial."""

import re
from itertools import product

import numpy as np
from playwright.sync_api import Browser, Page, expect


def chosen_trial(tab: Page) -> str:
    return tab.locator("#trial option:checked").inner_text()


def test_by_keyboard(tab: Page) -> None:
    tab.locator("#chart-position_error").focus()
    for _ in range(3):
        tab.keyboard.press("ArrowRight")
    said = tab.locator("#tip").inner_text()
    assert "click, or Enter: play it" in said
    tab.keyboard.press("Enter")
    assert chosen_trial(tab) in said  # noise level and seed
    assert tab.evaluate("document.activeElement.id") == "play"
    expect(tab.locator("#clock")).to_have_text(re.compile("^19 / 19 s"), timeout=20_000)
    address = tab.evaluate("location.hash")
    assert "at=trajectories" in address and "seed=" in address


def test_by_mouse_with_its_own_sensor(tab: Page) -> None:
    tab.emulate_media(reduced_motion="reduce")
    tab.locator("#sensors button", has_text="full").click()
    box = tab.locator("#chart-cosine_error").bounding_box()
    assert box is not None
    for x, y in product(np.arange(0.2, 0.9, 0.02), np.arange(0.1, 0.9, 0.05)):
        tab.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
        said = tab.locator("#tip").inner_text() if tab.locator("#tip").is_visible() else ""
        if "play it" in said:
            break
    tab.mouse.down()
    tab.mouse.up()
    assert chosen_trial(tab) in said
    assert tab.locator("#trial-sensor").input_value() == "partial"
    assert tab.locator("#clock").inner_text() == "19 / 19 s"


def test_a_finger_points_first_and_plays_then(browser: Browser, page) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    tab = context.new_page()
    tab.goto(page.as_uri())
    chart = tab.locator("#chart-position_error")
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    assert box is not None
    for x, y in product(np.arange(0.25, 0.95, 0.05), np.arange(0.1, 0.9, 0.1)):
        at = (box["x"] + x * box["width"], box["y"] + y * box["height"])
        tab.touchscreen.tap(*at)
        if tab.locator("#tip").is_visible():
            break
    said = tab.locator("#tip").inner_text()
    assert "at=trajectories" not in tab.evaluate("location.hash")
    tab.touchscreen.tap(*at)
    assert "at=trajectories" in tab.evaluate("location.hash")
    assert chosen_trial(tab) in said
    context.close()


def test_true_and_estimated_weights_stand_below(tab: Page) -> None:
    tab.select_option("#scenario", label="two_player")
    head = tab.locator("#estimates thead th").all_inner_texts()
    assert head[:4] == ["Player", "Weight", "Truth", "kkt_constrained"]
    assert tab.locator("#estimates tbody tr").count() == 2 * 4
    cells = tab.locator("#estimates tbody tr:nth-child(-n+4) td:nth-child(3)").all_inner_texts()
    assert sum(map(float, cells)) == 1.0
    uniform = tab.locator("#estimates tbody td:last-child").all_inner_texts()
    assert set(uniform) == {"0.250"}
