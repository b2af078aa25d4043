import re

import numpy as np
import pandas as pd
import pytest
from pylatexenc.latexwalker import LatexEnvironmentNode, LatexWalker

from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.statistics.score import log_errors, score_table
from tests.bench.report.conftest import trial_row

ODD = r"50%_of <b>|&$x\y"
COLUMNS = 12


@pytest.fixture
def table() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    rows = [
        trial_row(
            scenario="two_player",
            estimator=name,
            sigma=0.01,
            seed=seed,
            status="ok" if name != "never" else "timeout",
            cosine_error=scale * rng.uniform(1, 2),
            identifiable_cosine_error=scale,
            cosine_limit=0.01,
            position_error=scale * rng.uniform(1, 2),
            held_out_error=2 * scale,
            covers_truth=None if name == "never" else int(seed < 27),
            solve_seconds=None if name == "never" else 0.5,
        )
        for name, scale in (("good", 0.001), (ODD, 0.1), ("never", 1.0))
        for seed in range(30)
    ]
    trials = pd.DataFrame(rows)
    return leaderboard(trials, score_table(log_errors(trials)))


def test_markdown(table: pd.DataFrame) -> None:
    text = markdown(table)
    lines = text.splitlines()
    assert len(lines) == 2 + 3
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {COLUMNS + 1}
    assert lines[1].split() == ["|", *["---", "|"] * 3, *["---:", "|"] * (COLUMNS - 3)]  # numbers
    assert "| good | **0.009** | 0.00" in lines[2]
    assert r"50%\_of \<b\>\|\&$x\\y" in lines[3]
    assert "| 0.002 |" in lines[2]  # held out
    assert "| 90% of 30 |" in lines[2]
    assert "∞ [∞, ∞]" in lines[4]
    assert "| – |" in lines[4]  # no ellipsoid
    assert lines[4].endswith("| ∞ |")  # no time


def test_latex(table: pd.DataFrame) -> None:
    text = latex(table)
    assert text.startswith(r"\begin{tabular}{lllrrrrrrrrr}")
    assert r"\toprule" in text
    assert r"\textbf{0.009}" in text
    assert r"$\infty$" in text
    assert r"50\%\_of" in text
    assert r"90\% of 30" in text
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {len(re.findall(r"(?<!\\)&", row)) for row in rows} == {COLUMNS - 1}
    # Unbalanced braces, groups, mathematics and environments raise.
    nodes, _, _ = LatexWalker(text, tolerant_parsing=False).get_latex_nodes()
    environments = [node for node in nodes if isinstance(node, LatexEnvironmentNode)]
    assert [node.environmentname for node in environments] == ["tabular"]
