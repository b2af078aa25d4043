"""Declarations of metrics, used by all tables, figures, pages, gates and comparisons."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from olne_bench.errors import UserError

#: How trials are summarised: errors by quantiles and a mean, a share (of 0 and 1) by its mean. A
#: level is a probability whose distribution tells of calibration; it has figures of its own.
SUMMARIES = ("error", "share", "level")


@dataclass(frozen=True)
class MetricDeclaration:
    """What a report needs to know about a metric. All fields are plain data.

    Attributes:
        name: column in tables of trials, and name of limits in a suite's gate.
        label: name for people. Default: ``name`` with spaces.
        unit: unit of the values, such as ``m``; empty if they have none.
        worst: largest possible value; means count each failure as this value.
        needs_prediction: whether it is computed from the forward game at the estimated weights; a
            trial without a prediction then counts as a failure.
        gated: whether a suite's gate may limit it.
        compared: whether estimators, and runs, are compared and ranked by it.
        drawn: whether the figure of errors has a row for it.
        radius: whether discs of this radius [m] around predicted positions hold all players.
        summary: one of ``SUMMARIES``.
        negligible: errors below are rounding of solvers; figures draw them at the lower edge.
        description: one sentence.
    """

    name: str
    label: str = ""
    unit: str = ""
    worst: float = math.inf
    needs_prediction: bool = False
    gated: bool = False
    compared: bool = False
    drawn: bool = True
    radius: bool = False
    summary: str = "error"
    negligible: float = 1e-9
    description: str = ""

    def __post_init__(self) -> None:
        problem = _problem(self)
        if problem:
            raise UserError(f"metric {self.name!r}: {problem}")
        if not self.label:
            object.__setattr__(self, "label", self.name.replace("_", " "))

    @property
    def is_share(self) -> bool:
        """Whether trials are summarised by a share."""
        return self.summary == "share"

    @property
    def is_level(self) -> bool:
        """Whether trials are summarised by the distribution of a level."""
        return self.summary == "level"

    @property
    def title(self) -> str:
        """Label with unit, such as ``Position error [m]``."""
        text = self.label[:1].upper() + self.label[1:]
        return f"{text} [{self.unit}]" if self.unit else text

    def stored(self) -> dict[str, Any]:
        """All fields, as a suite stores them; ``declaration_from`` reads them."""
        return asdict(self)


def declare(metric: Any) -> MetricDeclaration:
    """The declaration of a metric, read from the attributes and docstring of a class or instance.

    Raises:
        UserError: on a value that a declaration cannot have.
    """
    given = {
        f.name: getattr(metric, f.name)
        for f in fields(MetricDeclaration)
        if getattr(metric, f.name, None) is not None
    }
    if "name" not in given:
        raise UserError(f"metric {getattr(metric, '__name__', type(metric).__name__)} has no name")
    lines = [line.strip() for line in (getattr(metric, "__doc__", None) or "").strip().splitlines()]
    summary = " ".join(lines[: lines.index("")] if "" in lines else lines)
    return MetricDeclaration(**{"description": summary} | given)


def declaration_from(stored: Mapping[str, Any]) -> MetricDeclaration:
    """A declaration that a suite stored; fields that other versions added are ignored.

    Raises:
        UserError: on a value that a declaration cannot have.
    """
    known = {f.name for f in fields(MetricDeclaration)}
    # JSON has no infinity, so some writers leave null in its place.
    return MetricDeclaration(**{k: v for k, v in stored.items() if k in known and v is not None})


def _problem(declared: MetricDeclaration) -> str:
    """What is wrong with a declaration; empty if nothing is."""
    if not isinstance(declared.name, str) or not declared.name.isidentifier():
        return "its name becomes a column, so it has letters, digits and underscores only"
    for field in fields(declared)[1:]:  # each but the name has a default of its kind
        value, kind = getattr(declared, field.name), type(field.default)
        if not isinstance(value, (float, int) if kind is float else kind) or (
            kind is not bool and isinstance(value, bool)
        ):
            return f"{field.name} is {value!r}, expected {kind.__name__}"
    if math.isnan(declared.worst):
        return "worst is not a number"
    if declared.summary not in SUMMARIES:
        return f"summary is {declared.summary!r}; known are: {', '.join(SUMMARIES)}"
    if declared.summary != "error" and (declared.compared or declared.gated):
        return "a share has no error to compare or to limit; it cannot be compared or gated"
    if not declared.negligible > 0:
        return f"negligible is {declared.negligible!r}, expected more than 0"
    return ""
