"""The referee of motions that go on: it hands out one sample at a time and scores each estimate.

A player has the problem and the samples so far, so no estimate can depend on what comes later. An
estimate counts if it is there before the next sample; until one is, the one before it counts.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace

import msgspec
import numpy as np

from olne_bench.bench.judge.cloned_policy import policy_of
from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.bench.judge.players import (
    Announce,
    Answer,
    PlayerFault,
    PlayerTask,
    Staff,
    StreamPlayer,
    longest_seconds,
    silent,
)
from olne_bench.bench.judge.predictions import (
    drive_as_cloned,
    drive_as_fitted,
    drive_as_stock,
    drive_on,
    play_on,
    turn_on,
)
from olne_bench.bench.judge.priors import exclusion
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.bench.judge.seeds import stream
from olne_bench.bench.judge.trials import Case, case_of, fit_p
from olne_bench.bench.plan.kinds import (
    CLONED,
    CONSTANT_VELOCITY,
    STOCK,
    STOCK_FITTED,
    TRUE_WEIGHTS,
    Rules,
)
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.text import clip
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.worlds.scene import is_on_road
from olne_bench.estimators.protocol import Estimate

#: How far ahead predictions are scored [s].
AHEAD = (1.0, 2.0, 3.0, 4.0)

#: Longest time [s] of one prediction that estimators are compared with, as machines may be busy.
_PREDICTION_SECONDS = 1800.0

#: Columns of the errors of predictions.
ERROR_COLUMNS = tuple(f"{kind}_{ahead:g}s" for ahead in AHEAD for kind in ("ade", "fde"))


@dataclass(frozen=True)
class Update:
    """What became of one sample."""

    sample: int  # number of samples so far
    time: float  # of the sample, since the first one [s]
    status: str  # as of trials (``plan.outcome.STATUSES``)
    message: str = ""
    latency: float | None = None  # from sending the sample to receiving the estimate [s]
    late: bool = False  # whether that was longer than the time until the next sample
    #: number of samples of the estimate that counts now; None while there is none
    counted: int | None = None
    cosine_error: float | None = None  # of the weights that count
    prior_error: float | None = None  # cosine error of uniform weights
    #: distance [m] of predicted from true positions, mean over players, by column: ``fde_1s`` after
    #: a second, ``ade_1s`` the mean up to then; none beyond the horizon
    errors: dict[str, float] = field(default_factory=dict)
    fit_p: float | None = None  # with the last sample: whether noise explains the residuals of all


def judge(motion: Trial, staff: Staff) -> Outcome:
    """Judge an estimator on one motion, or what estimators are compared with.

    The status is the first that is not ``ok``; ``extras`` has a row a sample, as JSON text. A draw
    without an equilibrium is ``skipped``.
    """
    try:
        rows = list(follow(motion, staff.player, staff.announce))
    except NoEquilibriumError as error:
        return Outcome("skipped", clip(str(error)))
    if not rows:
        return Outcome("skipped", f"{motion.reference} has no prediction here")
    told = next((row for row in rows if row.status != "ok"), rows[0])
    text = msgspec.json.encode([asdict(row) for row in rows]).decode()
    return Outcome(told.status, told.message, fit_p=rows[-1].fit_p, extras=text)


def follow(motion: Trial, player: StreamPlayer, announce: Announce = silent) -> Iterator[Update]:
    """Judge an estimator on one motion, or what estimators are compared with; a row a sample.

    Raises ``NoEquilibriumError`` if the scenario has no certified equilibrium.
    """
    case = case_of(motion)
    if motion.reference:
        yield from _reference_updates(motion, case, announce)
        return
    excluded = exclusion(motion.estimator, case.recordings[0].scenario, case.problem.prior)
    if excluded:
        yield from _all_alike(case, "invalid", excluded)
        return
    announce("estimate", longest_seconds(motion))
    try:
        seed = stream(motion.salt, "online", *motion.key)
        task = PlayerTask.of(motion, case.problem, seed, lag=motion.rules.lag)
        declined = player.start(task)
    except PlayerFault as fault:
        yield from _all_alike(case, fault.status, str(fault))
        return
    if declined is not None:
        yield from _all_alike(case, "skipped", declined)
        return
    for row in _Episode(case, player, motion.rules).updates():
        yield row
        announce("estimate", longest_seconds(motion))


def _reference_updates(motion: Trial, case: Case, announce: Announce) -> Iterator[Update]:
    """The rows of one of ``REFERENCES``; none where it makes no sense.

    Drivers are fitted after some samples only, as that takes up to a minute, and only where a
    prediction can be scored.
    """
    name, samples = motion.reference, len(case.recordings[0].states)
    of_roads = name in (STOCK, STOCK_FITTED)
    if of_roads and not is_on_road(case.recordings[0].scenario):
        return  # they drive on its roads only
    if name == CLONED and policy_of(case.problem.game) is None:
        return  # nobody was cloned there
    every = motion.rules.fit_every or 1 if name == STOCK_FITTED else 1
    scored = round(min(AHEAD) / case.problem.game.dt)
    last = samples - scored if name == STOCK_FITTED else samples
    for count in range(every, last + 1, every):
        announce("prediction", _PREDICTION_SECONDS)
        states = _referred(case, name, case.observations[0].y[:count])
        yield Update(
            sample=count,
            time=_time(case, count),
            status="failed_forward" if states is None else "ok",
            errors={} if states is None else prediction_errors(case, states, count),
        )


def _referred(case: Case, name: str, seen: np.ndarray) -> np.ndarray | None:
    """States (T, N, n) that one of ``REFERENCES`` predicts; None if it finds none."""
    scenario = case.recordings[0].scenario
    if name == TRUE_WEIGHTS:
        return play_on(case.problem, seen, scenario.weights, scenario.parameters)
    if name == CLONED:
        return drive_as_cloned(case.problem, seen)
    if name in (STOCK, STOCK_FITTED):
        drive = drive_as_stock if name == STOCK else drive_as_fitted
        return drive(scenario.name, case.problem, seen)
    go_on = drive_on if name == CONSTANT_VELOCITY else turn_on
    return go_on(case.problem, seen)


def prediction_errors(case: Case, states: np.ndarray, count: int) -> dict[str, float]:
    """Errors of states (T, N, n) after so many samples, by column."""
    truth, dt = case.recordings[0].states, case.problem.game.dt
    distances = np.linalg.norm(states[count:, :, :2] - truth[count:, :, :2], axis=-1).mean(axis=1)
    errors: dict[str, float] = {}
    for ahead in AHEAD:
        steps = round(ahead / dt)
        if 1 <= steps <= len(distances):
            errors[f"ade_{ahead:g}s"] = float(distances[:steps].mean())
            errors[f"fde_{ahead:g}s"] = float(distances[steps - 1])
    return errors


def _all_alike(case: Case, status: str, message: str) -> Iterator[Update]:
    """Rows of a motion on which the estimator never began."""
    for count in range(1, len(case.observations[0].y) + 1):
        yield Update(count, _time(case, count), status, clip(message))


def _time(case: Case, count: int) -> float:
    return float((count - 1) * case.problem.game.dt)


class _Counting:
    """The estimate that counts, and what it predicts."""

    def __init__(self, case: Case, estimate: Estimate, count: int) -> None:
        seen = case.observations[0].y[:count]
        self.count, self.weights = count, estimate.weights
        self.states = estimate.states
        if self.states is None:
            self.states = play_on(case.problem, seen, estimate.weights, estimate.parameters)


class _Episode:
    """One motion and the estimates of it."""

    def __init__(self, case: Case, player: StreamPlayer, rules: Rules) -> None:
        self._case, self._player = case, player
        self._deadline = rules.deadline or case.problem.game.dt
        self._forgets = rules.lag is not None
        self._counting: _Counting | None = None

    def updates(self) -> Iterator[Update]:
        """A row for each sample; after a fault there are no further estimates."""
        lost: PlayerFault | None = None
        for count, sample in enumerate(self._case.observations[0].y, start=1):
            if lost is None:
                try:
                    yield self._updated(count, self._player.update(sample.copy()))
                    continue
                except PlayerFault as fault:
                    lost = fault
            yield self._row(count, lost.status, str(lost), None)

    def _updated(self, count: int, answer: Answer) -> Update:
        assert answer.estimate is not None
        try:
            estimate = check_estimate(answer.estimate, self._case.problem)
        except InvalidEstimateError as error:
            return self._row(count, "invalid", str(error), answer.seconds)
        if not estimate.converged:
            message = estimate.message or "the estimator gives no reason"
            return self._row(count, "not_converged", message, answer.seconds)
        found = _Counting(self._case, estimate, count)
        if answer.seconds <= self._deadline:
            self._counting = found
        row = self._row(count, "ok", estimate.message, answer.seconds)
        self._counting = found  # a late one counts from the next sample on
        if count < len(self._case.observations[0].y) or self._forgets:
            return row
        return replace(row, fit_p=fit_p(estimate, self._case))

    def _row(self, count: int, status: str, message: str, seconds: float | None) -> Update:
        counting, weights = self._counting, self._case.recordings[0].scenario.weights
        errors: dict[str, float] = {}
        if counting is not None and counting.states is not None:
            errors = prediction_errors(self._case, counting.states, count)
        return Update(
            sample=count,
            time=_time(self._case, count),
            status=status,
            message=clip(message),
            latency=seconds,
            late=seconds is not None and seconds > self._deadline,
            counted=None if counting is None else counting.count,
            cosine_error=None if counting is None else cosine_error(weights, counting.weights),
            prior_error=cosine_error(weights, np.ones_like(weights)),
            errors=errors,
        )
