"""Outcomes of trials."""

from dataclasses import dataclass, field, fields
from typing import Any

#: Statuses of a trial. All but the first and the last two are failures.
STATUSES = (
    "ok",
    "not_converged",  # the estimator says that its result is not valid
    "failed_forward",  # no root of the game at the estimated weights was found
    "timeout",  # killed at the time limit
    "crash",  # raised an exception or took its process down
    "invalid",  # returned something that is not an estimate
    "skipped",  # says that it does not support the problem
    "harness_error",  # the harness failed; not an attempt of the estimator
)
#: Statuses of failed attempts.
FAILURES = tuple(s for s in STATUSES if s not in ("ok", "skipped", "harness_error"))
#: Values of ``--retry``: all failures of estimators, one kind of them, or errors of the harness.
RETRIES = ("failed", *FAILURES, "harness_error")


@dataclass(frozen=True)
class Outcome:
    """The outcome of a trial."""

    status: str  # one of ``STATUSES``
    message: str = ""  # one line; empty if there is nothing to say
    cosine_limit: float | None = None  # error expected of an efficient estimator (Cramer-Rao bound)
    # 1 if the published study's prediction step finds a root at the estimated weights, else 0
    published_forward: int | None = None
    observation_error: float | None = None  # mean absolute position noise [m]
    objective: float | None = None  # what the estimator minimised
    # sum of squared errors of the observation about the true trajectory, over noise scales
    truth_objective: float | None = None
    solve_seconds: float | None = None  # wall-clock time of the estimate, without building solvers
    # whether noise explains the residuals (``estimators.shared.fit_test``); None if not testable
    fit_p: float | None = None
    weights: list[list[float]] | None = None  # (N, K)
    # (N, U), each in its unit; None if the game has no unknowns
    unknowns: list[list[float]] | None = None
    # (N, K) probability that a weight is below its true value, by the estimate; or None
    weight_levels: list[list[float]] | None = None
    extras: str | None = None  # JSON of the estimator's other finite numbers and short texts
    # by metric column; None, or no entry, where it does not apply
    scores: dict[str, float | None] = field(default_factory=dict)
    # of the whole trial; no column has it, but sums are kept
    trial_seconds: float | None = field(default=None, compare=False)
    # truth of its draw and sensor (``bench.judge.scene``), once from each process; its prediction
    scene: bytes | None = field(default=None, compare=False, repr=False)
    motion: bytes | None = field(default=None, compare=False, repr=False)

    @property
    def columns(self) -> dict[str, Any]:
        """The values of ``OUTCOME_COLUMNS``."""
        return {name: getattr(self, name) for name in OUTCOME_COLUMNS}


#: Columns of nested lists, which a store keeps as JSON text.
NESTED = ("weights", "unknowns", "weight_levels")
_NO_COLUMNS = ("scores", "trial_seconds", "scene", "motion")
_TEXTS = {"status", "message", "extras", *NESTED}
#: Columns of a row that hold an outcome, and their SQL types; those of metrics follow.
OUTCOME_COLUMNS = {
    f.name: "TEXT" if f.name in _TEXTS else "REAL"
    for f in fields(Outcome)
    if f.name not in _NO_COLUMNS
}
