"""Limits that an estimator must keep to be accepted."""

from typing import Any

from pydantic import Field, model_validator

from olne_bench.bench.plan.values import Bound, Label, Strict

#: Limits that do not depend on the metrics of a suite.
FIXED = ("identifiable_cosine_error", "limit_ratio", "failures", "published_failures", "time_ratio")


class GateLimits(Strict):
    """Limits for one estimator, in each scenario and sensor separately.

    Any other key in the table of a suite file is the column of a metric and limits its median.

    Attributes:
        scenarios: labels of the scenarios that count. Default: all.
        sensors: labels of the sensors that count. Default: all.
        identifiable_cosine_error: largest median.
        limit_ratio: largest mean cosine error over its statistical limit.
        failures: largest number of trials without a prediction.
        published_failures: largest number of failures by the published definition.
        time_ratio: largest median time over that of the estimator ``time_reference``.
        time_reference: label of an estimator of the same run.
        metrics: largest medians of metrics, by column.
    """

    scenarios: tuple[Label, ...] = ()
    sensors: tuple[Label, ...] = ()
    identifiable_cosine_error: Bound | None = None
    limit_ratio: Bound | None = None
    failures: int | None = Field(default=None, ge=0, strict=True)
    published_failures: int | None = Field(default=None, ge=0, strict=True)
    time_ratio: Bound | None = None
    time_reference: Label = ""
    metrics: dict[str, Bound] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _others_are_of_metrics(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "metrics" in data:
            return data
        own = {key: value for key, value in data.items() if key in cls.model_fields}
        return own | {"metrics": {key: data[key] for key in data if key not in own}}

    @model_validator(mode="after")
    def _times_have_a_reference(self) -> "GateLimits":
        if (self.time_ratio is None) != (not self.time_reference):
            raise ValueError("time_ratio and time_reference belong together")
        if not self.bounds:
            raise ValueError(f"no limit is set; limits are those of metrics, {', '.join(FIXED)}")
        return self

    @property
    def bounds(self) -> dict[str, float]:
        """The limits that are set, by name."""
        values = self.metrics | {name: getattr(self, name) for name in FIXED}
        return {name: value for name, value in values.items() if value is not None}
