"""Costs as sums of terms of one player, of a pair, and of everybody."""

from dataclasses import dataclass

import casadi as ca
import pytest

from olne_bench.games.compiled.stage_functions import stage_functions
from olne_bench.games.compiled.terms import terms_of
from olne_bench.games.model.costs import (
    CarProximity,
    ControlEffort,
    Feature,
    Following,
    Proximity,
    Stage,
)
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.numbers import structure_and_numbers
from tests.games.conftest import rows_agree


@dataclass(frozen=True)
class KeepToTheMiddle:
    """Looks at all others at once: the squared distance to their mean."""

    scale: float = 1.0
    name: str = "middle"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        others = [stage.position(j) for j in range(len(stage.states)) if j != stage.player]
        mean = sum(others) / max(1, len(others))
        return self.scale * ca.sumsqr(stage.position(stage.player) - mean)

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class FollowFirst:
    """Looks at the player of number 0."""

    name: str = "first"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return ca.sumsqr(stage.position(stage.player) - stage.position(0))

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


def three(feature: Feature) -> Game:
    efforts = ControlEffort("yaw_rate"), ControlEffort("acceleration")
    return Game((Player((feature, *efforts)),) * 3, UNICYCLE, 4, 0.5)


def reach(feature: Feature) -> list[tuple[int, ...]]:
    """The players that the terms look at, but for those that look at one."""
    terms = terms_of(structure_and_numbers(three(feature))[0])
    return [term.players for term in terms if len(term.players) > 1]


def test_a_sum_over_others_is_a_term_of_each_pair() -> None:
    pairs = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]
    assert reach(Proximity()) == reach(CarProximity(4.0, 2.0)) == pairs
    assert len(stage_functions(three(Proximity())).kinds) == 2


def test_what_is_no_sum_over_others_is_a_term_of_everybody() -> None:
    assert reach(KeepToTheMiddle()) == [(0, 1, 2)] * 3
    assert reach(FollowFirst()) == [(0, 1, 2)] * 2  # the first one looks at itself alone
    assert reach(SpeedOnly()) == []


@dataclass(frozen=True)
class SpeedOnly:
    """Looks at its own player alone."""

    name: str = "own"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return stage.own_state("speed") ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


@pytest.mark.parametrize("feature", [KeepToTheMiddle(), FollowFirst(), SpeedOnly(), Proximity()])
def test_rows_are_those_of_the_stacked_system(feature: Feature) -> None:
    rows_agree(three(feature))


def following(*leaders: int) -> Game:
    efforts = ControlEffort("yaw_rate"), ControlEffort("acceleration")
    players = tuple(Player((Following(leader), *efforts)) for leader in leaders)
    return Game(players, UNICYCLE, 4, 0.5)


def test_who_names_others_has_a_term_with_these_alone() -> None:
    terms = terms_of(structure_and_numbers(following(-1, 0, 1, 0))[0])
    assert [one.players for one in terms if len(one.players) > 1] == [(1, 0), (2, 1), (3, 0)]
    assert len({one.kind for one in terms}) == 2  # one of a player alone, one of two


def test_terms_of_named_players_are_those_of_the_whole_game() -> None:
    rows_agree(following(1, 2, -1))


def test_nobody_follows_itself_or_a_player_who_is_not_there() -> None:
    for leaders in ((0, 0), (1, 2)):
        with pytest.raises(ValueError, match="expected another one of the players 0 to 1"):
            following(*leaders)
