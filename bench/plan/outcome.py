"""What becomes of a trial."""

from dataclasses import dataclass, field, fields

#: What can become of a trial. Everything but the first and the last two is a failure.
STATUSES = (
    "ok",
    "not_converged",  # the estimator says that its result is not valid
    "failed_forward",  # no root of the game at the estimated weights was found
    "timeout",  # killed at the time limit
    "crash",  # raised an exception or took its process down
    "invalid",  # returned something that is not an estimate
    "skipped",  # says that it does not support the problem
    "harness_error",  # the harness's own fault: no attempt of the estimator's
)
#: Those of attempts that failed.
FAILURES = tuple(s for s in STATUSES if s not in ("ok", "skipped", "harness_error"))


@dataclass(frozen=True)
class Outcome:
    """What a trial found.

    Attributes:
        status: one of ``STATUSES``.
        message: one line; empty where all is well.
        cosine_limit: the cosine error expected of an efficient estimator (Cramer-Rao bound).
        published_forward: 1 where the published study's own prediction step finds a root at the
            estimated weights, 0 where only another search does, or none
            (``games.nearest_root``).
        observation_error: mean absolute position noise [m] of the observation.
        objective: what the estimator minimised.
        truth_objective: sum of squared observation errors of the true trajectory, each over its
            noise scale.
        solve_seconds: wall-clock time of the estimate, solver construction excluded.
        weights: (N, K) nested list of estimated weights.
        extras: JSON text of what else the estimator says in finite numbers and short texts; None
            without any.
        scores: by column of a metric; None, or no entry, where it has nothing to say.
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
    extras: str | None = None
    scores: dict[str, float | None] = field(default_factory=dict)


_TEXTS = {"status", "message", "weights", "extras"}
#: Columns of a row that hold an outcome, and their SQL types; those of metrics follow.
OUTCOME_COLUMNS = {
    f.name: "TEXT" if f.name in _TEXTS else "REAL" for f in fields(Outcome) if f.name != "scores"
}
