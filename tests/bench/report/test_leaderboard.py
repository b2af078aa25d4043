"""The leaderboard, and median errors over the noise, counted by hand."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.leaderboard import errors_by_noise, leaderboard
from olne_bench.bench.report.statistics.score import log_errors, score_table
from olne_bench.bench.report.study import USUAL
from tests.bench.report.conftest import trial_row


def trial(**changes):
    return trial_row(**{"sigma": 0.01} | changes)


def only_row(*trials, study=USUAL):
    table = leaderboard(pd.DataFrame(trials), study=study)
    assert len(table) == 1
    return table.iloc[0]


def test_failures_rank_worst_and_are_never_dropped():
    good = [trial(position_error=float(k)) for k in range(2)]
    failed = [trial(status="failed_forward", position_error=np.nan) for _ in range(3)]
    row = only_row(*good, *failed)
    assert (row["trials"], row["failures"]) == (5, 3)
    assert row["position_error_median"] == np.inf
    assert row["position_error_q25"] == 1.0
    assert row["cosine_error_median"] == 0.1  # a failed prediction has a parameter error


def test_rows_count_as_often_as_they_say():
    row = only_row(trial(sigma=0.0, cosine_error=0.0, count=3), trial(cosine_error=1.0))
    assert row["trials"] == 4
    assert row["cosine_error_median"] == 0.0
    assert row["cosine_error_q75"] == pytest.approx(0.25)


def test_skipped_trials_are_not_attempts():
    row = only_row(trial(), trial(status="skipped", cosine_error=np.nan))
    assert (row["trials"], row["failures"], row["skipped"]) == (1, 0, 1)


def test_everything_skipped_is_not_a_number_not_a_crash():
    row = only_row(trial(status="skipped"))
    assert row["trials"] == 0
    assert np.isnan(row["cosine_error_median"])


def test_limit_ratio_is_taken_at_small_noise_only():
    row = only_row(trial(), trial(sigma=0.1, cosine_error=99.0), trial(sigma=0.0, cosine_limit=0.0))
    assert row["limit_ratio"] == pytest.approx(2.0)


def test_limit_ratio_counts_a_failure_as_the_largest_error():
    lost = trial(status="crash", cosine_error=np.nan, cosine_limit=0.05)
    wide = trial(cosine_error=7.0, cosine_limit=0.05)  # an angle's error ends at 1
    assert only_row(trial(), lost)["limit_ratio"] == pytest.approx((2 + 20) / 2)
    assert only_row(trial(), wide)["limit_ratio"] == pytest.approx((2 + 20) / 2)


def test_limit_ratio_weighs_rows_by_their_count_and_leaves_out_unknown_limits():
    known = [trial(count=3), trial(cosine_limit=0.02)]
    unknown = [trial(cosine_limit=limit) for limit in (0.0, np.inf, np.nan)]
    for rows in (known, known + unknown):
        assert only_row(*rows)["limit_ratio"] == pytest.approx((3 * 2 + 5) / 4)
    assert np.isnan(only_row(*unknown)["limit_ratio"])
    assert np.isnan(only_row(trial(sigma=0.0))["limit_ratio"])


def test_any_status_but_ok_is_a_failure():
    statuses = ("timeout", "crash", "failed_forward", "not_converged")
    failed = [trial(status=status, count=2) for status in statuses]
    row = only_row(trial(count=3), *failed)
    assert (row["trials"], row["failures"]) == (11, 8)


def test_published_failures_are_those_of_the_one_solve_too():
    row = only_row(trial(), trial(published_forward=0, count=2), trial(status="timeout"))
    assert (row["failures"], row["published_failures"]) == (1, 3)


def test_faults_of_the_harness_are_counted_apart():
    spoilt = trial(status="harness_error", cosine_error=np.nan, position_error=np.nan)
    row = only_row(trial(), spoilt, spoilt)
    assert (row["trials"], row["failures"], row["harness_errors"]) == (1, 0, 2)
    assert row["position_error_median"] == 1.0


def test_means_have_failures_at_the_largest_error_there_is():
    lost = trial(status="crash", cosine_error=np.nan, position_error=np.nan)
    row = only_row(trial(count=3), lost)
    assert row["cosine_error_mean"] == pytest.approx((3 * 0.1 + 1) / 4)
    assert row["position_error_mean"] == np.inf
    many = [trial(seed=k, cosine_error=0.9 + 0.01 * (k % 3)) for k in range(6)]
    row = only_row(*many, *[lost | {"seed": k} for k in range(6)])
    assert 0 < row["cosine_error_mean_low"] < row["cosine_error_mean"] < 1
    assert row["cosine_error_mean"] < row["cosine_error_mean_high"] <= 1


def test_the_best_median_comes_first_within_a_scenario_and_sensor():
    errors = {"worst": 3.0, "best": 1.0, "middle": 2.0}
    rows = [
        trial(scenario=scenario, estimator=name, position_error=error, cosine_error=-error)
        for scenario in ("t", "s")
        for name, error in errors.items()
    ]
    table = leaderboard(pd.DataFrame(rows))
    assert list(table["scenario"]) == ["s"] * 3 + ["t"] * 3
    assert list(table["estimator"]) == ["best", "middle", "worst"] * 2


def test_limit_ratio_of_a_study_of_much_noise_is_taken_at_the_least():
    row = only_row(trial(sigma=0.1), trial(sigma=0.5, cosine_limit=0.01))
    assert row["limit_ratio"] == pytest.approx(2.0)


def test_coverage_is_over_estimates_with_an_ellipsoid():
    row = only_row(
        trial(covers_truth=1, count=3), trial(covers_truth=0), trial(covers_truth=np.nan)
    )
    assert row["covers_truth_share"] == pytest.approx(0.75)
    assert row["covers_truth_trials"] == 4
    assert "covers_truth_share" not in only_row(trial(covers_truth=np.nan))
    two = [trial(covers_truth=1), trial(estimator="f", covers_truth=np.nan)]
    shares = leaderboard(pd.DataFrame(two))["covers_truth_share"]
    assert shares[0] == 1 and np.isnan(shares[1])


def test_an_estimator_without_a_trajectory_has_no_error_of_it():
    """An estimator that returns some trajectories is measured by all of its attempts."""
    nan = np.nan
    rows = [trial(reconstruction_error=e, seed=k) for k, e in enumerate((0.1, 0.3, nan))]
    rows.append(trial(status="crash", reconstruction_error=nan, seed=3))
    rows += [trial(estimator="none", reconstruction_error=nan), trial(estimator="none")]
    rows.append(trial(estimator="none", status="crash", reconstruction_error=nan))
    median = leaderboard(pd.DataFrame(rows)).set_index("estimator")["reconstruction_error_median"]
    assert median["e"] == 0.3  # of 0.1, 0.3 and the crash
    assert np.isnan(median["none"])


def test_a_lost_held_out_prediction_ranks_worst():
    row = only_row(trial(held_out_error=0.1), *[trial(held_out_error=np.nan)] * 2)
    assert row["held_out_error_median"] == np.inf


def test_those_who_never_finish_are_the_slowest():
    ended = [trial(solve_seconds=0.1), trial(solve_seconds=0.3, status="not_converged")]
    assert only_row(*ended)["solve_seconds_median"] == pytest.approx(0.2)
    stopped = [trial(status=s, solve_seconds=np.nan) for s in ("timeout", "crash", "timeout")]
    assert only_row(*ended, stopped[0])["solve_seconds_median"] == 0.3
    assert only_row(*ended, *stopped)["solve_seconds_median"] == np.inf
    skipped = trial(status="skipped", solve_seconds=np.nan)
    assert only_row(*ended, skipped, skipped)["solve_seconds_median"] == pytest.approx(0.2)


def test_draws_without_anything_to_hold_out_are_not_measured():
    """If no estimate of a family's draw has a held-out error, the draw does not count."""
    name, nan = "random(num_players=3)", np.nan
    rows = [
        trial(scenario=name, seed=seed, estimator=estimator, held_out_error=error)
        for estimator, errors in (("a", (0.1, 0.3, nan, nan)), ("b", (0.2, nan, 0.4, nan)))
        for seed, error in enumerate(errors)
    ]
    rows.append(trial(scenario=name, seed=3, estimator="c", status="crash", held_out_error=nan))
    median = leaderboard(pd.DataFrame(rows)).set_index("estimator")["held_out_error_median"]
    # Each has lost one of the first three draws; at the last one only the crash is a failure.
    assert median.to_dict() == {"a": 0.3, "b": 0.4, "c": np.inf}


