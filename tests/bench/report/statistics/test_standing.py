"""Who does not rank is shown, and counts nowhere: in no score, comparison or gate."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.entries import (
    EstimatorEntry,
    GateLimits,
    PluginEntry,
    ScenarioEntry,
    SensorEntry,
)
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.report.board import verdict
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.report.gate import check_limits
from olne_bench.bench.report.leaderboard_text import (
    format_board,
    format_notes,
    latex,
    markdown,
)
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.statistics.standing import (
    COLUMNS,
    PUBLISHED,
    RANKS,
    if_told,
    plausible,
    said_of_standing,
    standings,
)
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.submission.played import PlayedScenes
from tests.bench.report.conftest import trial_row

SEEDS, LEVELS = 10, (0.01, 0.1)
BUILT_IN = ("kkt_constrained", "map")
FOREIGN = ("constants", "remembers")
#: Position errors over sigma.
ERRORS = {"map": 0.5, "kkt_constrained": 1.0, "constants": 1e-12, "remembers": 1e-12}


@pytest.fixture(scope="module")
def study() -> Study:
    wide = {"weights": "dirichlet"}
    study = Study(
        scenarios={
            "wide": ScenarioEntry(name="two_player", label="wide", options=wide, family=True),
            "two_player": ScenarioEntry(name="two_player", label="two_player"),
        },
        sensors={"full": SensorEntry(label="full", layers=(PluginEntry(name="full"),))},
        salt="standing",
        estimators={name: EstimatorEntry(name=name, label=name) for name in BUILT_IN}
        | {name: EstimatorEntry(name=f"/gone/{name}.py", label=name) for name in FOREIGN},
    )
    return replace(study, scenes=PlayedScenes(study))


def weights(study: Study, scenario: str, seed: int, name: str) -> list[list[float]]:
    """Equal weights, or those that one plugin remembers."""
    if name == "remembers" and scenario == "wide":
        found: list[list[float]] = study.scenes.truth(scenario, seed).weights.tolist()
        return found
    return [[0.25] * 4] * 2


def rows(study: Study, scenario: str, names=(*BUILT_IN, *FOREIGN)) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    found = []
    for sigma in LEVELS:
        for seed in range(SEEDS):
            for name in names:
                factor = ERRORS[name] * rng.uniform(0.9, 1.1)
                exact = name in FOREIGN
                found.append(
                    trial_row(
                        scenario=scenario,
                        sigma=sigma,
                        seed=seed,
                        estimator=name,
                        weights=weights(study, scenario, seed, name),
                        cosine_limit=sigma**2,
                        cosine_error=0.0 if exact else factor * sigma**2,
                        position_error=factor * sigma,
                    )
                )
    return pd.DataFrame(found)


@pytest.fixture(scope="module")
def trials(study) -> pd.DataFrame:
    """In ``wide``, one plugin remembers; in ``two_player``, both return constants."""
    honest = rows(study, "wide")
    swapped = honest["estimator"] == "constants"
    honest.loc[swapped, "position_error"] *= 1e13
    honest.loc[swapped, "cosine_error"] = 0.5
    return pd.concat([honest, rows(study, "two_player")], ignore_index=True)


@pytest.fixture(scope="module")
def tables(trials, study):
    return tabulate(trials, study)


def confirmation(**changes: object) -> Confirmation:
    told = Confirmation(
        scenario="wide",
        sensor="full",
        estimator="remembers",
        parameters="{}",
        versions=Versions(),
        sigmas=LEVELS,
        rows=20,
        trials=20,
        metric="position_error",
        error=8e-14,
        fresh_error=0.37,
        as_small=0,
        confirmed=False,
    )
    return replace(told, **changes)


def test_standings(trials, study):
    found = standings(trials, study).set_index(["scenario", "estimator"])
    for name in BUILT_IN:
        assert found.loc[("two_player", name), "standing"] == RANKS
        assert found.loc[("wide", name), "standing"] == RANKS
    for name in FOREIGN:
        assert found.loc[("two_player", name), "standing"] == PUBLISHED
    assert found.loc[("wide", "constants"), "standing"] == RANKS
    assert found.loc[("wide", "remembers"), "standing"] == "implausible"
    assert found["implausible"].to_dict()["wide", "remembers"] == len(LEVELS) * SEEDS
    assert found["implausible"].sum() == len(LEVELS) * SEEDS


def test_those_without_a_standing_have_errors_and_no_score(tables):
    board = tables.leaderboard.set_index(["scenario", "estimator"])
    for name in FOREIGN:
        assert pd.isna(board.loc[("two_player", name), "position_error_score"])
        assert board.loc[("two_player", name), "position_error_median"] < 1e-12
    assert pd.isna(board.loc[("wide", "remembers"), "position_error_score"])
    assert pd.isna(board.loc[("wide", "remembers"), "cosine_error_score"])
    assert board.loc[("wide", "constants"), "position_error_score"] > 5
    for scenario in ("wide", "two_player"):
        assert board.loc[(scenario, "map"), "position_error_score"] == pytest.approx(0.5, rel=0.05)


def test_they_are_compared_with_nobody(tables):
    named = {
        (scenario, name)
        for scenario, *pair in tables.comparisons[["scenario", "estimator", "other"]].to_numpy()
        for name in pair
    }
    assert not named & {("two_player", name) for name in FOREIGN}
    assert ("wide", "remembers") not in named and ("wide", "constants") in named
    assert "remembers" not in set(tables.scores["estimator"])


def test_scores_of_others_are_those_without_them(trials, tables, study):
    without = tabulate(trials[~trials["estimator"].isin(FOREIGN)], study)
    assert not {*COLUMNS} & {*without.leaderboard.columns}
    kept = tables.leaderboard[~tables.leaderboard["estimator"].isin(FOREIGN)]
    pd.testing.assert_frame_equal(
        kept.drop(columns=[*COLUMNS]).reset_index(drop=True), without.leaderboard
    )


def test_terminal_markdown_latex_and_page_say_so(trials, tables, study):
    (one, other, three) = said_of_standing(tables.leaderboard)
    assert one.startswith("constants has no rank in two_player: the true weights are published")
    assert other.startswith("remembers has no rank in two_player")
    assert three.startswith("remembers in wide, full: 20 rows are implausible")
    assert "olne-bench confirm" in three
    assert "remembers (unranked)" in format_board(tables, study)
    assert three in format_notes(tables, [])
    text = markdown(tables.leaderboard, study)
    assert "| Implausible |" in text
    assert "remembers in wide, full: 20 rows are implausible" in text
    assert "Implausible" in latex(tables.leaderboard, study)
    html = render_page(trials, tables, [], study).html
    assert "remembers in wide, full: 20 rows are implausible" in html
    assert ">Implausible</button>" in html


def test_usual_tables_say_nothing(trials, study):
    plain = tabulate(trials[trials["estimator"].isin(BUILT_IN)], study)
    assert said_of_standing(plain.leaderboard) == []
    assert "mplausible" not in markdown(plain.leaderboard, study)
    assert "Not ranked" not in format_notes(plain, [])
    assert if_told(pd.DataFrame()).empty


def test_the_verdict_names_no_plugin_that_does_not_rank(tables, study):
    said = verdict(tables.scores, tables.comparisons, study)
    assert "map has the smallest position errors" in said and "remembers" not in said
    alone = tabulate(rows(study, "two_player", FOREIGN), study)
    assert verdict(alone.scores, alone.comparisons, study).startswith("No estimator has a score")


def test_fresh_draws_decide(trials, study):
    for confirmed in (True, False):
        told = replace(study, confirmations=(confirmation(confirmed=confirmed),))
        board = tabulate(trials, told).leaderboard.set_index(["scenario", "estimator"])
        row = board.loc[("wide", "remembers")]
        assert pd.notna(row["position_error_score"]) == confirmed
        assert row["implausible"] == 20
        assert "0.37 m on fresh draws, 8e-14 m here" in row["standing"]
        said = " ".join(said_of_standing(board.reset_index()))
        assert ("not confirmed: 0.37 m on fresh draws" in said) != confirmed


def test_a_confirmation_of_other_noise_levels_is_not_enough(trials, study):
    told = replace(study, confirmations=(confirmation(confirmed=True, sigmas=(0.01,)),))
    found = standings(trials, told).set_index(["scenario", "estimator"])["standing"]
    assert found["wide", "remembers"] == "implausible"


def test_no_gate_lets_implausible_rows_pass(trials, tables, study):
    limits = GateLimits.model_validate({"position_error": 0.1})
    gate = {"remembers": limits, "map": limits}
    outcomes = check_limits(tables.leaderboard, gate, study)
    failed = [(o.estimator, o.scenario, o.limit, o.value) for o in outcomes if not o.passed]
    assert failed == [("remembers", "wide", "implausible", 20.0)]
    told = replace(study, confirmations=(confirmation(confirmed=True),))
    assert all(o.passed for o in check_limits(tabulate(trials, told).leaderboard, gate, told))


def test_only_implausible_rows_are_left_out_of_what_is_compared_with_itself(trials, study):
    kept = plausible(trials, standings(trials, study))
    gone = trials.drop(index=kept.index)
    assert set(gone["estimator"]) == {"remembers"}
    assert set(gone["scenario"]) == {"wide"}
