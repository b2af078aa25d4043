"""Limits of a gate."""

import pytest
from pydantic import ValidationError

from olne_bench.bench.plan.limits import GateLimits


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
