"""Predictions from held-out starts."""

import numpy as np

from olne_bench.bench.judge.truth import Draw, held_out, held_out_samples

DRAW = Draw("two_player", "{}", 1, 0)


def test_samples_predict_like_estimates_of_the_same_weights() -> None:
    estimate = np.full((2, 4), 0.25)
    other = np.array([[0.4, 0.2, 0.2, 0.2], [0.3, 0.3, 0.2, 0.2]])
    samples = held_out_samples(DRAW, estimate, np.stack([estimate, other]), 100)
    assert samples is not None and np.isfinite(samples).all()
    for column, theta in enumerate((estimate, other)):
        pairs = held_out(DRAW, theta, 100)
        assert pairs is not None
        for one, predictions in zip(pairs, samples, strict=True):
            np.testing.assert_allclose(predictions[column], one.prediction, atol=1e-7)
    assert not np.allclose(samples[:, 0], samples[:, 1], atol=1e-3)
