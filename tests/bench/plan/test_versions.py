"""Versions of what a result depends on."""

from olne_bench.bench.plan.entries import EstimatorEntry, MetricEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.versions import VERSION_COLUMNS, Versions, environment, versions
from olne_bench.bench.process.arithmetic import arithmetic

PLUGIN = """
from helper import number

class Own:
    name = "Own"
    def estimate(self, problem, observation, *, rng, budget):
        return number
"""


def taken(**changes) -> Versions:
    entries = {
        "scenario": ScenarioEntry(name="two_player"),
        "sensor": SensorEntry.model_validate({"name": "full"}),
        "estimator": EstimatorEntry(name="uniform"),
        "metrics": (MetricEntry(name="position_error"),),
    }
    return versions(**entries | changes)


def changed(other: Versions) -> set[str]:
    first = taken()
    return {name for name in vars(first) if getattr(first, name) != getattr(other, name)}


def test_each_part_of_a_trial_has_a_version_of_its_own() -> None:
    assert changed(taken()) == set()
    assert changed(taken(scenario=ScenarioEntry(name="random"))) == {"scenario"}
    assert changed(taken(sensor=SensorEntry.model_validate({"name": "drop"}))) == {"sensor"}
    assert changed(taken(estimator=EstimatorEntry(name="ukf"))) == {"estimator"}
    assert changed(taken(metrics=())) == {"scoring"}
    stack = SensorEntry.model_validate({"stack": ["full", "full"]})
    assert changed(taken(sensor=stack)) == {"sensor"}


def test_only_parameters_of_metrics_are_part_of_a_version() -> None:
    entry = MetricEntry(name="position_error", parameters={"a": 1})
    assert changed(taken(metrics=(entry,))) == {"scoring"}
    assert changed(taken(scenario=ScenarioEntry(name="two_player", options={"a": 1}))) == set()


def test_versions_are_short_texts_and_columns() -> None:
    found = vars(taken())
    assert {len(text) for text in found.values()} == {12}
    assert list(VERSION_COLUMNS) == [f"{name}_version" for name in found]


def test_the_environment_names_libraries_and_the_backend() -> None:
    found = environment()
    assert found["backend"]
    assert found["arithmetic"] == arithmetic()
    assert found["numpy"].count(".") == 2
    assert "missing" not in found.values()


def test_a_file_counts_with_the_modules_beside_it(tmp_path) -> None:
    found = []
    for number in (1, 2):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "own.py").write_text(PLUGIN)
        (folder / "helper.py").write_text(f"number = {number}\n")
        (folder / "unused.py").write_text(f"number = {number}\n")
        found.append(taken(estimator=EstimatorEntry(name=f"{folder / 'own.py'}:Own")))
    assert found[0].estimator != found[1].estimator
    assert found[0].scoring == found[1].scoring


def test_another_arithmetic_is_another_environment(monkeypatch) -> None:
    here = taken()
    found = dict(environment()) | {"arithmetic": "x86_64, with AVX-512"}
    monkeypatch.setattr("olne_bench.bench.plan.versions.environment", lambda: found)
    assert vars(taken()) | {"environment": here.environment} == vars(here)
    assert taken().environment != here.environment
