from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from tests.bench.report.conftest import trial_row

Trials = Callable[..., pd.DataFrame]


@pytest.fixture(scope="session")
def make_trials(prediction_error, usual) -> Trials:
    """Trials like those of a study, with estimates near the truth."""

    def make(
        scenario: str = "two_player",
        estimators: tuple[str, ...] = ("kkt_constrained", "kkt_residual", "uniform"),
        sensors: tuple[str, ...] = ("full", "partial"),
        sigmas: tuple[float, ...] = (0.0, 0.01, 0.1),
        seeds: int = 2,
        status: str = "ok",
    ) -> pd.DataFrame:
        rng = np.random.default_rng(0)
        rows = []
        for estimator in estimators:
            for sensor in sensors:
                for sigma in sigmas:
                    for seed in range(seeds if sigma else 1):
                        truth = usual.scenes.truth(scenario, seed).weights
                        weights = truth * np.exp(sigma * rng.standard_normal(truth.shape))
                        weights /= weights.sum(1, keepdims=True)
                        error = sigma * rng.uniform(0.5, 2)
                        rows.append(
                            trial_row(
                                scenario=scenario,
                                sensor=sensor,
                                sigma=sigma,
                                seed=seed,
                                estimator=estimator,
                                status=status,
                                cosine_error=error,
                                cosine_limit=sigma**2,
                                position_error=prediction_error(scenario, seed, weights),
                                reconstruction_error=error,
                                observation_error=0.8 * sigma,
                                count=1 if sigma else 40,
                                weights=weights.tolist(),
                            )
                        )
        frame = pd.DataFrame(rows)
        if status in ("timeout", "crash", "invalid", "skipped", "not_converged"):
            frame = frame.assign(
                cosine_error=np.nan, position_error=np.nan, observation_error=np.nan, weights=None
            )
        elif status == "failed_forward":
            frame["position_error"] = np.nan
        return frame

    return make
