"""The beliefs of an ego in a drive, with the estimator in this process, for measurements."""

from dataclasses import dataclass

import numpy as np

from olne_bench.bench.judge.beliefs import EstimatedBeliefs, EstimateRules
from olne_bench.bench.judge.players import Answer, PlayerTask
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.player import prepare, told, update
from olne_bench.envs.drive.cars import ROADS, STEP
from olne_bench.estimators.protocol import Problem

SUITE = load_suite("driving")
RULES = EstimateRules(SUITE.rules.window, SUITE.sigmas[0], SUITE.rules.deadline or STEP)


@dataclass
class Here:
    """Runs an estimator in this process; ``began`` says whether a stream began since last asked."""

    began: bool = False

    def start(self, task: PlayerTask) -> str | None:
        """As of ``judge.players.StreamPlayer``."""
        self.began = True
        return prepare(*told(task)).declined

    def update(self, sample: np.ndarray) -> Answer:
        """As of ``judge.players.StreamPlayer``. It takes no time: no estimate is late."""
        return Answer(estimate=update(sample.copy(), 2 * RULES.deadline).estimate, seconds=0.0)


def beliefs_here(player: Here, road: str, method: str) -> EstimatedBeliefs:
    """What ``method`` estimates in a drive, by the rules of the suite ``driving``."""

    def task_of(problem: Problem) -> PlayerTask:
        return PlayerTask(method, {}, "", problem, 0, SUITE.time_limit, lag=RULES.window)

    return EstimatedBeliefs(player, task_of, ROADS[road], RULES)
