"""What suites list."""

import pytest
from pydantic import ValidationError

from olne_bench.bench.plan.entries import (
    MOST_SIGMAS,
    GateLimits,
    MetricEntry,
    PluginEntry,
    ScenarioEntry,
    SensorEntry,
    tables,
)

FULL = PluginEntry(name="full")
DROP = PluginEntry(name="drop", parameters={"p": 0.3})


def sensor(data: object) -> tuple[PluginEntry, ...]:
    return SensorEntry.model_validate(data).layers


def test_a_sensor_has_short_forms() -> None:
    assert sensor({"name": "full"}) == (FULL,)
    assert sensor({"name": "drop", "parameters": {"p": 0.3}, "label": "gappy"}) == (DROP,)
    assert sensor({"stack": ["full", DROP.model_dump()]}) == (FULL, DROP)
    entry = SensorEntry(label="gappy", layers=(FULL, DROP))
    assert SensorEntry.model_validate(entry.model_dump()) == entry


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"label": "a"}, "has a name, or a stack of sensors"),
        ({"name": "full", "stack": ["full"]}, "not both"),
        ({"parameters": {"p": 1}, "stack": ["full"]}, "not both"),
        ({"stack": []}, "at least 1 item"),
        ({"stack": ["full"] * 21}, "at most 20 items"),
        ({"stack": 3}, "valid tuple"),
        (3, "valid dictionary"),
    ],
)
def test_what_is_no_sensor_is_refused(data: object, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        sensor(data)


def test_a_stack_has_up_to_twenty_layers() -> None:
    assert len(sensor({"stack": ["full"] * 20})) == 20


def test_a_scenario_has_a_bounded_number_of_levels() -> None:
    entry = ScenarioEntry(name="merge", sigmas=(0.1,) * MOST_SIGMAS)
    assert (entry.trajectories, entry.seeds, entry.family) == (1, None, False)
    with pytest.raises(ValidationError, match="at most 10000 items"):
        ScenarioEntry(name="merge", sigmas=(0.1,) * (MOST_SIGMAS + 1))


def test_a_declaration_is_plain_data() -> None:
    plain = {"label": "a", "worst": 1.0, "gated": True, "unit": None}
    assert MetricEntry(name="a", declaration=plain).declaration == plain
    with pytest.raises(ValidationError, match="'label' of a metric must be a text or a number"):
        MetricEntry(name="a", declaration={"label": ["a"]})


def test_names_are_tables_that_hold_nothing_else() -> None:
    assert tables(["a", {"name": "b", "seeds": 1}]) == [{"name": "a"}, {"name": "b", "seeds": 1}]
    assert tables("a") == "a"


def test_keys_that_are_not_its_own_are_those_of_metrics() -> None:
    limits = GateLimits.model_validate({"failures": 0, "position_error": 0.1, "jerk": 2.0})
    assert limits.bounds == {"position_error": 0.1, "jerk": 2.0, "failures": 0}
    assert GateLimits.model_validate(limits.model_dump()) == limits


def test_limits_that_are_not_set_are_none() -> None:
    limits = GateLimits(limit_ratio=1.5, published_failures=3)
    assert limits.bounds == {"limit_ratio": 1.5, "published_failures": 3}
    assert limits.failures is None


def test_time_is_compared_with_somebody() -> None:
    assert GateLimits(time_ratio=2.0, time_reference="a").bounds == {"time_ratio": 2.0}
    for wrong in ({"time_ratio": 2.0}, {"time_reference": "a", "failures": 0}):
        with pytest.raises(ValidationError, match="belong together"):
            GateLimits.model_validate(wrong)


@pytest.mark.parametrize(
    "wrong", [{}, {"scenarios": ["two_player"]}, {"failures": -1}, {"failures": 0.5}, {"jerk": -1}]
)
def test_nothing_and_less_than_nothing_are_no_limits(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        GateLimits.model_validate(wrong)
    assert GateLimits(failures=0, published_failures=0).bounds["failures"] == 0
