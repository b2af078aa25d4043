"""``olne-bench online``."""

import json

import pandas as pd

from olne_bench.bench.report.online_rows import COLUMNS

SUITE = """
name = "small"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.01]
seeds = 2
time_limit = 20.0
estimators = ["uniform", "map"]
"""


def test_a_study(study) -> None:
    study.suite.write_text(SUITE)
    out = study.folder / "streams"
    words = ["online", study.suite, "--out", out, "--lag", 20, "--deadline", 10, "--seeds", 1]
    said = study.call(*words)
    rows = pd.read_csv(out / "updates.csv")
    assert tuple(rows.columns) == COLUMNS
    kinds = ["constant_velocity", "constant_controls", "true_weights", "uniform", "map"]
    assert list(dict.fromkeys(rows["estimator"])) == kinds
    assert (rows.groupby("estimator")["sample"].max() == 25).all()
    assert set(rows["status"]) <= {"ok", "failed_forward"}
    last = rows[(rows["estimator"] == "map") & (rows["sample"] == 25)].iloc[0]
    assert last["cosine_error"] < last["prior_error"] + 0.05
    assert 0 < last["latency"] < 10
    summary = pd.read_csv(out / "summary.csv")
    assert summary["estimator"].tolist() == kinds and (summary["failed"] == 0).all()
    assert len(pd.read_csv(out / "over_time.csv")) == 5 * 25
    settings = json.loads((out / "online.json").read_text())
    assert (settings["lag"], settings["deadline"]) == (20, 10.0)
    assert "fde_3s" in said and "map" in said
    assert (out / "online_two_player_full.png").is_file()
    again = study.call(*words, code=2)
    assert "exists already" in again


def test_what_cannot_be_run_is_refused(study) -> None:
    out = study.folder / "streams"
    study.suite.write_text(SUITE + "trajectories = 2\n")
    said = study.call("online", study.suite, "--out", out, code=2)
    assert "has 2 trajectories; online, there is one motion at a time" in said
    assert "--lag" in study.call("online", "--lag", 1, "--out", out, code=2)
    assert "--deadline" in study.call("online", "--deadline", 0, "--out", out, code=2)
    assert not out.exists()


def test_foreign_scenarios_are_refused(study) -> None:
    (study.folder / "world.py").write_text(
        "from olne_bench.envs.scenarios import get_scenario\n"
        "class World:\n    name = 'World'\n    def draw(self):\n"
        "        return get_scenario('two_player')\n"
    )
    study.suite.write_text(SUITE.replace('"two_player"', f'"{study.folder}/world.py"'))
    said = study.call("online", study.suite, "--out", study.folder / "streams", code=2)
    assert "is a plugin; online, scenarios and sensors are built-in ones" in said
