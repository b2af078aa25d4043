"""Honest rows are plausible, whatever an estimator does; known truths are not, even with noise."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.bench.plan.entries import EstimatorEntry, PluginEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.report.statistics.plausibility import MOST_DRAWS, chance, implausible
from olne_bench.bench.report.study import Study
from olne_bench.bench.submission.played import PlayedScenes
from olne_bench.games.model.simplex import theta_tangent

SEEDS, LEVELS = 12, (0.0, 0.003, 0.01)
STUDY = Study(
    scenarios={
        "wide": ScenarioEntry(
            name="two_player", label="wide", options={"weights": "dirichlet"}, family=True
        ),
        "published": ScenarioEntry(name="two_player", label="published"),
    },
    sensors={"full": SensorEntry(label="full", layers=(PluginEntry(name="full"),))},
    salt="plausible",
    estimators={
        "foreign": EstimatorEntry(name="/gone/foreign.py", label="foreign"),
        "ours": EstimatorEntry(name="map", label="ours"),
    },
)
STUDY = replace(STUDY, scenes=PlayedScenes(STUDY))


@pytest.fixture(scope="module")
def truths() -> list[tuple[np.ndarray, np.ndarray]]:
    """True weights of each draw, and the Cramer-Rao bound at unit noise."""
    found = []
    for seed in range(SEEDS):
        truth = STUDY.scenes.truth("wide", seed, "full")
        root, tangent = truth.information_root, theta_tangent(4, truth.used)
        found.append((truth.weights, tangent @ np.linalg.inv(root.T @ root) @ tangent.T))
    return found


def efficient(truths, rng, times=1.0, most=np.inf):
    """Estimates with normal errors: ``times`` those of the bound, which counts up to ``most``."""
    found = {}
    for seed, (weights, bound) in enumerate(truths):
        values, directions = np.linalg.eigh(bound)
        for sigma in LEVELS:
            scale = np.sqrt(np.minimum(values.clip(0) * sigma**2, most))
            error = directions @ (scale * rng.standard_normal(len(values)))
            found[seed, sigma] = weights + times * error.reshape(weights.shape)
    return found


def table(estimates, truths, estimator="foreign", scenario="wide"):
    rows = []
    for (seed, sigma), weights in estimates.items():
        truth, _ = truths[seed]
        rows.append(
            {
                "scenario": scenario,
                "sensor": "full",
                "sigma": sigma,
                "seed": seed,
                "estimator": estimator,
                "status": "ok",
                "weights": weights.tolist(),
                "cosine_error": cosine_error(truth, weights),
                "cosine_limit": 1000.0 * sigma**2,
                "position_error": float(np.abs(weights - truth).mean()),
            }
        )
    return pd.DataFrame(rows)


def test_the_bound_is_not_below_the_chance_and_not_far_above_it():
    for freedom in (1, 3, 6, 60, 240):
        for share in (1e-6, 1e-3, 0.1, 0.5):
            square = chi2.ppf(share, freedom)
            found = chance(square, np.ones(freedom))
            assert share <= found <= 12 * share * np.sqrt(freedom) + 1e-12
    assert chance(7.0, np.ones(6)) == 1.0
    assert chance(0.0, np.ones(6)) == 0.0
    rng = np.random.default_rng(0)
    scales = np.array([1.0, 0.3, 0.01])
    sums = (scales * rng.standard_normal((100_000, 3)) ** 2).sum(axis=1)
    for share in (0.001, 0.01, 0.2):
        assert chance(float(np.quantile(sums, share)), scales) >= share


@pytest.mark.parametrize("seed", range(5))
def test_an_efficient_estimator_is_plausible(truths, seed):
    found = efficient(truths, np.random.default_rng(seed), most=0.05)
    for estimator in ("foreign", "ours"):
        assert not implausible(table(found, truths, estimator), STUDY).any()


def test_so_is_one_that_knows_the_prior_or_nothing(truths):
    mean = np.mean([weights for weights, _ in truths], axis=0)
    for constant in (mean, np.full((2, 4), 0.25)):
        found = {(seed, sigma): constant for seed in range(SEEDS) for sigma in LEVELS}
        assert not implausible(table(found, truths), STUDY).any()


def test_known_truths_are_marked_in_every_row_with_noise(truths):
    found = {(seed, sigma): truths[seed][0] for seed in range(SEEDS) for sigma in LEVELS}
    rows = table(found, truths)
    assert (implausible(rows, STUDY) == (rows["sigma"] > 0)).all()
    # Columns alone are enough: an older table has no weights, and our own code no special right.
    assert (implausible(rows.drop(columns="weights"), STUDY) == (rows["sigma"] > 0)).all()
    ours = rows.assign(estimator="ours")
    assert (implausible(ours, STUDY) == (rows["sigma"] > 0)).all()


@pytest.mark.parametrize("times", [0.2, 1e-3, 1e-6])
def test_known_truths_with_a_little_noise_are_marked_together(truths, times):
    rows = table(efficient(truths, np.random.default_rng(1), times, most=0.05), truths)
    assert (implausible(rows, STUDY) == (rows["sigma"] > 0)).all()


def test_noise_in_the_directions_that_show_does_not_hide_the_others(truths):
    """The motion is then as wrong as that of an honest estimator, and the weights are not."""
    rng = np.random.default_rng(2)
    rows = table(efficient(truths, rng, most=1e-6), truths)
    high = rows["sigma"] == 0.01
    assert implausible(rows, STUDY)[high].all()


def test_some_known_truths_among_honest_rows_are_marked_alone(truths):
    found = efficient(truths, np.random.default_rng(3), most=0.05)
    known = {(2, 0.003), (5, 0.01), (11, 0.01)}
    found |= {(seed, sigma): truths[seed][0] for seed, sigma in known}
    rows = table(found, truths)
    marked = rows[implausible(rows, STUDY)]
    assert set(zip(marked["seed"], marked["sigma"], strict=True)) == known
    assert max(seed for seed, _ in known) >= MOST_DRAWS  # by its columns


def test_published_weights_and_failures_are_not_judged(truths):
    found = {(seed, sigma): truths[seed][0] for seed in range(SEEDS) for sigma in LEVELS}
    assert not implausible(table(found, truths, scenario="published"), STUDY).any()
    rows = table(found, truths).assign(status="not_converged")
    assert not implausible(rows, STUDY).any()
    unknown = replace(STUDY, scenarios={})
    assert not implausible(table(found, truths), unknown).any()


def test_worlds_that_are_plugins_are_judged_by_columns_alone(truths):
    world = STUDY.scenarios["wide"].model_copy(update={"name": "/gone/world.py"})
    foreign = replace(STUDY, scenarios={"wide": world})
    rows = table(efficient(truths, np.random.default_rng(4), 0.2, most=0.05), truths)
    assert not implausible(rows, foreign).any()
    exact = rows.assign(cosine_error=0.0, position_error=8e-14)
    assert (implausible(exact, foreign) == (rows["sigma"] > 0)).all()


def test_a_small_error_of_the_motion_or_of_weights_alone_is_no_sign(truths):
    rows = table(efficient(truths, np.random.default_rng(5), most=0.05), truths, "ours")
    assert not implausible(rows.assign(position_error=8e-14), STUDY).any()
    assert not implausible(rows.assign(cosine_error=0.0), STUDY).any()
