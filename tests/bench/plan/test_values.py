"""Values of suites: strict and bounded."""

import math

import pytest
from pydantic import Field, ValidationError

from olne_bench.bench.plan.values import (
    LABEL_LENGTH,
    Bound,
    Iterations,
    Name,
    Parameters,
    Seconds,
    Seeds,
    Sigma,
    Strict,
    Text,
    Trajectories,
    cut,
    shown,
)


class Values(Strict):
    """One of each."""

    sigma: Sigma = 0.1
    bound: Bound = 0.1
    seconds: Seconds = 1.0
    seeds: Seeds = 1
    iterations: Iterations = 1
    trajectories: Trajectories = 1
    name: Name = "a"
    text: Text = ""
    parameters: Parameters = Field(default_factory=dict)


def nested(depth: int) -> object:
    value: object = 1
    for _ in range(depth):
        value = [value]
    return value


ALLOWED = {
    "sigma": [0.0, 1e6],
    "bound": [0.0],
    "seconds": [7 * 86400.0],
    "seeds": [1, 10**8],
    "iterations": [10**6],
    "trajectories": [1000],
    "name": ["a" * LABEL_LENGTH],
    "text": ["", "b" * 1000],
    "parameters": [
        {"a": 2**63 - 1, "b": "c" * 1000, "d": [1.5, True, "e"], "f": {"g": ""}},
        *({"a": nested(6)}, {"a": [0] * 10_000}, {"a": math.inf}, {"a": -(2**63) + 1}),
    ],
}
REFUSED = {
    "sigma": [-0.1, 1.1e6, math.nan, "0.1"],
    "bound": [math.inf, -1.0],
    "seconds": [0.0, 7 * 86400.5],
    "seeds": [0, 10**8 + 1, 1.0],
    "iterations": [-1, 10**6 + 1],
    "trajectories": [0, 1001],
    "name": ["", " ", "a\nb", "a" * (LABEL_LENGTH + 1)],
    "text": ["b" * 1001, "\x1b[31m"],
    "parameters": [
        *({"a": 2**63}, {"a": -(2**63)}, {"a": math.nan}, {"a": "c" * 1001}, {"a": "b\nc"}),
        *({"": 1}, {"a": {"\n": 1}}, {"a": [{"b": math.nan}]}, {"a": nested(7)}),
        *({"a": [0] * 10_001}, {"a": None}, {"a": b"bytes"}),
    ],
}


def each(values: dict[str, list]) -> list[tuple[str, object]]:
    return [(key, value) for key, listed in values.items() for value in listed]


@pytest.mark.parametrize(("key", "value"), each(ALLOWED))
def test_values_up_to_their_limits_are_kept(key: str, value: object) -> None:
    assert getattr(Values(**{key: value}), key) == value


@pytest.mark.parametrize(("key", "value"), each(REFUSED))
def test_values_beyond_their_limits_are_refused(key: str, value: object) -> None:
    with pytest.raises(ValidationError):
        Values(**{key: value})


def test_there_are_no_other_keys_and_nothing_changes() -> None:
    with pytest.raises(ValidationError, match="Extra inputs"):
        Values(other=1)
    with pytest.raises(ValidationError, match="frozen"):
        Values().sigma = 1.0


def test_what_is_named_in_a_message_has_a_bounded_length() -> None:
    assert shown("abc") == "'abc'"
    assert shown("a" * 118) == repr("a" * 118)
    assert shown("a" * 119) == "'" + "a" * 119 + "... (121 characters)"
    assert shown(10**5000) == "a int too large to be shown"


def test_messages_are_cut() -> None:
    assert cut(" a\n b ") == "a b"
    assert cut("a" * 300) == "a" * 300
    assert cut("a" * 301) == "a" * 300 + "..."
