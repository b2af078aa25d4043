"""Studies from Python are those of the command line."""

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.bench.commands.cli import main
from olne_bench.errors import UserError

PART = {"scenarios": "two_player", "sensors": ["full"], "jobs": 1}
COMMAND = ["run", "quick", "--scenario", "two_player", "--sensor", "full", "--jobs", "1"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    out = tmp_path_factory.mktemp("study") / "run"
    return ob.run("quick", out=out, estimators=["ridge", "uniform"], sigma=0.3, seeds=2, **PART)


def test_a_study_has_rows_and_a_leaderboard(study):
    assert len(study.trials) == 4
    assert study.leaderboard["estimator"].tolist() == [
        "ridge",
        "uniform",
    ]  # a floor stands at the end
    assert repr(study).endswith("suite 'quick (changed)', 4 rows, 0 failed)")
    assert ob.read(study.folder).leaderboard.equals(study.leaderboard)


def test_a_comparison_has_its_scores(study):
    draw = ob.scenario("two_player", weights="dirichlet", seed=0)
    here = ob.compare(draw, ["ridge", "uniform"], sigma=0.3).trials
    there = study.trials[study.trials["seed"] == 0].sort_values("estimator")
    numbers = here.select_dtypes(float).columns.intersection(there.columns)
    columns = {name for name in numbers if not name.endswith("_seconds")}
    assert columns >= {"cosine_error", "position_error", "held_out_error", "cosine_limit", "fit_p"}
    for column in columns:
        wanted = here.sort_values("estimator")[column].astype(float)
        np.testing.assert_allclose(there[column].astype(float), wanted, rtol=1e-6, atol=1e-12)
    assert here["status"].tolist() == there["status"].tolist()


def test_it_goes_on_with_more_and_nothing_is_run_again(study, capsys):
    part = [*COMMAND, "--no-report", "--out", str(study.folder), "--seeds", "2"]
    main([*part, "--estimator", "uniform", "--sigma", "0.3", "--sigma", "0.2"])
    assert "2 of 4 trials are done already" in capsys.readouterr().err
    more = ob.read(study.folder)
    assert len(more.trials) == 6
    assert more.suites[-1].sigmas == (0.3, 0.2)
    assert {entry.label for entry in more.suites[-1].estimators} == {"ridge", "uniform"}
    main(["status", str(study.folder)])
    assert "suite quick (changed), 2 runs" in capsys.readouterr().out


def test_a_changed_suite_is_not_the_published_one(study):
    with pytest.raises(UserError, match=r"holds a run of suite 'quick \(changed\)', not 'quick'"):
        ob.run("quick", out=study.folder, **PART)
    assert study.trials["suite"].unique().tolist() == ["quick (changed)"]


@pytest.mark.parametrize(
    ("options", "error", "expected"),
    [
        ({"estimators": ["mapp"]}, UserError, "no estimator 'mapp'; it has: .*nearest: map"),
        ({"estimators": [3]}, TypeError, "estimators must be names, got 3: .*compare"),
        ({"sigma": -1.0}, UserError, "no sigma -1.0; it has: 0.0"),
        ({"seeds": 0}, UserError, "seeds must be a whole number of at least 1, got 0"),
        ({"retry": "all"}, UserError, "retry 'all': known are failed, "),
        ({"suite": "quikc"}, UserError, "unknown suite 'quikc'; known are: "),
    ],
)
def test_wrong_use_writes_nothing(tmp_path, options, error, expected):
    arguments = {"suite": "quick"} | options
    with pytest.raises(error, match=expected):
        ob.run(out=tmp_path / "run", **arguments)
    assert not (tmp_path / "run").exists()
    with pytest.raises(UserError, match="no run in"):
        ob.read(tmp_path)
