"""Foreign metrics in child processes."""

import os

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.judge.metrics.scoring import MetricError
from olne_bench.bench.plan.entries import MetricEntry
from olne_bench.bench.run.metric_process import MetricProcess
from olne_bench.estimators.protocol import Estimate

PLUGIN = """
import os, time

class Process:
    name = "process"
    def score(self, case):
        return float(os.getpid())

class Sigma:
    name = "sigma"
    def __init__(self, factor=1.0):
        self.factor = factor
    def score(self, case):
        assert case.held_out() is None
        return self.factor * case.sigma

class Raises:
    name = "raises"
    def score(self, case):
        raise RuntimeError("no idea")

class Sleeps:
    name = "sleeps"
    def score(self, case):
        time.sleep(600)
"""


@pytest.fixture
def score(tmp_path):
    path = tmp_path / "scores.py"
    path.write_text(PLUGIN)
    metrics = MetricProcess(memory=None, hidden=None)
    estimate = Estimate(np.full((2, 4), 0.25))
    case = Judged((), estimate, prediction=np.zeros((3, 2, 4)), sigma=0.5)

    def ask(name: str, seconds: float = 30.0, **parameters: float) -> float | None:
        entry = MetricEntry(name=f"{path}:{name}", parameters=parameters, column=name.lower())
        return metrics.score(entry, case, (), seconds)

    yield ask
    metrics.stop()


def test_each_metric_has_a_process_which_it_keeps(score) -> None:
    one = score("Process")
    assert one != os.getpid()
    assert score("Process") == one
    assert score("Sigma") == 0.5
    assert score("Sigma", factor=3.0) == 1.5
    assert score("Process") == one


def test_what_goes_wrong_is_told_of_the_metric(score) -> None:
    with pytest.raises(MetricError, match=r"metric 'raises': .*no idea"):
        score("Raises")
    with pytest.raises(MetricError, match="metric 'sleeps': "):
        score("Sleeps", seconds=1.0)
    assert score("Sigma") == 0.5
