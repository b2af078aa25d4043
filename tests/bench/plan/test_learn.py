"""A suite learns from its plugins what they are, and stores it."""

import re

import pytest

from olne_bench.bench.plan.learn import describe_here
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.plan.versions import versions
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, METRIC, SCENARIO, SENSOR, Description

SUITE = """
name = "tiny"
scenarios = ["two_player"]
sensors = ["full", {name = "drop", parameters = {p = 0.3}}]
sigmas = [0.0, 0.1]
seeds = 3
trajectories = 2
estimators = ["uniform"]
"""

PLUGINS = {
    "estimator.py": "class A:\n    name = 'mine'\n    several = True\n"
    "    def estimate(self): ...\n",
    "scenario.py": "class A:\n    name = 'mine'\n    def draw(self, seed): ...\n",
    "sensor.py": "class A:\n    name = 'mine'\n    def layers(self): return ()\n",
    "metric.py": "class A:\n    name = 'mine'\n    gated = True\n    unit = 'm'\n"
    "    def score(self, case): return 1.0\n",
}


WORLDS = ("estimator", "scenario", "sensor")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "suite.toml").write_text(SUITE)
    for name, text in PLUGINS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def load(folder, *plugins, describe=describe_here):
    references = tuple(str(folder / plugin) for plugin in plugins)
    return load_suite(str(folder / "suite.toml"), references, describe)


def test_a_plugin_of_any_kind_joins(folder):
    suite = load(folder, *PLUGINS)
    here = str(folder)
    estimator, scenario = suite.estimators[-1], suite.scenarios[-1]
    assert (estimator.label, estimator.several) == ("mine", True)
    assert estimator.name == f"{here}/estimator.py"
    assert (scenario.label, scenario.family) == ("mine(trajectories=2)", True)
    assert suite.sensors[-1].layers[0].name == f"{here}/sensor.py"
    metric = suite.metrics[-1]
    assert (metric.column, metric.declaration["gated"]) == ("mine", True)
    assert [e.label for e in suite.sensors] == ["full", "drop(p=0.3)", "mine"]
    assert read_suite_json(suite.model_dump_json()) == suite
    assert suite.scenario("mine(trajectories=2)") == scenario
    with pytest.raises(UserError, match=re.escape("no sensor 'x'; it has: full, drop(p=0.3)")):
        load(folder).sensor("x")


def test_metrics_of_this_package_are_always_there(folder):
    own = [entry.column for entry in load(folder).metrics]
    assert {"cosine_error", "position_error"} <= set(own)
    path = folder / "suite.toml"
    path.write_text(f"metrics = ['{folder}/metric.py', 'cosine_error']\n{SUITE}")
    assert [entry.column for entry in load(folder).metrics] == [*own, "mine"]


def test_a_suite_may_leave_metrics_of_this_package_out(folder):
    own = [entry.column for entry in load(folder).metrics]
    path = folder / "suite.toml"
    path.write_text(f"left_out = ['crps', 'covers_truth']\n{SUITE}")
    assert {"crps", "covers_truth"} <= set(own)
    left = [entry.column for entry in load(folder).metrics]
    assert left == [name for name in own if name not in ("crps", "covers_truth")]
    path.write_text(f"left_out = ['mine']\n{SUITE}")
    with pytest.raises(
        UserError, match="leaves out 'mine', which is no built-in metric; those are"
    ):
        load(folder)


def test_all_is_asked_in_one_go(folder):
    asked = []

    def describe(questions):
        asked.append([(kind, reference) for kind, reference, _ in questions])
        return describe_here(questions)

    load(folder, "metric.py", describe=describe)
    ((*first, last),) = asked
    assert last == (None, str(folder / "metric.py"))
    worlds = [(SCENARIO, "two_player"), (SENSOR, "full"), (SENSOR, "drop")]
    assert first[:4] == [*worlds, (ESTIMATOR, "uniform")]
    assert {kind for kind, _ in first[4:]} == {METRIC}


@pytest.mark.parametrize("name", ["status", "sigma", "failures", "A", "a b", "run", "1st"])
def test_a_metric_takes_no_column_that_is_taken(folder, name):
    (folder / "metric.py").write_text(PLUGINS["metric.py"].replace("mine", name))
    with pytest.raises(UserError, match=f"a metric is called '{name}': its name becomes a col"):
        load(folder, "metric.py")


def test_what_a_plugin_says_is_checked_as_what_a_file_says(folder):
    def describe(questions):
        return [
            Description(kind.name, reference, "line\nbreak") for kind, reference, _ in questions
        ]

    with pytest.raises(UserError, match="label: it cannot contain control characters"):
        load(folder, describe=describe)


@pytest.mark.parametrize(
    ("changed", "differs"), [*((f"{kind}.py", kind) for kind in WORLDS), ("metric.py", "scoring")]
)
def test_every_plugin_counts_for_the_versions(tmp_path_factory, changed, differs):
    found = []
    for text in ("", "x = 1\n"):
        # Contents are remembered by path, so every look is at a copy.
        copy = tmp_path_factory.mktemp("copy")
        for name, body in PLUGINS.items():
            (copy / name).write_text(body + text if name == changed else body)
        (copy / "suite.toml").write_text(SUITE)
        suite = load(copy, *PLUGINS)
        entries = (suite.scenarios[-1], suite.sensors[-1], suite.estimators[-1])
        found.append(versions(*entries, suite.metrics))
    one, other = (vars(v) for v in found)
    assert [name for name in one if one[name] != other[name]] == [differs]


def test_a_trial_knows_the_foreign_code_it_is_played_with(folder):
    suite = load(folder, *PLUGINS)
    trials = {(t.scenario.label, t.sensor.label): t for t in expand(suite)}
    assert trials["two_player(trajectories=2)", "full"].home_plugins == ()
    files = tuple(str(folder / name) for name in ("scenario.py", "sensor.py"))
    assert trials["mine(trajectories=2)", "mine"].home_plugins == files
