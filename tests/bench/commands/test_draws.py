"""``olne-bench draws``, and a run that uses what it wrote."""

import shutil

import pytest

from olne_bench.bench.judge import nearby_starts, truth
from olne_bench.bench.plan.draws import DrawsSource, draws_path, draws_source, opened
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import salted
from olne_bench.envs.solved import draws_file, equilibrium
from olne_bench.envs.solved.draws_file import OtherDrawsError, read_draws, write_draws

SUITE = """
name = "small"
scenarios = [{name = "random", options = {num_players = 2}}]
sensors = ["full"]
sigmas = [0.01]
seeds = 2
time_limit = 20.0
estimators = ["uniform"]
"""
PER_DRAW = 1 + truth.HELD_OUT


def forget() -> None:
    """Empty caches, as in a new process."""
    for cached in (equilibrium._solve, truth._recording, truth._nearby, opened):
        cached.cache_clear()


@pytest.fixture(scope="module")
def solved(lasting_study):
    """The draws of the suite, in a file."""
    lasting_study.suite.write_text(SUITE)
    forget()  # who is refused is noted where it is solved
    said = lasting_study.call("draws", lasting_study.suite, "--jobs", 1)
    assert "random(num_players=2): 2 of 2 draws" in said
    assert f"small.draws: {2 * PER_DRAW} motions" in said
    return lasting_study.folder / "small.draws"


@pytest.fixture
def drawn(study, solved):
    """A study whose draws are solved."""
    study.suite.write_text(SUITE)
    shutil.copy(solved, study.folder)
    return study


def test_a_run_reads_its_truths(drawn) -> None:
    said = drawn.run("a")
    assert f"solved draws are read from {drawn.folder / 'small.draws'}" in said
    (drawn.folder / "small.draws").unlink()
    assert "solved draws" not in drawn.run("b")
    one, other = (drawn.rows(out) for out in ("a", "b"))
    assert one["status"].tolist() == ["ok", "ok"]
    for name in ("cosine_error", "position_error", "held_out_error", "cosine_limit"):
        assert one[name].tolist() == pytest.approx(other[name].tolist(), rel=1e-6), name


def test_nothing_in_the_file_is_solved_again(drawn, monkeypatch) -> None:
    forget()
    monkeypatch.setattr(equilibrium, "solve_olne", None)
    monkeypatch.setattr(nearby_starts, "solve_batch", None)
    before = (drawn.folder / "small.draws").read_bytes()
    drawn.call("draws", drawn.suite, "--jobs", 1)
    assert (drawn.folder / "small.draws").read_bytes() == before
    forget()


def test_the_command_goes_on_with_what_it_has(drawn) -> None:
    drawn.suite.write_text(SUITE.replace("seeds = 2", "seeds = 3"))
    said = drawn.call("draws", drawn.suite, "--jobs", 2)
    assert f"small.draws: {3 * PER_DRAW} motions" in said


def test_part_of_a_suite_is_drawn(study) -> None:
    study.suite.write_text(SUITE)
    out = study.folder / "part.draws"
    said = study.call("draws", study.suite, "--jobs", 1, "--seeds", 1, "--out", out)
    assert f"part.draws: {PER_DRAW} motions" in said
    assert "has no scenario 'x'" in study.call("draws", study.suite, "--scenario", "x", code=2)


@pytest.mark.parametrize("wrong", ["hash", "version", "suite"])
def test_a_run_refuses_a_file_that_does_not_fit(drawn, wrong, monkeypatch) -> None:
    path = drawn.folder / "small.draws"
    draws = read_draws(path)
    if wrong == "hash":
        path.write_bytes(path.read_bytes()[:-1])
    elif wrong == "version":
        monkeypatch.setattr(draws_file, "VERSION", 0)
        write_draws(path, draws)
        monkeypatch.undo()
    else:
        draws.about["suite"] = "large"
        write_draws(path, draws)
    told = {
        "hash": "has a wrong hash",
        "version": "is of another version than 2",
        "suite": "is of suite 'large', not 'small'",
    }
    said = drawn.run("a", code=2)
    assert said.count("\n") == 1 and f"draws file {path} {told[wrong]}" in said
    assert not (drawn.folder / "a").exists()


def test_with_another_salt_a_run_solves_its_own(drawn) -> None:
    suite = load_suite(str(drawn.suite))
    assert draws_source(str(drawn.suite), suite) is not None
    assert draws_source(str(drawn.suite), salted(suite, "other", None)) is None
    said = drawn.call("draws", drawn.suite, "--out", drawn.folder / "small.txt", code=2)
    assert "ends with .draws" in said


def test_a_command_does_not_mix_draws_of_two_suites(drawn) -> None:
    drawn.suite.write_text(SUITE.replace('"small"', '"other"'))
    said = drawn.call("draws", drawn.suite, code=2)
    assert "holds draws of another suite or salt; use another --out" in said


def test_a_worker_with_another_file_refuses_the_trial(drawn) -> None:
    suite = load_suite(str(drawn.suite))
    source = draws_source(str(drawn.suite), suite)
    assert source is not None and opened(source).motions
    with pytest.raises(OtherDrawsError, match="in the worker and 0000 where the run was started"):
        opened(DrawsSource(source.place, "0000"))
    assert opened(None) is None


def test_suites_of_this_package_have_their_draws_in_it() -> None:
    assert draws_path("roads").name == "roads.draws"
    assert draws_path("roads").parent.name == "draws"
