"""The check that sensors fit scenarios."""

import pytest

from olne_bench.bench.plan.entries import ScenarioEntry, SensorEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.check_sensors import check_fit, fit
from olne_bench.errors import UserError

UNFIT = {"label": "odd", "stack": ["partial", {"name": "range_bearing"}, "partial"]}


def suite(*sensors: object):
    entries = tuple(SensorEntry.model_validate(sensor) for sensor in sensors)
    return load_suite("quick").model_copy(update={"sensors": entries})


def test_sensors_of_this_package_fit_its_scenarios() -> None:
    check_fit(suite({"label": "full", "name": "full"}, {"label": "lidar", "name": "range_bearing"}))


def test_the_first_pair_that_does_not_fit_is_named() -> None:
    with pytest.raises(UserError) as caught:
        check_fit(suite({"label": "full", "name": "full"}, UNFIT))
    said = str(caught.value)
    assert said.startswith("suite 'quick': sensor 'odd' does not fit scenario 'two_player': ")
    assert "\n" not in said
    assert len(said) > 80


def test_what_is_wrong_is_told_as_data() -> None:
    scenario = ScenarioEntry(name="two_player")
    assert fit(scenario, SensorEntry.model_validate({"name": "full"})).problem == ""
    assert fit(scenario, SensorEntry.model_validate(UNFIT)).problem != ""


SCENARIO = """
from olne_bench.envs.scenarios import get_scenario

class Cars:
    name = "Cars"
    def draw(self):
        return get_scenario("two_player")

class Cannot:
    name = "Cannot"
    def draw(self):
        raise RuntimeError
"""


def test_foreign_scenarios_are_asked_in_a_process_of_their_own(tmp_path) -> None:
    path = tmp_path / "cars.py"
    path.write_text(SCENARIO)
    foreign = ScenarioEntry(name=f"{path}:Cars", label="Cars")
    broken = ScenarioEntry(name=f"{path}:Cannot", label="Cannot")
    full = {"label": "full", "name": "full"}
    check_fit(suite(full).model_copy(update={"scenarios": (foreign, broken)}))
    with pytest.raises(UserError, match="sensor 'odd' does not fit scenario 'Cars'"):
        check_fit(suite(full, UNFIT).model_copy(update={"scenarios": (foreign,)}))
