"""Tests of trials."""

import pickle

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import expand


def test_trials_survive_pickling_in_any_order() -> None:
    """They share what they have in common, whoever comes between."""
    some = list(expand(load_suite("quick"), 2))[::3]
    for trial in (*some, *reversed(some)):
        again = pickle.loads(pickle.dumps(trial))
        assert again == trial and again.labels == trial.labels
