"""Descriptions of plugins, made in child processes."""

import sys

import pytest

from olne_bench.bench.process.child import Child, DiedError
from olne_bench.bench.run import describe_plugins as describing
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.plugins import ESTIMATOR, SENSOR

PLUGINS = """
import os, time

class Good:
    name = "Good"
    def __init__(self, size=1):
        self.size = size
    def estimate(self, problem, observation, *, rng, budget):
        pass

class Dies(Good):
    name = "Dies"
    def __init__(self):
        os._exit(3)

class Sleeps(Good):
    name = "Sleeps"
    def __init__(self):
        time.sleep(600)
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "described.py"
    path.write_text(PLUGINS)
    return path


def test_built_in_ones_and_foreign_ones_are_described_in_order(file) -> None:
    requests = [
        (ESTIMATOR, "uniform", {}),
        (ESTIMATOR, f"{file}:Good", {"size": 2}),
        (SENSOR, "drop", {"p": 0.3}),
        (None, f"{file}:Good", {}),
    ]
    uniform, good, drop, found = describe_all(requests)
    assert [d.error for d in (uniform, good, drop, found)] == [""] * 4
    assert (uniform.label, uniform.several) == ("uniform", True)
    assert (good.label, good.several) == ("Good", False)
    assert found.kind == "estimator"
    assert drop.kind == "sensor"
    assert "described" not in sys.modules


def test_what_goes_wrong_is_one_line_of_its_own(file, monkeypatch) -> None:
    monkeypatch.setattr(describing, "LOAD_LIMIT", 5.0)
    names = ("Dies", "Sleeps", "Good")
    dies, sleeps, good = describe_all([(ESTIMATOR, f"{file}:{name}", {}) for name in names])
    assert dies.error.startswith("estimator '")
    assert "cannot be loaded" in dies.error
    assert "it takes more than 5 s" in sleeps.error
    assert good.error == ""
    (wrong,) = describe_all([(None, f"{file}:Nobody", {})])
    assert wrong.error.startswith("'Nobody' in '")
    assert "\n" not in wrong.error


@pytest.mark.parametrize(
    ("outside", "kills", "answers"), [(True, 2, True), (True, 3, False), (False, 1, False)]
)
def test_a_plugin_whose_process_was_killed_from_outside_is_asked_again(
    file, monkeypatch, outside, kills, answers
) -> None:
    call, left = Child.call, [kills]

    def killed(child, *question, **options):
        if left[0]:
            left[0] -= 1
            raise DiedError("the process was killed", outside=outside, served=0)
        return call(child, *question, **options)

    monkeypatch.setattr(Child, "call", killed)
    (good,) = describe_all([(ESTIMATOR, f"{file}:Good", {})])
    assert (good.label == "Good") == answers
    assert ("was killed" in good.error) != answers
