"""What is saved from the page: tables, figures, an animated GIF."""

import io
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page

from olne_bench.bench.report import page as page_package
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate

SCRIPTS = Path(str(page_package.__file__)).parent / "script"
SVG = "{http://www.w3.org/2000/svg}"


def saved(tab: Page, button: Locator) -> tuple[str, bytes]:
    """Click a button; return name and content of the file that it saves."""
    with tab.expect_download() as told:
        button.click()
    return told.value.suggested_filename, Path(told.value.path()).read_bytes()


def test_tables_are_those_of_the_run_folder(
    tab: Page, small_study: pd.DataFrame, usual: Study
) -> None:
    tables = tabulate(small_study, usual).by_name()
    for name in ("leaderboard", "comparisons", "identifiability", "bound_ratios"):
        file, content = saved(tab, tab.locator(f'button[data-table="{name}"]'))
        assert file == f"{name}.csv"
        read = pd.read_csv(io.BytesIO(content))
        assert list(read.columns) == list(tables[name].columns)
        assert len(read) == len(tables[name])
    expected = tables["leaderboard"]["cosine_error_median"]
    _, content = saved(tab, tab.locator('button[data-table="leaderboard"]'))
    read = pd.read_csv(io.BytesIO(content))["cosine_error_median"]
    np.testing.assert_array_equal(read.to_numpy(float), expected.to_numpy(float))


@pytest.mark.parametrize(
    ("place", "file", "texts"),
    [
        ("#errors figure >> nth=0", "position_error-highway_overtaking", ["kkt_constrained, full"]),
        ("#player-saves", "trial-highway_overtaking-full-sigma=", ["truth (dashed)", "observed"]),
        ("#bundles figure >> nth=1", "trajectories-highway_overtaking-", ["player 1", "player 5"]),
    ],
)
def test_figures(tab: Page, place: str, file: str, texts: list[str]) -> None:
    holder = tab.locator(place)
    name, svg = saved(tab, holder.get_by_label("as SVG"))
    assert name.startswith(file) and name.endswith(".svg")
    root = ElementTree.fromstring(svg)
    found = ["".join(node.itertext()) for node in root.iter(f"{SVG}text")]
    assert set(texts) <= set(found)
    assert any("highway_overtaking" in text for text in found)
    assert len(list(root.iter(f"{SVG}path"))) > 20
    name, png = saved(tab, holder.get_by_label("as PNG"))
    assert name.startswith(file) and name.endswith(".png")
    image = Image.open(io.BytesIO(png)).convert("RGB")
    assert image.size == (2 * float(root.attrib["width"]), 2 * float(root.attrib["height"]))
    assert len(np.unique(np.asarray(image).reshape(-1, 3), axis=0)) > 30


def test_saving_leaves_the_figure_as_it_is(tab: Page) -> None:
    canvas = tab.locator("#errors canvas >> nth=0")
    before = canvas.screenshot()
    saved(tab, tab.locator("#errors figure >> nth=0").get_by_label("as SVG"))
    assert canvas.screenshot() == before


def test_a_trial_as_gif(tab: Page) -> None:
    tab.select_option("#scenario", label="two_player")
    name, content = saved(tab, tab.get_by_label("as an animated GIF"))
    assert name.startswith("trial-two_player-full") and name.endswith(".gif")
    image = Image.open(io.BytesIO(content))
    assert image.n_frames == 25
    assert image.info["loop"] == 0
    first = np.asarray(image.convert("RGB"), float)
    image.seek(24)
    last = np.asarray(image.convert("RGB"), float)
    assert np.median(first) == 255  # the card's white
    assert (first != last).any(axis=2).sum() > 500
    assert tab.locator("#clock").inner_text() == "6 / 6 s"


@pytest.fixture(scope="module")
def encode(browser: Browser) -> Callable[[np.ndarray], Image.Image]:
    """Encode frames (F, H, W, 3) of few colours as GIF, with the page's encoder."""
    tab = browser.new_page()
    tab.add_script_tag(content=(SCRIPTS / "gif.js").read_text() + "window.encode = encodeGif;")

    def run(frames: np.ndarray) -> Image.Image:
        count, height, width, _ = frames.shape
        pixels = np.concatenate([frames, np.full((*frames.shape[:3], 1), 255)], axis=3)
        content = tab.evaluate(
            "([frames, w, h]) => [...encode(frames.map((f) => Uint8Array.from(f)), w, h, 100)]",
            [pixels.reshape(count, -1).tolist(), width, height],
        )
        return Image.open(io.BytesIO(bytes(content)))

    return run


@pytest.mark.parametrize(("colours", "size"), [(2, (3, 5)), (7, (61, 97)), (200, (120, 90))])
def test_the_encoder_loses_nothing_of_few_colours(
    encode: Callable[[np.ndarray], Image.Image], colours: int, size: tuple[int, int]
) -> None:
    rng = np.random.default_rng(colours)
    steps = rng.choice(32**3, colours, replace=False)
    palette = np.stack(np.unravel_index(steps, (32, 32, 32)), axis=1) * 8
    frames = palette[rng.integers(colours, size=(2, *size))]
    image = encode(frames)
    for k, frame in enumerate(frames):
        image.seek(k)
        np.testing.assert_array_equal(np.asarray(image.convert("RGB")), frame)
    assert image.n_frames == 2
