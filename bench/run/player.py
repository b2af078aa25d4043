"""The code inside a player process: one estimator, its problem and what is seen, nothing else."""

import pickle
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError, RawEstimate, read_estimate
from olne_bench.bench.text import clip
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.incoming_samples import (
    Stream,
    as_stream_estimator,
    warm_up_stream,
)

if TYPE_CHECKING:  # what it imports takes long, and a player needs none of it
    from olne_bench.bench.judge.players import PlayerTask

#: Share of the time limit that an estimate may spend, so that it can say that its time has ended.
BUDGET = 0.8


class Said(msgspec.Struct, forbid_unknown_fields=True):
    """What a player process says: whether it is prepared, or an estimate.

    Attributes:
        declined: why the estimator declines the problem; None if it does not.
        estimate: an estimate.
        malformed: why the returned value is not one.
    """

    declined: str | None = None
    estimate: RawEstimate | None = None
    malformed: str = ""


class Libraries(msgspec.Struct):
    """Names of the modules that a plugin imports, but for its own."""

    names: list[str]


@dataclass
class _Seat:
    reference: str
    estimator: Any
    problem: Problem
    given: dict[str, str]
    rng: np.random.Generator
    stream: Stream | None


_seat: _Seat | None = None


def told(task: "PlayerTask") -> tuple[Any, ...]:
    """The arguments of ``prepare`` for a task."""
    return (
        *(task.reference, task.parameters, task.homes, pickle.dumps(task.problem)),
        *(task.seed, len(task.observations), task.lag),
    )


def prepare(
    reference: str,
    parameters: dict[str, Any],
    homes: Sequence[str],
    problem: bytes,
    seed: int,
    trajectories: int,
    lag: int | None = None,
) -> Said:
    """Construct the estimator and let it prepare for a problem.

    Args:
        reference: name or file of the estimator.
        parameters: parameters of the estimator.
        homes: files of other plugins whose classes the problem contains.
        problem: the problem, pickled by the referee.
        seed: seed of the estimator's random numbers.
        trajectories: number of observations that will follow; 0 for a motion sample by sample.
        lag: number of latest samples that count then; None for all.
    """
    global _seat
    for home in homes:
        plugins.import_file(home)
    given: Problem = pickle.loads(problem)
    described = describe_problem(reference, given)
    estimator: Any = plugins.make(plugins.ESTIMATOR, reference, parameters)
    rng, stream = np.random.default_rng(seed), None
    with plugins.at_home(estimator):
        if reason := why_declined(estimator, given, trajectories):
            return Said(declined=reason)
        if not trajectories:
            warm_up_stream(estimator, given, lag)
            stream = as_stream_estimator(estimator).start(given, rng=rng, lag=lag)
        elif hasattr(estimator, "warm_up"):
            estimator.warm_up(given)
    _seat = _Seat(reference, estimator, given, described, rng, stream)
    return Said()


def why_declined(estimator: Any, problem: Problem, trajectories: int) -> str:
    """Why an estimator does not take a problem, on one line; empty if it does."""
    reason = estimator.supports(problem) if hasattr(estimator, "supports") else None
    if trajectories > 1 and not getattr(estimator, "several", False):
        reason = f"takes one trajectory at a time, not {trajectories}"
    elif trajectories > 1 and not reason and hasattr(estimator, "supports_several"):
        reason = estimator.supports_several(problem)
    return clip(str(reason)) if reason else ""


def libraries(reference: str, parameters: dict[str, Any]) -> Libraries:
    """The modules that an estimator's plugin imports, in their order."""
    before = set(sys.modules)
    with plugins.at_home(plugins.make(plugins.ESTIMATOR, reference, parameters)):
        own = set(sys.modules) - before
    return Libraries([name for name in list(sys.modules) if name in own])


def estimate(observations: tuple[Observation, ...], budget: float) -> Said:
    """Make one estimate for the prepared problem.

    Args:
        observations: one for each trajectory.
        budget: time that its search may take [s]; it is stopped from outside later.
    """
    assert _seat is not None
    for one in observations:
        for array in (one.y, one.extra):
            if array is not None:
                array.setflags(write=False)  # writing into its input raises an exception
    seen = observations if len(observations) > 1 else observations[0]
    with plugins.at_home(_seat.estimator):
        result = _seat.estimator.estimate(_seat.problem, seen, rng=_seat.rng, budget=budget)
        return _read(_seat, result)


def update(sample: np.ndarray, budget: float) -> Said:
    """Show the next sample (N, d) of the motion; ``budget`` is as of ``estimate``."""
    assert _seat is not None and _seat.stream is not None
    sample.setflags(write=False)  # writing into its input raises an exception
    with plugins.at_home(_seat.estimator):
        return _read(_seat, _seat.stream.update(sample, budget=budget))


def _read(seat: _Seat, result: Any) -> Said:
    """A result, unless the estimator has changed the problem."""
    if changed := changes(seat.reference, seat.problem, seat.given):
        return Said(malformed=changed)
    try:
        return Said(estimate=read_estimate(result))
    except InvalidEstimateError as error:
        return Said(malformed=clip(str(error)))


def describe_problem(reference: str, problem: Problem) -> dict[str, str]:
    """What a problem says, field by field; nothing for a built-in estimator, which changes none."""
    if plugins.is_built_in(plugins.ESTIMATOR, reference):
        return {}
    whole = {f"problem.{f.name}": getattr(problem, f.name) for f in fields(problem)}
    game = whole.pop("problem.game")
    whole |= {f"problem.game.{f.name}": getattr(game, f.name) for f in fields(game)}
    return {place: repr(value) for place, value in whole.items()}


def changes(reference: str, problem: Problem, given: dict[str, str]) -> str:
    """What an estimator has changed in a problem, of which ``given`` is the description."""
    now = describe_problem(reference, problem)
    changed = [place for place, text in now.items() if text != given[place]]
    return f"it changes the problem: {', '.join(changed)}" if changed else ""
