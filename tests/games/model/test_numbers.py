"""Structure and numbers of a game apart."""

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.scenarios import highway, intersection, merge, roundabout, two_way
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.costs import (
    ControlEffort,
    Feature,
    FinalGoal,
    Proximity,
    Stage,
    StateDeviation,
)
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.lanes import LaneKeeping, StraightLane
from olne_bench.games.model.numbers import (
    numbers_of,
    structure_and_numbers,
    view_and_numbers,
    with_symbols,
)
from olne_bench.games.model.observation import (
    Components,
    ComponentView,
    RangeBearingView,
    View,
    WhitenedView,
    observe,
)
from olne_bench.games.solve.newton import unpack
from tests.games.conftest import rows_agree

ROADS = {
    "highway": (highway.propose, 5),
    "intersection": (intersection.propose, 3),
    "merge": (merge.propose, 4),
    "roundabout": (roundabout.propose, 4),
    "two_way": (two_way.propose, 5),
}


def game(player: Player, dt: float = 0.25) -> Game:
    return Game((player, player), UNICYCLE, 5, dt)


def test_floats_are_numbers_and_all_else_is_structure() -> None:
    @dataclass(frozen=True)
    class Nested:
        place: tuple[float, float]
        exponent: int
        smooth: bool

    @dataclass(frozen=True)
    class Outer:
        nested: Nested
        width: float
        name: str

    thing = Outer(Nested((1, 2.5), 3, True), 4, "outer")
    assert numbers_of(thing) == (1.0, 2.5, 4.0)
    symbols = ca.SX.sym("numbers", 3)
    copy = with_symbols(thing, symbols)
    assert (copy.nested.exponent, copy.nested.smooth, copy.name) == (3, True, "outer")
    assert [str(copy.nested.place[1]), str(copy.width)] == ["numbers_1", "numbers_2"]


def test_games_share_a_structure_where_numbers_alone_differ() -> None:
    speed, effort = StateDeviation("speed", 1.0), ControlEffort("acceleration")
    first = Player((Proximity(), speed, effort), (FinalGoal((1.0, 2.0)),))
    second = Player((Proximity(0.3), StateDeviation("speed", 7), effort), (FinalGoal((0, 5)),))
    third = Player((Proximity(), StateDeviation("heading", 1.0), effort))
    (same, one), (other, two) = (structure_and_numbers(game(p)) for p in (first, second))
    assert same == other and not np.array_equal(one, two)
    assert structure_and_numbers(game(first, dt=0.5))[0] == same
    assert structure_and_numbers(game(third))[0] != same


@pytest.mark.parametrize("road", ROADS)
def test_all_draws_of_a_road_share_a_structure(road: str) -> None:
    propose, count = ROADS[road]
    draws = [propose(np.random.default_rng(seed), count).game for seed in range(8)]
    assert len({structure_and_numbers(draw)[0] for draw in draws}) == 1
    assert len({structure_and_numbers(draw)[1].tobytes() for draw in draws}) == len(draws)


@dataclass(frozen=True)
class Named:
    """What the features below have in common."""

    target: float
    name: str = "own"

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


class OneSided(Named):
    """Decides by a number."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        if self.target > 1:
            return (stage.own_state("speed") - self.target) ** 2
        return stage.own_state("speed") ** 4


class Directed(Named):
    """Brings a number to a float, which makes a symbol no number at all."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return (stage.own_state("px") * math.cos(self.target)) ** 2


class Typed(Named):
    """Asks what a number is, and is none the wiser."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        known = isinstance(self.target, float)
        return (stage.own_state("px") - (self.target if known else 0.0)) ** 2


class Stepped(Named):
    """Decides by the length of a step."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.target * stage.own_state("speed") ** (2 if stage.dt > 0.3 else 4)


