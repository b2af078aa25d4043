"""A plugin that searches everywhere does not find the weights of a drawn scenario."""

import json
from pathlib import Path

import pytest
from running import Run

from olne_bench.bench.process.sandbox import landlock_version

SUITE = """
name = "spied"
scenarios = [{{name = "random", options = {{num_players = 2}}}}]
sensors = ["full"]
sigmas = [0.05]
seeds = 3
time_limit = {limit}
estimators = ["uniform"]
"""


@pytest.mark.skipif(not landlock_version(), reason="needs Landlock")
def test_a_spy_does_not_learn_the_weights(tmp_path):
    spy = tmp_path / "spy.py"
    spy.write_text(Path(__file__).with_name("spy.py").read_text())
    # The run folder lies beside the plugin, where the spy looks at every file.
    run = Run(tmp_path, [spy], "--salt", "fresh", limit=60.0, suite=SUITE)
    assert run.code == 0, run.said
    spied, floor = run.rows.loc[["Spy"]], run.rows.loc[["uniform"]]
    assert list(spied["status"]) == ["ok"] * 3, list(spied["message"])
    for message in spied["message"]:
        said = json.loads(message)
        assert said["files"] >= 3  # the suite, its neighbour and itself can be read
        assert said["hits"] == []
        assert said["out"] == said["stores"] == 0
        assert said["salts"] <= 1  # the word 'fresh', on the driver's command line
    assert spied["cosine_error"].mean() >= 0.9 * floor["cosine_error"].mean()
    assert spied["cosine_error"].min() > 1e-3
