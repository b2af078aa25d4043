"""Declarations of metrics."""

import pytest

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import (
    MetricDeclaration,
    declaration_from,
    declare,
)
from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.errors import UserError


def test_declarations_survive_a_suite():
    for one in BUILT_IN:
        stored = one.stored() | {"of_a_later_version": 1}
        assert declaration_from(stored) == one
        assert one.description.endswith(".")
    unbounded = BUILT_IN[0].stored() | {"worst": None}  # as JSON without infinity has it
    assert declaration_from(unbounded).worst == float("inf")


def test_what_is_not_declared_has_a_usual_value():
    class ThrottleError:
        """How far throttles are off.

        Of all players.
        """

        name = "throttle_error"

        def score(self, case: Judged) -> float:
            return 0.0

    declared = declare(ThrottleError)
    assert declared == declare(ThrottleError())
    assert (declared.label, declared.title) == ("throttle error", "Throttle error")
    assert declared.description == "How far throttles are off."
    assert declared.worst == float("inf")
    assert not (declared.gated or declared.compared or declared.needs_prediction)
    assert MetricDeclaration("a", label="jerk", unit="m/s^3").title == "Jerk [m/s^3]"


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": "two words"}, "its name becomes a column"),
        ({"worst": float("nan")}, "worst is not a number"),
        ({"worst": "large"}, "worst is 'large', expected float"),
        ({"worst": True}, "worst is True"),
        ({"gated": 1}, "gated is 1, expected bool"),
        ({"summary": "mean"}, "known are: error, share"),
        ({"summary": "share", "compared": True}, "a share has no error to compare"),
        ({"summary": "share", "gated": True}, "a share has no error to compare"),
        ({"negligible": 0.0}, "expected more than 0"),
    ],
)
def test_a_bad_declaration_is_one_line(fields, text):
    with pytest.raises(UserError, match=r"^metric '") as caught:
        MetricDeclaration(**{"name": "m"} | fields)
    assert text in str(caught.value) and "\n" not in str(caught.value)


def test_a_metric_without_a_name_is_a_clear_line():
    with pytest.raises(UserError, match="metric Nameless has no name"):
        declare(type("Nameless", (), {}))
