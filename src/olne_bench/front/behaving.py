"""Which behaviour explains observations, in this process."""

import time
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import softmax

from olne_bench.estimators.behaving import OPEN_LOOP, explained, unsupported
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.noise_level import with_found_noise
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.solve.behaviours import BEHAVIOURS

#: All behaviours.
KNOWN = (OPEN_LOOP, *BEHAVIOURS)


def behaviours(
    problem: Problem,
    observation: Observation,
    names: Sequence[str] = KNOWN,
    *,
    budget: float = 300.0,
) -> pd.DataFrame:
    """Compare behaviours of the players by how probable they make the observations.

    Args:
        problem: what is known.
        observation: what was seen.
        names: of behaviours, ``open_loop`` and those of ``games.solve.behaviours``.
        budget: time that the search may take [s].

    Returns:
        A row for each behaviour, the most probable first: ``log_evidence``, less the largest;
        ``probability``, where all are as likely before, both NaN where no motion of the behaviour
        is found; ``residual``, the root mean square of what its best motion leaves, in metres (and
        units of the noise scale).

    Raises:
        ValueError: on an unknown behaviour, or a game with constraints or unknown numbers.
    """
    for name in names:
        if name not in KNOWN:
            raise ValueError(f"unknown behaviour {name!r}; known are: {', '.join(KNOWN)}")
    if reason := unsupported(problem):
        raise ValueError(reason)
    deadline = time.monotonic() + budget
    white, (seen,) = with_white_noise(problem, observation)
    found = explained(with_found_noise(white, (seen,), deadline), seen, deadline, names)
    evidence = np.array([found[name].log_evidence for name in names])
    if not np.isfinite(evidence).any():
        raise ValueError(
            f"no behaviour explains the observations: {found[names[0]].estimate.message}"
        )
    known_ones = np.isfinite(evidence)
    probability = np.full(len(names), np.nan)
    probability[known_ones] = softmax(evidence[known_ones])
    squares = [found[name].estimate.extras.get("objective", np.nan) for name in names]
    table = pd.DataFrame(
        {
            "behaviour": list(names),
            "log_evidence": evidence - np.nanmax(evidence),
            "probability": probability,
            "residual": np.sqrt(np.array(squares) / np.isfinite(seen.y).sum()),
        }
    )
    return table.sort_values("log_evidence", ascending=False, ignore_index=True)
