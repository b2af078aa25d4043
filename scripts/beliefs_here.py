"""The beliefs of an ego in a drive, with the estimator in this process, for measurements."""

import pickle
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from olne_bench.bench.commands.interface.drive import drive
from olne_bench.bench.judge.beliefs import EstimatedBeliefs
from olne_bench.bench.judge.online import StreamTask
from olne_bench.bench.judge.referee import Answer
from olne_bench.bench.plan.drive import EstimateRules
from olne_bench.bench.run.stream_player import begin, update
from olne_bench.envs.drive.cars import ROADS
from olne_bench.estimators.protocol import Problem

DEFAULTS: dict[str, Any] = {option.name: option.default for option in drive.params}
RULES = EstimateRules(**{rule.name: DEFAULTS[rule.name] for rule in fields(EstimateRules)})


@dataclass
class Here:
    """Runs an estimator in this process; ``began`` says whether a stream began since last asked."""

    began: bool = False

    def start(self, task: StreamTask) -> str | None:
        """As of ``judge.online.StreamPlayer``."""
        self.began = True
        problem = pickle.dumps(task.problem)
        return begin(task.reference, task.parameters, (), problem, task.lag, task.seed).declined

    def update(self, sample: np.ndarray) -> Answer:
        """As of ``judge.online.StreamPlayer``. It takes no time: no estimate is late."""
        return Answer(estimate=update(sample.copy(), 2 * RULES.deadline).estimate, seconds=0.0)


def beliefs_here(player: Here, road: str, method: str) -> EstimatedBeliefs:
    """What ``method`` estimates in a drive, by the rules of ``olne-bench drive``."""

    def task_of(problem: Problem) -> StreamTask:
        return StreamTask(method, {}, "", problem, RULES.window, 0, RULES.time_limit)

    return EstimatedBeliefs(player, task_of, ROADS[road], RULES)
