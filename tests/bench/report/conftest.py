"""Scenarios and sensors by their labels, as a run's suite would tell."""

from collections.abc import Callable

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.plan.entries import EstimatorEntry, PluginEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.report.study import Study
from olne_bench.games.root_following import follow_root


@pytest.fixture(scope="session")
def usual() -> Study:
    scenarios = [
        ScenarioEntry(name="two_player", label="two_player"),
        ScenarioEntry(name="two_player", label="two_player(trajectories=4)", trajectories=4),
        ScenarioEntry(name="highway_overtaking", label="highway_overtaking"),
        ScenarioEntry(name="random", label="random", family=True),
    ]
    sensors = [SensorEntry(label=n, layers=(PluginEntry(name=n),)) for n in ("full", "partial")]
    return Study(
        scenarios={entry.label: entry for entry in scenarios},
        sensors={entry.label: entry for entry in sensors},
        salt="test",
        estimators={n: EstimatorEntry(name=n, label=n) for n in ("kkt_constrained", "uniform")},
    )


@pytest.fixture(scope="session")
def prediction_error(usual: Study) -> Callable[[str, int, np.ndarray], float]:
    """The position error of the forward game at weights, from a draw's own start."""

    def error(scenario: str, seed: int, weights: np.ndarray) -> float:
        truth = true_recording(usual.draw(scenario, seed))
        known = truth.scenario
        root = follow_root(known.game, truth.root, known.weights, weights)
        assert root is not None
        return position_error(truth.states, root.states)

    return error
