"""A plugin that knows the truths of a run has no rank, and fresh draws show it."""

import json
from pathlib import Path

import pandas as pd
import pytest

from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.confirmations import FILE_NAME

SUITE = """
name = "cheated"
sensors = ["full"]
sigmas = [0.03, 0.1]
seeds = 6
time_limit = 60.0
estimators = ["kkt_constrained"]

[[scenarios]]
name = "two_player"
label = "wide"
options = { weights = "dirichlet" }

[[scenarios]]
name = "two_player"
sigmas = [0.1]
"""

#: The salt is published, so anybody can draw all truths of the suite. It chooses by the motion.
CHEAT = """
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np

TRUTHS = json.loads(Path(__file__).with_name("truths.json").read_text())


class Knows:
    name = "knows"

    def estimate(self, problem, observation, *, rng, budget):
        gaps = [np.abs(np.array(p) - observation.y[..., :2]).sum() for p, _ in TRUTHS]
        return SimpleNamespace(weights=np.array(TRUTHS[int(np.argmin(gaps))][1]))


class Constants:
    name = "constants"

    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=np.ones((2, 4)))
"""


@pytest.fixture
def cheated(study):
    study.suite.write_text(SUITE)
    study.plugin.write_text(CHEAT)
    wide = ScenarioEntry(name="two_player", options={"weights": "dirichlet"}, family=True)
    truths = [true_recording(Draw.of(wide, seed, "cheated")) for seed in range(6)]
    known = [(t.states[..., :2].tolist(), t.scenario.weights.tolist()) for t in truths]
    study.plugin.with_name("truths.json").write_text(json.dumps(known))
    study.call(*study.arguments("run", "Knows", "Constants"), "--jobs", 2)
    return study


def board(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "leaderboard.csv").set_index(["scenario", "sensor", "estimator"])


@pytest.mark.long
def test_who_knows_the_truths_is_not_confirmed(cheated):
    run = cheated.folder / "run"
    said = cheated.call("report", run, "--no-figures")
    assert "constants has no rank in two_player: the true weights are published" in said
    assert "knows in wide, full: 12 rows are implausible" in said
    first = board(run)
    scores = first["position_error_score"]
    assert scores.xs("kkt_constrained", level="estimator").eq(1).all()  # it is the reference
    alone = first.loc["two_player"].xs("kkt_constrained", level="estimator")
    assert alone["standing"].eq("ranks").all()
    assert scores.xs("knows", level="estimator").isna().all()
    assert scores["two_player"].xs("constants", level="estimator").isna().all()

    said = cheated.call("confirm", run, code=1)
    lines = [line for line in said.splitlines() if line.startswith("knows in wide")]
    assert [line.split(":")[0] for line in lines] == ["knows in wide, full"]
    assert all("not confirmed" in line and "of 20 fresh" in line for line in lines)
    told = json.loads((run / FILE_NAME).read_text())
    assert [one["confirmed"] for one in told] == [False]
    assert all(one["error"] < 1e-12 and one["fresh_error"] > 1e-3 for one in told)
    assert all(one["versions"]["estimator"] for one in told)

    assert "m on fresh draws" in cheated.call("report", run, "--no-figures")
    second = board(run)
    assert second.loc[("wide", "full", "knows"), "standing"].startswith("not confirmed")
    pd.testing.assert_frame_equal(first.drop(columns="standing"), second.drop(columns="standing"))

    said = cheated.call("compare", run, run, "--estimator", "knows=kkt_constrained", code=2)
    assert "no trial with noise in common that can be compared; knows has no rank" in said
    said = cheated.call("compare", run, run, "--estimator", "constants=kkt_constrained")
    assert "two_player" not in said.split("note:")[0]
    assert "note: constants has no rank in two_player" in said

    # Another version of the plugin has to prove itself again.
    cheated.plugin.write_text(f"{CHEAT}\nCHANGED = True\n")
    said = cheated.call("confirm", run, code=2)
    assert "were run with other code than the present one" in said
    cheated.call(*cheated.arguments("run", "Knows", "Constants"), "--jobs", 2)
    assert "until 'olne-bench confirm' has run fresh draws" in cheated.call(
        "report", run, "--no-figures"
    )


def test_nothing_to_confirm(study):
    study.run("run")
    assert "no row is implausible" in study.call("confirm", study.folder / "run")


def test_a_damaged_file_of_confirmations_is_refused(study):
    study.run("run")
    run = study.folder / "run"
    for text in ("{}", "[{}]", "[" * 100_000, "\0"):
        (run / FILE_NAME).write_text(text)
        said = study.call("report", run, "--no-figures", code=2)
        assert f"{FILE_NAME} holds no confirmations" in said
        assert len(said.strip().splitlines()) == 1
