"""How wide the prior of unseen starts is: errors of its mean, in standard deviations.

    python scripts/unseen_starts.py [--seeds 24]

The trials of the suite roads in its gappy view, at 0.05 and 0.5 m, with known target speeds. For
each player that the first sample misses, the true initial state less the prior's mean, over its
deviation (``estimators/shared/posterior_density.py``). Prints, for each road, noise level and
state, how many players there are, the root mean square and the largest.
"""

from collections.abc import Iterator

import shared
import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.plan.draws import opened
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.solved.kept_draws import travelling
from olne_bench.estimators.shared.posterior_density import start_prior
from olne_bench.estimators.shared.white_noise import with_white_noise

ROADS = ("highway", "merge", "two_way", "roundabout", "intersection")


def errors(seeds: int) -> Iterator[dict[str, object]]:
    """A row for each player and state."""
    chosen = Selection(
        scenarios=ROADS, sensors=("gappy",), sigmas=(0.05, 0.5), estimators=("uniform",)
    )
    for trial in tqdm(list(expand(select(load_suite("roads"), chosen), seeds)), disable=None):
        with travelling(opened(trial.draws)):
            try:
                case = case_of(trial)
            except NoEquilibriumError:
                continue
        problem, (seen,) = with_white_noise(case.problem, case.observations[0])
        start = start_prior(problem, seen)
        if start is None:
            continue
        away = (case.recordings[0].states[0] - start.mean) / start.deviation
        for player in np.flatnonzero(np.isfinite(start.deviation).all(axis=1)):
            for name, error in zip(problem.game.dynamics.state_names, away[player], strict=True):
                place = {"road": trial.scenario.label, "sigma": trial.sigma, "state": name}
                yield place | {"error": abs(error)}


def main(seeds: int = 24) -> None:
    """Command line."""
    table = pd.DataFrame(errors(seeds))
    groups = table.groupby(["road", "sigma", "state"], sort=False)["error"]
    shown = groups.agg(players="size", rms=lambda e: np.sqrt(np.mean(e**2)), largest="max")
    print(shown.round(2).to_string())


if __name__ == "__main__":
    shared.command(main)