def test_rows_stand_by_score_and_floors_come_last(usual):
    """The score counts all draws, a median one of them."""
    errors = {"even": [5.0] * 15, "often": [0.1] * 7 + [9.0] * 8, "uniform": [0.01] * 15}
    rows = [
        trial(scenario="two_player", estimator=name, seed=seed, position_error=error)
        for name, values in errors.items()
        for seed, error in enumerate(values)
    ]
    trials = pd.DataFrame(rows)
    scores = score_table(log_errors(trials, usual), usual)
    table = leaderboard(trials, scores, usual)
    assert table["estimator"].tolist() == ["often", "even", "uniform"]
    told = table["position_error_score"]
    assert told[1] == pytest.approx(1) and told[0] < 1 and told[2] < told[0]
    plain = leaderboard(trials, study=usual)
    assert plain["estimator"].tolist() == ["even", "often", "uniform"]


def test_trials_without_noise_are_exact_or_not():
    rows = [trial(sigma=0.0, position_error=e, count=n) for e, n in ((1e-6, 3), (0.1, 1))]
    assert only_row(*rows)["exact"] == 0.75
    assert only_row(trial(sigma=0.0, status="crash", position_error=np.nan))["exact"] == 0
    assert np.isnan(only_row(trial())["exact"])


def trials_of(rows: list[tuple[float, str, int, float]]) -> pd.DataFrame:
    names = ["sigma", "status", "count", "position_error"]
    table = pd.DataFrame(rows, columns=names).assign(scenario="s", sensor="full", estimator="a")
    return table.assign(seed=range(len(table)))


