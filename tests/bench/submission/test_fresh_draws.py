"""What fresh errors say of implausible ones, and how trials of a check are run."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.seeds import noise_seed
from olne_bench.bench.judge.truth import Draw
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.report.confirmations import read_confirmations, write_confirmations
from olne_bench.bench.run.study import LOG
from olne_bench.bench.submission import fresh_draws
from olne_bench.bench.submission.fresh_draws import (
    FEWEST,
    Machine,
    Suspect,
    compared,
    confirm,
    run_all,
)
from olne_bench.errors import UserError

LEVELS = (0.01, 0.1)


@pytest.fixture(scope="module")
def trials():
    suite = load_suite("calibration")
    chosen = [t for t in expand(suite, 1) if t.estimator.label == "map"]
    return tuple(replace(chosen[0], sigma=sigma) for sigma in LEVELS)


def errors(factors: dict[float, float], number: int, seed: int = 0, cosine: float = 1.0):
    rng = np.random.default_rng(seed)
    spread = lambda: rng.lognormal(0.0, 0.6)  # noqa: E731
    return pd.DataFrame(
        {
            "sigma": sigma,
            "status": "ok",
            "position_error": factor * spread(),
            "cosine_error": cosine * factor**2 * spread(),
        }
        for sigma, factor in factors.items()
        for _ in range(number)
    )


HONEST = {0.01: 0.003, 0.1: 0.03}


@pytest.mark.parametrize("number", [1, 3, 40])
@pytest.mark.parametrize("seed", range(5))
def test_errors_as_small_are_confirmed_and_larger_ones_are_not(trials, number, seed):
    suspect = Suspect(trials, errors(dict.fromkeys(LEVELS, 1e-13), number))
    told = compared(suspect, errors(HONEST, 10, seed))
    assert (told.confirmed, told.as_small) == (False, 0)
    fifth = Suspect(trials, errors({k: v / 5 for k, v in HONEST.items()}, 20))
    assert not compared(fifth, errors(HONEST, 10, seed)).confirmed
    same = Suspect(trials, errors(HONEST, 20))
    assert compared(same, errors(HONEST, 10, seed)).confirmed


def test_weights_that_are_better_than_fresh_ones_are_not_confirmed_by_the_motion(trials):
    suspect = Suspect(trials, errors(HONEST, 20, cosine=0.01))
    told = compared(suspect, errors(HONEST, 10, 1))
    assert not told.confirmed
    assert told.metric == "cosine_error"
    assert told.text.startswith("not confirmed: cosine error ")


def test_failures_and_too_few_attempts_confirm_nothing(trials):
    suspect = Suspect(trials, errors(HONEST, 20))
    failed = errors(HONEST, 10, 1).assign(status="crash")
    told = compared(suspect, failed)
    assert (told.confirmed, told.fresh_error) == (False, None)
    assert "∞ m on fresh draws" in told.text
    assert not compared(suspect, errors(HONEST, FEWEST // 2 - 1, 1)).confirmed
    assert not compared(suspect, pd.DataFrame()).confirmed


def test_each_noise_level_has_draws_and_noise_of_its_own(trials):
    found = list(islice(fresh_draws._fresh(trials), 2 * FEWEST))
    assert len({trial.key for trial in found}) == 2 * FEWEST
    salts = {(trial.sigma, trial.salt) for trial in found}
    assert len(salts) == len({salt for _, salt in salts}) == len(LEVELS)
    for make in (
        lambda t: Draw.of(t.scenario, t.seed, t.salt).seed,
        lambda t: noise_seed(t.scenario, 0.1, t.seed, t.salt),
    ):
        assert len({make(trial) for trial in found}) == 2 * FEWEST
    again = list(islice(fresh_draws._fresh(trials), 2))
    assert not {t.salt for t in again} & {t.salt for t in found}


def test_draws_that_are_no_attempts_are_replaced(trials, monkeypatch, tmp_path):
    asked = []

    def run_all(chosen, _machine):
        for trial in chosen:
            asked.append(trial)
            status = "skipped" if len(asked) % 3 == 1 else "ok"
            yield trial, Outcome(status, scores={"position_error": 1e-3, "cosine_error": 1e-4})

    monkeypatch.setattr(fresh_draws, "run_all", run_all)
    told = confirm(Suspect(trials, errors(HONEST, 20)), FEWEST, Machine(1, 2**30, tmp_path))
    assert told.trials == FEWEST
    assert len(asked) == len({trial.key for trial in asked}) > FEWEST
    assert told.confirmed


def test_the_latest_outcome_of_a_place_is_kept(trials, tmp_path):
    suspect = Suspect(trials, errors(HONEST, 20))
    first = compared(suspect, errors(HONEST, 10, 1))
    other = replace(first, sensor="another")
    write_confirmations(tmp_path, [first, other])
    again = replace(first, confirmed=False)
    write_confirmations(tmp_path, [again])
    assert read_confirmations(tmp_path) == [other, again]
    assert read_confirmations(tmp_path / "nowhere") == []
    with pytest.raises(UserError, match="cannot be written"):
        write_confirmations(tmp_path / "nowhere", [first])


def test_trials_run_in_places_that_are_named_as_those_of_a_run(trials, monkeypatch, tmp_path):
    asked = {}

    def run_trials(some, **options):
        asked.update(options)
        for trial in some:
            yield trial, Outcome("ok")

    monkeypatch.setattr(fresh_draws, "run_trials", run_trials)
    found = run_all(trials, Machine(jobs=4, memory=2**30, hidden=tmp_path))
    assert tuple(trial for trial, _ in found) == trials
    assert asked.pop("log").name == LOG
    assert asked == {"jobs": 4, "memory": 2**30, "hidden": tmp_path}
