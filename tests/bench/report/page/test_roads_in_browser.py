"""The page of a road in a real browser: drawn as HighwayEnv does, and complete on paper."""

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page
from scipy.ndimage import center_of_mass, label, sum_labels

from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate

_OVERFLOW = (
    "[...document.querySelectorAll('#board > .scroll')].map(e => e.scrollWidth - e.clientWidth)"
)


@pytest.fixture(scope="module")
def road_page(
    road_trials: pd.DataFrame, road_study: Study, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("road") / "index.html"
    # Rows as good as these would be implausible.
    others = [[row[::-1] for row in weights] for weights in road_trials["weights"]]
    usual = road_trials.assign(position_error=0.02, cosine_error=0.02, weights=others)
    tables = tabulate(usual, road_study)
    path.write_text(render_page(road_trials, tables, [], road_study).html, encoding="utf-8")
    return path


@pytest.fixture
def tab(browser: Browser, road_page: Path) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab = context.new_page()
    complaints: list[str] = []
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.goto(road_page.as_uri())
    yield tab
    context.close()
    assert complaints == []


def dark_spots(picture: bytes, number: int) -> np.ndarray:
    """Centres (number, 2) [pixels], across and down, of the largest dark areas."""
    grey = np.asarray(Image.open(io.BytesIO(picture)).convert("L"))
    areas, count = label(grey < 60)
    sizes = sum_labels(grey < 60, areas, np.arange(1, count + 1))
    largest = 1 + np.argsort(sizes)[-number:]
    return np.array(center_of_mass(grey < 60, areas, largest))[:, ::-1]


def test_cars_lie_as_in_highway_envs_own_picture(tab: Page, road_frame) -> None:
    tab.locator("#time").focus()
    tab.keyboard.press("Home")
    first, second = sorted(dark_spots(tab.locator("#player").screenshot(), 2).tolist())
    ours = np.array(second) - first
    theirs = np.subtract(*sorted(road_frame[1].tolist(), reverse=True))
    np.testing.assert_allclose(ours / np.hypot(*ours), theirs / np.hypot(*theirs), atol=0.05)


def test_every_column_fits_the_screen(tab: Page) -> None:
    assert max(tab.evaluate(_OVERFLOW)) <= 0
    assert tab.evaluate("document.documentElement.scrollWidth") <= 1280


def test_every_column_fits_the_paper(browser: Browser, road_page: Path) -> None:
    """The width of A4 at 96 pixels per inch, without its margins of 9 mm."""
    context = browser.new_context(viewport={"width": 1054, "height": 726})
    tab = context.new_page()
    tab.emulate_media(media="print")
    tab.goto(road_page.as_uri())
    assert max(tab.evaluate(_OVERFLOW)) <= 0
    assert tab.evaluate("document.documentElement.scrollWidth") <= 1054
    pages = tab.pdf(prefer_css_page_size=True)
    boxes = re.findall(rb"/MediaBox \[\s*0 0 ([0-9.]+) ([0-9.]+)", pages)
    assert boxes
    assert all(float(width) > 800 > float(height) for width, height in boxes)
    context.close()


def test_one_draw_tells_nobody_apart(tab: Page) -> None:
    assert "too few to tell estimators apart" in tab.locator(".verdict").inner_text()
