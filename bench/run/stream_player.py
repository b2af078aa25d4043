"""The code inside a player process that follows a motion: one estimator and the samples so far."""

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError, read_estimate
from olne_bench.bench.run.player import Answered, Prepared, changes, describe_problem
from olne_bench.bench.text import clip
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.stream import Stream, as_stream_estimator, warm_up_stream


@dataclass
class _Seat:
    reference: str
    estimator: Any
    problem: Problem
    given: dict[str, str]
    stream: Stream


_seat: _Seat | None = None


def begin(
    reference: str,
    parameters: dict[str, Any],
    homes: Sequence[str],
    problem: bytes,
    lag: int | None,
    seed: int,
) -> Prepared:
    """Construct the estimator, let it prepare for a problem, and begin a stream.

    Args:
        reference: name or file of the estimator.
        parameters: parameters of the estimator.
        homes: files of other plugins whose classes the problem contains.
        problem: the problem, pickled by the referee.
        lag: number of latest samples that count; None for all.
        seed: seed of the estimator's random numbers.
    """
    global _seat
    _seat = None
    for home in homes:
        plugins.import_file(home)
    given: Problem = pickle.loads(problem)
    described = describe_problem(reference, given)
    estimator: Any = plugins.make(plugins.ESTIMATOR, reference, parameters)
    with plugins.at_home(estimator):
        reason = estimator.supports(given) if hasattr(estimator, "supports") else None
        if reason:
            return Prepared(clip(str(reason)))
        warm_up_stream(estimator, given, lag)
        rng = np.random.default_rng(seed)
        stream = as_stream_estimator(estimator).start(given, rng=rng, lag=lag)
    _seat = _Seat(reference, estimator, given, described, stream)
    return Prepared(None)


def update(sample: np.ndarray, budget: float) -> Answered:
    """Show the next sample.

    Args:
        sample: (N, d).
        budget: time that the estimate may take [s]; it is stopped from outside later.
    """
    assert _seat is not None
    sample.setflags(write=False)  # writing into its input raises an exception
    with plugins.at_home(_seat.estimator):
        result = _seat.stream.update(sample, budget=budget)
        if changed := changes(_seat.reference, _seat.problem, _seat.given):
            return Answered(None, changed)
        try:
            return Answered(read_estimate(result))
        except InvalidEstimateError as error:
            return Answered(None, clip(str(error)))