def test_attempts_and_failures_are_counted() -> None:
    table = errors_by_noise(
        trials_of(
            [
                (0.0, "ok", 40, 0.5),
                (0.1, "ok", 1, 0.5),
                (0.1, "failed_forward", 1, np.nan),
                (0.1, "timeout", 1, np.nan),
                (0.2, "skipped", 1, np.nan),
                (0.2, "harness_error", 1, np.nan),
                (0.3, "crash", 7, np.nan),
            ]
        )
    )
    assert table[["sigma", "attempts", "failures"]].to_numpy().tolist() == [
        [0.0, 40, 0],
        [0.1, 3, 2],
        [0.3, 7, 7],
    ]


def test_medians_lie_between_two_of_the_ordered_errors_and_failures_rank_last() -> None:
    errors = [(0.1, "ok", 1, float(k)) for k in range(1, 10)]
    few = [(0.2, "ok", 1, 1.0), (0.2, "timeout", 1, np.nan), (0.2, "timeout", 1, np.nan)]
    table = errors_by_noise(trials_of([*errors[::-1], (0.1, "timeout", 1, np.nan), *few]))
    shown = table[[f"position_error_{end}" for end in ("median", "low", "high")]].to_numpy()
    # Of ten values, the second and the ninth enclose the median in 97.9 % of cases.
    np.testing.assert_array_equal(shown, [[5.5, 2.0, 9.0], [np.inf, np.nan, np.nan]])