class Meeting(Named):
    """Needs all players: it divides by the number of the others."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        others = [stage.position(j) for j in range(len(stage.states)) if j != stage.player]
        mean = sum(others) / len(others)
        return self.target * ca.sumsqr(stage.position(stage.player) - mean) + len(others)


def of_own(feature: Feature, dt: float = 0.25) -> Game:
    effort = ControlEffort("acceleration"), ControlEffort("yaw_rate")
    return game(Player((feature, *effort), (FinalGoal((1.0, 2.0)),)), dt)


@pytest.mark.parametrize("kind", [OneSided, Directed, Typed])
def test_a_feature_that_decides_by_its_numbers_keeps_them(kind: type[Named]) -> None:
    low, high = of_own(kind(0.5)), of_own(kind(2.0))
    assert structure_and_numbers(low)[0] != structure_and_numbers(high)[0]
    rows_agree(low)
    rows_agree(high)


def test_features_beside_one_that_decides_still_share_their_numbers() -> None:
    first = of_own(OneSided(0.5))
    goal = replace(first.players[0], task=(FinalGoal((3.0, 4.0)),))
    second = replace(first, players=(goal, goal))
    assert structure_and_numbers(first)[0] == structure_and_numbers(second)[0]
    rows_agree(second)


def test_a_feature_that_decides_by_the_step_keeps_it() -> None:
    short, long = of_own(Stepped(2.0), 0.25), of_own(Stepped(2.0), 0.5)
    assert structure_and_numbers(short)[0] != structure_and_numbers(long)[0]
    rows_agree(short)
    rows_agree(long)


def test_a_motion_model_that_decides_by_the_step_keeps_it() -> None:
    def step(state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
        return UNICYCLE.step(state, control, dt if dt > 0.3 else 0.0)

    player = Player((StateDeviation("speed", 1.0), ControlEffort("acceleration")))
    for dt in (0.25, 0.5):
        rows_agree(Game((player, player), replace(UNICYCLE, step=step), 5, dt))


def test_a_feature_that_needs_all_players_gets_them() -> None:
    rows_agree(of_own(Meeting(0.7)))


@dataclass(frozen=True)
class Wave:
    """A lane of one's own, of which no table of lanes knows."""

    height: float
    length: float = 10.0

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        return position[0], position[1] - self.height * ca.tanh(position[0]), ca.SX(0)


def test_a_route_may_hold_lanes_of_ones_own() -> None:
    lanes = StraightLane((-9.0, 0.0), (1.0, 0.0), 9.0), Wave(0.5)
    low, high = (of_own(LaneKeeping((lanes[0], Wave(height)))) for height in (0.5, 0.7))
    assert structure_and_numbers(low)[0] == structure_and_numbers(high)[0]
    rows_agree(low)


@dataclass(frozen=True)
class Sided(View):
    """Sees one side, by a number."""

    side: float
    name: str = "sided"

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        return state[:2] * (2.0 if self.side > 0 else -3.0)


@pytest.mark.parametrize(
    "view",
    [
        Sided(1.0),
        Sided(-1.0),
        RangeBearingView((-4.0, 1.0), 0.3),
        RangeBearingView((-5.0, 2.0), -0.3),
        WhitenedView(ComponentView("two", ("px", "speed")), ((2.0, 0.0), (0.5, 3.0))),
    ],
)
def test_the_loss_is_that_of_the_view_at_hand(view: View) -> None:
    own = of_own(StateDeviation("speed", 1.0))
    solver = elimination(own, view)
    z = np.random.default_rng(2).uniform(0.5, 1.5, (own.horizon, solver.stages.size))
    seen = observe(view, own.dynamics, unpack(own, z)[0]).reshape(own.horizon, -1)
    solver.set_observations(seen + 0.1)
    assert solver.observation_loss(z)[0] == pytest.approx(0.01 * seen.size, rel=1e-9)


def test_views_share_a_structure_where_numbers_alone_differ() -> None:
    (same, one), (other, two) = (
        view_and_numbers(RangeBearingView((x, 0.0)), UNICYCLE) for x in (1.0, 2.0)
    )
    assert same == other and not np.array_equal(one, two)
    assert view_and_numbers(Sided(1.0), UNICYCLE)[0] != view_and_numbers(Sided(-1.0), UNICYCLE)[0]
