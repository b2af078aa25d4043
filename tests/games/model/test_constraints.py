"""Constraints as data: what they mean, and what they refuse."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.model.constraints import (
    Constraint,
    ControlBound,
    Distance,
    Ellipse,
    RoadEdge,
    StateBound,
)
from olne_bench.games.model.costs import ControlEffort, Stage, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player


def _game(*constraints: Constraint) -> Game:
    player = Player((StateDeviation("speed"), ControlEffort("yaw_rate")))
    return Game((player,) * 3, UNICYCLE, 10, 0.1, constraints)


def _margins(constraint: Constraint, *states: list[float], control: object = None) -> np.ndarray:
    stage = Stage(0, tuple(ca.SX(state) for state in states), control, UNICYCLE, 0.1)
    return np.array(ca.evalf(ca.SX(constraint.margins(stage)))).ravel()


def test_distance_is_zero_where_circles_touch_and_close_to_the_gap_near_by() -> None:
    distance = Distance((0, 1), 2.0)
    assert _margins(distance, [0, 0, 0, 0], [0, 2, 0, 0]) == pytest.approx(0)
    assert _margins(distance, [0, 0, 0, 0], [0, 2.01, 0, 0]) == pytest.approx(0.01, rel=0.01)
    assert _margins(distance, [0, 0, 0, 0], [1, 1, 0, 0]) < 0


def test_ellipse_turns_with_the_first_player() -> None:
    ellipse = Ellipse((0, 1), length=4.0, width=1.0)
    assert _margins(ellipse, [0, 0, 0, 0], [4, 0, 0, 0]) == pytest.approx(0)
    assert _margins(ellipse, [0, 0, np.pi / 2, 0], [1, 0, 0, 0]) == pytest.approx(0)


def test_bounds_and_edges() -> None:
    speed = StateBound((0,), "speed", -1.0, 3.0)
    assert _margins(speed, [0, 0, 0, 2]) == pytest.approx([3, 1])
    rate = ControlBound((0,), "yaw_rate", upper=0.5)
    assert _margins(rate, [0, 0, 0, 2], control=ca.SX([0.1, 9.0])) == pytest.approx([0.4])
    assert _margins(rate, [0, 0, 0, 2]).size == 0  # no control in the last step
    edge = RoadEdge((0,), (0.0, 1.0), (0.0, -2.0), clearance=0.25)
    assert _margins(edge, [5, 0.5, 0, 0]) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StateBound((1,), "speed", 2.0, 2.0), "'speed' of player 1: the range 2.0 to 2.0"),
        (lambda: ControlBound((0,), "yaw_rate"), "'yaw_rate' of player 0 needs a finite"),
        (lambda: Distance((0, 2), -1.0), "'distance' of players 0 and 2: distance must be"),
        (lambda: RoadEdge((0,), (0.0, 0.0), (0.0, 0.0)), "'road edge' of player 0: inward"),
        (lambda: _game(Distance((0, 3), 1.0)), "players 0 and 3: the game's players are 0 to 2"),
        (lambda: _game(Distance((1, 1), 1.0)), "players 1 and 1 needs different players"),
        (lambda: _game(Distance((0, 1), 1.0, first_step=10)), "first_step must be 0 to 9, got 10"),
        (lambda: _game(StateBound((0,), "yaw", 0.0)), "'yaw' of player 0: unicycle has"),
        (
            lambda: _game(StateBound((1,), "speed", 2.0), StateBound((1,), "speed", upper=1.0)),
            "contradiction: no motion keeps constraint 'speed' of player 1",
        ),
        (
            lambda: _game(
                RoadEdge((2,), (0.0, 1.0), (0.0, 1.0)), StateBound((2,), "py", upper=0.5)
            ),
            "contradiction: no motion keeps constraint 'road edge' of player 2 and constraint 'py'",
        ),
    ],
)
def test_one_line_names_player_and_constraint(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("(", r"\(")) as error:
        make()  # type: ignore[operator]
    assert "\n" not in str(error.value)


def test_ranges_of_different_players_do_not_contradict() -> None:
    game = _game(StateBound((0,), "speed", 2.0), StateBound((1,), "speed", upper=1.0))
    assert len(game.constraints) == 2
