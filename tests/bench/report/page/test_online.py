"""The page of an online study, in a browser."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Browser

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.report.stream_tables import COLUMNS
from olne_bench.bench.report.write import write_streams
from tests.bench.report.page.conftest import HOSTILE, provenance

COMMAND = "olne-bench run online --seeds 3 --kind streams --rule lag=8 --out DIR"


def rows() -> pd.DataFrame:
    """Eight draws of six samples on one road, of three estimators; one has a hostile name."""
    rng, made = np.random.default_rng(0), []
    for name, scale in (("constant_velocity", 3.0), ("map", 0.3), (HOSTILE, 0.9), ("uniform", 2.0)):
        for seed in range(8):
            for sample in range(1, 7):
                error = scale * rng.uniform(0.8, 1.2) / sample
                row = dict.fromkeys(COLUMNS)
                row |= {"scenario": "merge", "sensor": "full", "sigma": 0.1, "estimator": name}
                row |= {"seed": seed, "sample": sample, "time": 0.4 * sample, "status": "ok"}
                row |= {"late": False, "fde_1s": error, "fde_3s": 3 * error}
                if name != "constant_velocity":
                    row |= {"cosine_error": error / 9, "prior_error": 0.2, "latency": 0.004}
                made.append(row)
    return pd.DataFrame(made)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("online")
    suite = load_suite("online", rules={"lag": 8})
    write_streams(rows(), [provenance()], suite, folder, ("png",))
    return folder / "index.html"


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_shows_what_the_tables_have(browser: Browser, place: Path, width, scheme) -> None:
    complaints: list[str] = []
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    tab = context.new_page()
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.goto(place.as_uri())
    assert (
        tab.title() == "online (changed), one sample at a time · OLNE Bench"
    )  # no name has broken it
    assert tab.locator("#summary table >> nth=0 >> tbody tr").count() == 4
    for summary in tab.locator("#summary details > summary").all():
        summary.click()
    verdicts = tab.locator("#summary table >> nth=1 >> tbody tr")
    told = {row.split("\t")[3]: row.split("\t")[0] for row in verdicts.all_inner_texts()}
    assert told["map"].strip() == "below" and "uniform" not in told
    assert tab.locator("#summary table >> nth=2 >> tbody tr").count() == 3  # latencies
    assert COMMAND in tab.text_content("#provenance")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("document.documentElement.dataset.theme") == scheme
    assert tab.locator(".plot svg").bounding_box()["width"] > 300
    assert complaints == []


def test_tables_can_be_saved_and_the_page_is_small(browser: Browser, place: Path) -> None:
    tab = browser.new_page()
    tab.goto(place.as_uri())
    with tab.expect_download() as told:
        tab.locator('button[data-table="summary"]').click()
    assert len(pd.read_csv(told.value.path())) == 4
    assert place.stat().st_size < 300_000
