"""Rules of metrics, as checks."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from olne_bench.bench.conformance import NonConformance
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.judge.metrics.scoring import MetricError, score_all
from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError
from olne_bench.estimators.protocol import COVARIANCE, Estimate
from olne_bench.games.solve.olne import solve_olne


def _declares(plugin: Any) -> None:
    """Its declaration is well-formed."""
    _declaration(plugin)


def _pure(plugin: Any) -> None:
    """A case always has the same score, whatever was scored before."""
    for case in _cases():
        first = _score(plugin, case)
        np.random.seed(1)  # noqa: NPY002 (a metric that uses it must not get away with it)
        second = _score(plugin, case)
        if first != second:
            raise NonConformance(f"two scores of one case differ: {first} and {second}")


def _ordered(plugin: Any) -> None:
    """Scores are numbers or None, none is above ``worst``, and an error is least at the truth."""
    declared = _declaration(plugin)
    best, *others = (_score(plugin, case) for case in _cases())
    for score in (best, *others):
        if score is not None and score > declared.worst:
            raise NonConformance(f"it scores {score}, beyond its worst value {declared.worst:g}")
    if declared.summary != "error" or best is None:
        return
    for score in others:
        if score is not None and score < best:
            raise NonConformance(
                f"it scores {best} at the truth and {score} away from it: an error is least at "
                "the truth"
            )


def _declaration(plugin: Any) -> MetricDeclaration:
    try:
        return declare(plugin)
    except UserError as error:
        raise NonConformance(str(error)) from error


def _score(plugin: Any, case: Judged) -> float | None:
    try:
        (score,) = score_all([plugin], case).values()
    except MetricError as error:
        raise NonConformance(str(error)) from error
    return score


@cache
def _cases() -> tuple[Judged, ...]:
    """The truth as an estimate, another estimate, and one without a prediction."""
    recording = record(get_scenario("random", 0, num_players=2))
    scenario = recording.scenario
    away = scenario.weights[:, ::-1]
    predicted = solve_olne(scenario.game, away, scenario.initial_state).states
    return (
        _case(recording, scenario.weights, recording.states),
        _case(recording, away, predicted),
        _case(recording, away, None),
    )


def _case(recording: Any, weights: np.ndarray, states: np.ndarray | None) -> Judged:
    size = weights.size
    spread = 1e-4 * (np.eye(size) - np.kron(np.eye(len(weights)), np.full((4, 4), 0.25)))
    estimate = Estimate(
        weights=weights.copy(),
        states=None if states is None else states.copy(),
        covariance=spread,
        region=COVARIANCE,
        extras={"objective": math.nan},
    )
    return Judged((recording,), estimate, None if states is None else states.copy(), sigma=0.01)


#: Checks by name, in the order in which they run.
CHECKS: dict[str, Callable[[Any], None]] = {
    "declaration is well-formed": _declares,
    "pure": _pure,
    "numbers, best at the truth": _ordered,
}
