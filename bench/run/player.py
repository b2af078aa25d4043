"""The code inside a player process: one estimator with a problem and observations, nothing else."""

import pickle
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError, RawEstimate, read_estimate
from olne_bench.bench.text import clip
from olne_bench.estimators.protocol import Observation, Problem


class Prepared(msgspec.Struct):
    """Ready to estimate, or the reason why the estimator declines the problem."""

    declined: str | None


class Answered(msgspec.Struct):
    """An estimate, or the reason why the returned value is not one."""

    estimate: RawEstimate | None
    malformed: str = ""


class Libraries(msgspec.Struct):
    """Names of the modules that a plugin imports, but for its own."""

    names: list[str]


@dataclass
class _Seat:
    estimator: Any
    problem: Problem


_seat: _Seat | None = None


def prepare(
    reference: str,
    parameters: dict[str, Any],
    homes: Sequence[str],
    problem: bytes,
    trajectories: int,
) -> Prepared:
    """Construct the estimator and let it prepare for a problem.

    Args:
        reference: name or file of the estimator.
        parameters: parameters of the estimator.
        homes: files of other plugins whose classes the problem contains.
        problem: the problem, pickled by the referee.
        trajectories: number of observations that will follow.
    """
    global _seat
    for home in homes:
        plugins.import_file(home)
    given: Problem = pickle.loads(problem)
    estimator: Any = plugins.make(plugins.ESTIMATOR, reference, parameters)
    with plugins.at_home(estimator):
        reason = estimator.supports(given) if hasattr(estimator, "supports") else None
        if trajectories > 1 and not getattr(estimator, "several", False):
            reason = f"takes one trajectory at a time, not {trajectories}"
        elif trajectories > 1 and not reason and hasattr(estimator, "supports_several"):
            reason = estimator.supports_several(given)
        if reason:
            return Prepared(clip(str(reason)))
        if hasattr(estimator, "warm_up"):
            estimator.warm_up(given)
    _seat = _Seat(estimator, given)
    return Prepared(None)


def libraries(reference: str, parameters: dict[str, Any]) -> Libraries:
    """The modules that an estimator's plugin imports, in their order.

    Args:
        reference: name or file of the estimator.
        parameters: parameters of the estimator.
    """
    before = set(sys.modules)
    with plugins.at_home(plugins.make(plugins.ESTIMATOR, reference, parameters)):
        own = set(sys.modules) - before
    return Libraries([name for name in list(sys.modules) if name in own])


def estimate(observations: tuple[Observation, ...], seed: int, budget: float) -> Answered:
    """Make one estimate for the prepared problem.

    Args:
        observations: one for each trajectory.
        seed: seed of the estimator's random numbers.
        budget: time that its search may take [s]; it is stopped from outside later.
    """
    assert _seat is not None
    for one in observations:
        for array in (one.y, one.extra):
            if array is not None:
                array.setflags(write=False)  # writing into its input raises an exception
    with plugins.at_home(_seat.estimator):
        result = _seat.estimator.estimate(
            _seat.problem,
            observations if len(observations) > 1 else observations[0],
            rng=np.random.default_rng(seed),
            budget=budget,
        )
        try:
            return Answered(read_estimate(result))
        except InvalidEstimateError as error:
            return Answered(None, clip(str(error)))
