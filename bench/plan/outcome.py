"""Outcomes of trials."""

from dataclasses import dataclass, field, fields

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
    """The outcome of a trial.

    Attributes:
        status: one of ``STATUSES``.
        message: one line; empty if there is nothing to say.
        cosine_limit: the cosine error expected of an efficient estimator (Cramer-Rao bound).
        published_forward: 1 if the published study's prediction step finds a root at the estimated
            weights; 0 if only another search finds one, or none does
            (``games.solve.nearest_root``).
        observation_error: mean absolute position noise [m] of the observation.
        objective: what the estimator minimised.
        truth_objective: sum of squared observation errors of the true trajectory, each over its
            noise scale.
        solve_seconds: wall-clock time of the estimate, solver construction excluded.
        weights: (N, K) nested list of estimated weights.
        unknowns: (N, U) nested list of what was estimated besides weights, each in its unit; None
            if the game has no unknowns.
        weight_levels: (N, K) nested list: the estimate's probability that each weight is below its
            true value; None if it says nothing about single weights.
        extras: JSON text of the estimator's other finite numbers and short texts; None if there
            are none.
        scores: score by metric column; None, or no entry, where a metric does not apply.
        trial_seconds: wall-clock time of the whole trial; no column has it, but sums are kept.
    """

    status: str
    message: str = ""
    cosine_limit: float | None = None
    published_forward: int | None = None
    observation_error: float | None = None
    objective: float | None = None
    truth_objective: float | None = None
    solve_seconds: float | None = None
    weights: list[list[float]] | None = None
    unknowns: list[list[float]] | None = None
    weight_levels: list[list[float]] | None = None
    extras: str | None = None
    scores: dict[str, float | None] = field(default_factory=dict)
    trial_seconds: float | None = field(default=None, compare=False)


#: Columns of nested lists, which a store keeps as JSON text.
NESTED = ("weights", "unknowns", "weight_levels")
_NO_COLUMNS = ("scores", "trial_seconds")
_TEXTS = {"status", "message", "extras", *NESTED}
#: Columns of a row that hold an outcome, and their SQL types; those of metrics follow.
OUTCOME_COLUMNS = {
    f.name: "TEXT" if f.name in _TEXTS else "REAL"
    for f in fields(Outcome)
    if f.name not in _NO_COLUMNS
}
