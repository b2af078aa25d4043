"""Rows of a plugin that are far better than noise lets any of its kind be.

Noise leaves no estimate without an error. Of 49,000 rows of this repository's studies with noise,
none has less than a hundredth of the median error of its estimator, scenario, sensor and noise
level. Rows with less than a thousandth are known by heart, unless fresh trials there are as good.
"""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.statistics.attempts import errors_of
from olne_bench.bench.report.submission.rows import Key, Rows

#: A row is implausible with less than this share of the median error beside it.
LEAST = 1e-3
#: Number of fresh trials beside implausible rows.
TRIALS = 24
#: Errors below are rounding [m].
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Implausible:
    """Implausible rows of an estimator.

    Attributes:
        estimator: label of the estimator.
        trials: trials of the rows.
        usual: median error of other rows beside each.
    """

    estimator: str
    trials: tuple[Trial, ...]
    usual: tuple[float, ...]

    def fresh(self) -> list[tuple[Trial, float]]:
        """Trials like these with fresh salts, each with the median error beside it."""
        salts = [secrets.token_hex(16) for _ in range(TRIALS // len(self.trials) + 1)]
        found = [
            (replace(trial, salt=salt), usual)
            for salt in salts
            for trial, usual in zip(self.trials, self.usual, strict=True)
        ]
        return found[:TRIALS]


def implausible_rows(
    trials: Sequence[Trial], rows: Rows, metric: MetricDeclaration
) -> Implausible | None:
    """The implausible rows among those of one estimator; None if there are none.

    Args:
        trials: its trials.
        rows: rows of the submission.
        metric: what estimators are ranked by.
    """
    table = rows.table.iloc[[rows.places[trial.key] for trial in trials]]
    errors = errors_of(table, metric)
    cells: dict[tuple[str, str, float], list[int]] = {}
    for k, trial in enumerate(trials):
        if trial.sigma > 0 and np.isfinite(errors[k]):
            place = (trial.scenario.label, trial.sensor.label, trial.sigma)
            cells.setdefault(place, []).append(k)
    found: dict[int, float] = {}
    for cell in cells.values():
        # The upper one of two: one of them may be known by heart.
        usual = float(np.quantile(errors[cell], 0.5, method="higher"))
        if usual > _ROUNDING:
            found |= {k: usual for k in cell if errors[k] < LEAST * usual}
    if not found:
        return None
    return Implausible(
        trials[0].estimator.label, tuple(trials[k] for k in found), tuple(found.values())
    )


def confirmed(
    found: Sequence[tuple[Trial, float]], outcomes: Mapping[Key, Outcome], metric: str
) -> bool:
    """Whether a fresh trial is as good as an implausible row."""
    for trial, usual in found:
        outcome = outcomes[trial.key]
        error = outcome.scores.get(metric)
        if outcome.status == "ok" and error is not None and error < LEAST * usual:
            return True
    return False
