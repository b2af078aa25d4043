"""Densities of held-out positions: what is lost to knowing the truth."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.held_out_log_score import HeldOutLogScore
from olne_bench.bench.judge.metrics.judged import HeldOut

SIGMA = 0.1
STARTS, TIMES, PLAYERS = 5, 41, 2


def found(predictions: np.ndarray | None, point: float = 0.0, **changes: Any) -> float | None:
    """The score where the truth is zero, with samples (H, M, T, N, n) or without."""
    true = np.zeros((TIMES, PLAYERS, 4))
    pairs = (HeldOut(true, true + point),) * STARTS
    case = SimpleNamespace(
        sigma=SIGMA, held_out=lambda: pairs, held_out_samples=lambda _: predictions
    )
    vars(case).update(changes)
    return HeldOutLogScore().score(case)  # type: ignore[arg-type]


def around(offset: float, spread: float, seed: int = 0) -> np.ndarray:
    """Samples that shift a whole motion, normally distributed."""
    shifts = np.random.default_rng(seed).normal(offset, spread, (STARTS, 400, 1, 1, 1))
    return np.broadcast_to(shifts, (STARTS, 400, TIMES, PLAYERS, 4))


def test_the_truth_loses_nothing() -> None:
    assert found(None) == pytest.approx(0, abs=1e-12)
    assert found(around(0, 0)) == pytest.approx(0, abs=1e-12)


def test_an_offset_of_a_certain_prediction_loses_its_square() -> None:
    # Both coordinates are off; the noise adds a term of mean zero.
    losses = [found(None, point=offset) for offset in (-0.3, 0.3)]
    assert np.mean(losses) == pytest.approx((0.3 / SIGMA) ** 2)


def test_neither_narrower_nor_wider_samples_gain() -> None:
    spread = 0.2

    def mean(factor: float) -> float:
        offsets = np.random.default_rng(1).normal(0, spread, 60)
        losses = [found(around(x, factor * spread, seed)) for seed, x in enumerate(offsets)]
        return float(np.mean(losses))

    right = mean(1.0)
    assert right < mean(0.4) and right < mean(2.5)


def test_a_sample_without_a_game_foretells_nothing() -> None:
    samples = around(0, 0).copy()
    samples[:, ::2] = np.nan
    assert found(samples) == pytest.approx(np.log(2))
    assert found(np.full_like(samples, np.nan)) is None


def test_nothing_is_scored_without_noise_or_motions() -> None:
    assert found(None, sigma=0.0) is None
    assert found(None, held_out=lambda: None) is None
