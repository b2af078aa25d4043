"""What happens in a player process: an estimator gets its problem and observations, and is read."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.run import player
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.observation import FullView

PLUGIN = """
from types import SimpleNamespace
import numpy as np

said = []


class Plain:
    name = "Plain"

    def estimate(self, problem, observation, *, rng, budget):
        said.append((problem, observation, rng, budget))
        return SimpleNamespace(weights=[[0.5, 0.5]], message=f"of {problem.sigma}")


class Several(Plain):
    name = "Several"
    several = True


class Choosy(Several):
    name = "Choosy"

    def __init__(self, least=0):
        self.least = least

    def supports(self, problem):
        said.append("asked")
        return None if problem.sigma >= self.least else "too\\nsmall"

    def supports_several(self, problem):
        return "one at a time" if problem.sigma == 9 else None

    def warm_up(self, problem):
        said.append(f"warmed up for {problem.sigma}")


class Writes(Plain):
    name = "Writes"

    def estimate(self, problem, observation, *, rng, budget):
        for array in (observation.extra, observation.y):
            try:
                array[0] = 0
            except ValueError:
                continue
            raise AssertionError("could write")
        return SimpleNamespace(weights=[[1.0]])


class Changes(Plain):
    name = "Changes"

    def estimate(self, problem, observation, *, rng, budget):
        object.__setattr__(problem.game, "dt", 7.0)
        object.__setattr__(problem, "sigma", 0.0)
        return SimpleNamespace(weights=[[1.0]])


class Wrong(Plain):
    name = "Wrong"

    def estimate(self, *args, **kwargs):
        return SimpleNamespace(weights="a lot\\nof it")
"""


PROBLEM = Problem(get_scenario("two_player").game, FullView(), 9.0)


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    file = tmp_path / "plugin.py"
    file.write_text(PLUGIN)
    return file


def prepare(plugin: Path, name: str, trajectories: int = 1, **parameters: object) -> str | None:
    given = pickle.dumps(PROBLEM)
    return player.prepare(f"{plugin}:{name}", parameters, (), given, 5, trajectories).declined


def observation(first: float = 0.0) -> Observation:
    return Observation(y=np.full((3, 1, 2), first), extra=np.full((1, 2), first))


def said() -> list:
    """What the estimators that were prepared last have noted."""
    assert player._seat is not None
    noted: list = type(player._seat.estimator).estimate.__globals__["said"]
    return noted


def test_an_estimator_is_given_the_problem_one_observation_and_its_random_numbers(plugin):
    assert prepare(plugin, "Plain") is None
    answered = player.estimate((observation(3.0),), 7.5)
    ((problem, seen, rng, budget),) = said()
    assert (repr(problem), budget) == (repr(PROBLEM), 7.5)
    assert isinstance(seen, Observation)
    np.testing.assert_array_equal(seen.y, 3.0)
    assert rng.uniform() == np.random.default_rng(5).uniform()
    assert answered.malformed == ""
    assert answered.estimate.message == "of 9.0"


def test_several_observations_come_together(plugin):
    assert prepare(plugin, "Several", trajectories=2) is None
    player.estimate((observation(1.0), observation(2.0)), 1.0)
    ((_, seen, _, _),) = said()
    assert [one.y[0, 0, 0] for one in seen] == [1.0, 2.0]
    assert prepare(plugin, "Several") is None


def test_who_takes_one_trajectory_is_not_given_two(plugin):
    assert prepare(plugin, "Plain", trajectories=2) == "takes one trajectory at a time, not 2"
    assert prepare(plugin, "Choosy", trajectories=2) == "one at a time"
    assert prepare(plugin, "Choosy", trajectories=1) is None


def test_an_estimator_may_decline_and_is_set_up_where_it_does_not(plugin):
    assert prepare(plugin, "Choosy", least=9) is None
    assert said() == ["asked", "warmed up for 9.0"]
    del said()[:]
    seat = player._seat
    assert prepare(plugin, "Choosy", least=10) == "too small"
    assert said() == ["asked"]
    assert player._seat is seat  # nobody sits down who declines


def test_observations_cannot_be_written_into(plugin):
    prepare(plugin, "Writes")
    given = observation()
    assert player.estimate((given,), 1.0).estimate is not None
    without = Observation(y=given.y, extra=None)
    prepare(plugin, "Plain")
    assert player.estimate((without,), 1.0).estimate is not None


def test_a_problem_stays_as_it_was_given(plugin):
    prepare(plugin, "Changes")
    answered = player.estimate((observation(),), 1.0)
    assert answered.estimate is None
    assert answered.malformed == "it changes the problem: problem.sigma, problem.game.dt"


def test_what_is_no_estimate_is_told_in_one_line(plugin):
    prepare(plugin, "Wrong")
    answered = player.estimate((observation(),), 1.0)
    assert answered.estimate is None
    assert "weights" in answered.malformed and "\n" not in answered.malformed


def test_files_of_other_plugins_are_imported_first(plugin, tmp_path):
    other = tmp_path / "other.py"
    other.write_text("from pathlib import Path\nPath(__file__).with_name('seen').touch()\n")
    given = pickle.dumps(PROBLEM)
    assert player.prepare(f"{plugin}:Plain", {}, [str(other)], given, 0, 1).declined is None
    assert (tmp_path / "seen").exists()
