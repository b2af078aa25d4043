"""Posterior samples against long Markov chains, by a classifier (C2ST).

    pip install -e ".[references]"
    python scripts/reference_posteriors.py two_player --observations 10

Each observation has a draw (``posterior_draws``), a view and a noise level of its own.
``manifold_chains`` samples the same density as ``posterior`` by another method, and starts at the
same peaks; where its chains disagree (R-hat), they are run again with twice as many steps, up to
``--most``. A network learns to tell 1,000 samples of the weights of one from those of the other
(Lopez-Paz and Oquab 2017): a share of right answers of 0.5 means that it cannot. Prints a line per
observation, and writes the chains' samples to results/calibration/references_SCENARIO.parquet. If
``--out`` has that file, the command goes on with it.
"""

import time
from itertools import cycle, product
from pathlib import Path
from typing import Annotated, Any

import shared
import arviz
import numpy as np
import pandas as pd
from manifold_chains import run_chains
from posterior_draws import SIGMAS, Draw, PosteriorOfDraws, draws
from sklearn.model_selection import StratifiedKFold, cross_val_score
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from olne_bench.estimators.shared.perturbed_fits import Peak
from olne_bench.estimators.shared.posterior_density import GameDensity

FOLDER = Path(__file__).parents[1] / "results" / "calibration"
#: Seed of the first draw. `scripts/posterior_calibration.py` uses others.
FIRST = 7000
KEPT = 1000  # samples of each observation
AGREED = 1.05  # R-hat of chains that agree


def main(
    scenario: Annotated[str, SIGMAS],
    observations: int = 10,
    chains: int = 40,
    steps: int = 500,
    most: int = 4000,  # steps where chains disagree
    out: Path = FOLDER,
) -> None:
    """Command line."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"references_{scenario}.parquet"
    rows: list[Any] = pd.read_parquet(path).to_dict("records") if path.exists() else []
    print("seed view    sigma   C2ST  peaks  R-hat   ESS  accepted  ESS of posterior  seconds")
    cells = list(product(("full", "partial"), SIGMAS[scenario]))
    some = draws(scenario, range(FIRST, FIRST + observations))
    for number, (draw, (view, sigma)) in enumerate(zip(some, cycle(cells), strict=False)):
        if number == len(rows):
            row = _row(draw, view, sigma, (chains, steps, most))
            rows.append({"scenario": scenario} | row)
            # samples hardly repeat, so a dictionary of them would only take room
            pd.DataFrame(rows).to_parquet(path, compression="zstd", use_dictionary=False)
        print(rows[number]["line"], flush=True)
    scores = [row["c2st"] for row in rows]
    print(f"C2ST: median {np.median(scores):.3f}, largest {np.max(scores):.3f}")


def _row(draw: Draw, view: str, sigma: float, lengths: tuple[int, int, int]) -> dict[str, Any]:
    """An observation with its reference; ``line`` is what is printed of it."""
    started = time.process_time()
    (problem, seen), rng = draw.seen(view, sigma), np.random.default_rng(draw.seed)
    # Four times as many fits as by default: repeated samples would give themselves away.
    estimator = PosteriorOfDraws(first=1200, more=600, most=9600, enough=2e3, start=draw.start)
    estimate = estimator.estimate(problem, seen, rng=rng, budget=600.0)
    density, peaks = estimator.peaks(problem, seen, time.monotonic() + 24 * 3600.0)
    weights, row, accepted = _reference(density, peaks, draw.seed, lengths)
    samples = estimate.samples
    score = np.nan if samples is None else c2st(np.asarray(samples)[:KEPT], weights)
    line = (
        f"{draw.seed} {view:8}{sigma:5g}  {score:.3f}  {len(peaks):5}  {row['r_hat']:.3f}"
        f"{row['effective']:6.0f}  {accepted:8.2f}  "
        f"{estimate.extras.get('effective_sample_size', 0):16.0f}"
        f"{'' if estimate.converged else ' (not converged)'}"
        f"  {time.process_time() - started:7.0f}"
    )
    told = {"seed": draw.seed, "view": view, "sigma": sigma, "c2st": score, **row, "line": line}
    return told | {"weights": weights[..., :-1].astype(np.float32).ravel()}


def _reference(
    density: GameDensity, peaks: list[Peak], seed: int, lengths: tuple[int, int, int]
) -> tuple[np.ndarray, dict[str, float], float]:
    """Weights (M, N, K) of chains, their statistics, and the share of accepted steps."""
    count, steps, most = lengths
    while True:
        rng, thin = np.random.default_rng([seed, 1]), max(1, count * steps // (8 * KEPT))
        points, accepted = run_chains(density, peaks, rng, count, steps, thin)
        weights = density.chart.weights(points[..., : density.chart.size])  # (C, S, N, K)
        data = arviz.convert_to_dataset({"weights": weights})
        r_hat = float(arviz.rhat(data)["weights"].max())
        steps *= 2
        if r_hat < AGREED or steps > most:
            break
    effective = float(arviz.ess(data)["weights"].min())
    flat = weights.reshape(-1, *weights.shape[2:])
    chosen = np.random.default_rng(seed).choice(len(flat), KEPT, replace=len(flat) < KEPT)
    return flat[chosen], {"r_hat": r_hat, "effective": effective}, accepted


def c2st(own: np.ndarray, other: np.ndarray) -> float:
    """Share of right answers of a network that tells samples (M, N, K) of both apart."""
    points = np.vstack([one[:, :, :-1].reshape(len(one), -1) for one in (own, other)])
    labels, size = np.repeat([0, 1], [len(own), len(other)]), 10 * points.shape[1]
    network = make_pipeline(
        StandardScaler(), MLPClassifier((size, size), max_iter=1000, random_state=1)
    )
    folds = StratifiedKFold(5, shuffle=True, random_state=1)
    return float(cross_val_score(network, points, labels, cv=folds).mean())


if __name__ == "__main__":
    shared.command(main)
