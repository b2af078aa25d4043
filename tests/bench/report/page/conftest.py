import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Browser
from playwright.sync_api import Page as Tab

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.report.figures import draw_figures
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.run.provenance import Provenance
from olne_bench.envs.scenarios import get_scenario
from tests.bench.report.conftest import LOST, trial_row

#: A name that a plugin may have.
HOSTILE = "<img src=x onerror=\"document.title='broken'\"></script><b>&"


def provenance() -> Provenance:
    return Provenance(
        started="2026-01-02T03:04:05+00:00",
        suite=json.dumps({"description": "A small study <i>indeed</i>"}),
        suite_text='name = "small" # <script>document.title="broken"</script>',
        selection=Selection(seeds=3),
        seeds=3,
        executor="2 local processes",
        versions={"python": "3.11", "numpy": "2"},
        environment={"backend": "native"},
        commit="0123456789abcdef-dirty",
        machine={"system": "Linux", "cores": "2"},
    )


@pytest.fixture(scope="session")
def small_study(prediction_error) -> pd.DataFrame:
    """Two scenarios, two sensors and three estimators, one of which fails sometimes."""
    rng = np.random.default_rng(0)
    rows = []
    for scenario in ("two_player", "highway_overtaking"):
        truth = get_scenario(scenario).weights
        for estimator in ("kkt_constrained", HOSTILE, "uniform"):
            for sensor in ("full", "partial"):
                for sigma in (0.01, 0.05):
                    for seed in range(6):
                        spread = 0 if estimator == "uniform" else 2 * sigma
                        weights = truth * np.exp(spread * rng.standard_normal(truth.shape))
                        weights /= weights.sum(axis=1, keepdims=True)
                        failed = estimator == HOSTILE and seed == 5
                        error = cosine_error(truth, weights)
                        predicted = prediction_error(scenario, seed, weights)
                        row = trial_row(
                            suite="small <study>",
                            scenario=scenario,
                            sensor=sensor,
                            sigma=sigma,
                            seed=seed,
                            estimator=estimator,
                            cosine_error=error,
                            cosine_limit=21.9 * sigma**2,
                            position_error=predicted,
                            observation_error=0.8 * sigma * rng.uniform(0.9, 1.1),
                            weights=weights.tolist(),
                        )
                        lost = LOST | {"status": "crash", "weights": None}
                        rows.append(row | (lost if failed else {}))
    return pd.DataFrame(rows)


@pytest.fixture(scope="session")
def page(small_study: pd.DataFrame, usual: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "index.html"
    tables = tabulate(small_study, usual)
    pictures, _ = draw_figures(small_study, tables, path.parent / "figures", ("png",), usual)
    html = render_page(small_study, tables, [provenance()], usual, pictures=pictures).html
    path.write_text(html, encoding="utf-8")
    return path


@pytest.fixture
def tab(browser: Browser, page: Path) -> Iterator[Tab]:
    """The page, opened from disk; the browser must not have reported an error at the end."""
    complaints: list[str] = []
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    tab = context.new_page()
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("request", lambda r: complaints.append(r.url) if r.url.startswith("http") else None)
    tab.goto(page.as_uri())
    yield tab
    assert tab.title() == "small <study> · OLNE Bench"  # a hostile name would have changed it
    context.close()
    assert complaints == []
