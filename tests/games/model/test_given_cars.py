"""Time gaps, jerk, and cars that are no players."""

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.protocol import Observation
from olne_bench.games.model.costs import (
    Absent,
    ControlEffort,
    Feature,
    Following,
    FollowingGiven,
    GivenCar,
    StateDeviation,
    TimeGap,
    TimeGapToGiven,
)
from olne_bench.games.model.dynamics import (
    DOUBLE_INTEGRATOR,
    Dynamics,
    bicycle,
    with_clock,
    with_jerk,
)
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import FullView
from olne_bench.games.solve.olne import solve_olne

STEPS, DT = 12, 0.4
CAR = bicycle()
EFFORTS = ControlEffort("acceleration", 4.0), ControlEffort("steering", 400.0)
LANE = StateDeviation("py"), StateDeviation("heading", scale=100.0)
#: A leader who brakes, and players behind it.
SPEEDS = 15 - 2.0 * DT * np.arange(STEPS).clip(max=6)
ALONG = 30 + np.concatenate([[0.0], np.cumsum(SPEEDS[:-1] * DT)])
BEHIND = np.array([[12.0, 0, 0, 15.0], [0.0, 0, 0, 16.0]])
TURNED = BEHIND + np.array([0.0, 0.0, 0.02, 0.0])  # they steer


def braking(step: int = 1) -> GivenCar:
    places = tuple((float(x), 0.0) for x in ALONG[::step])
    return GivenCar(places, tuple(map(float, SPEEDS[::step])), step * DT)


def solved(players: tuple[Player, ...], dynamics: Dynamics, start: np.ndarray) -> np.ndarray:
    game = Game(players, dynamics, STEPS, DT)
    weights = np.full((len(players), game.num_weights), 1.0)
    found = solve_olne(game, weights, start)
    assert found.certificate.passed
    return found.states


def clocked(start: np.ndarray, time: float = 0.0) -> np.ndarray:
    return np.column_stack([start, np.full(len(start), time)])


def driver(*likes: Feature) -> Player:
    return Player((*likes, StateDeviation("speed", 16.0, 0.05), *EFFORTS), LANE)


@pytest.mark.parametrize("gap", [False, True])
def test_a_given_leader_is_minded_like_a_player_who_moves_so(gap: bool) -> None:
    """A leader with no wish but one that makes it brake, as a player and as told."""
    first = Player((Absent("leader"), StateDeviation("speed", 6.0, 1.0), *EFFORTS), LANE)
    mind = TimeGap(0, name="leader") if gap else Following(0, name="leader")
    start = np.array([[30.0, 0, 0, 15.0], *BEHIND[1:]])
    together = solved((first, driver(mind)), CAR, start)
    led = together[:, 0]
    told = GivenCar(tuple(map(tuple, led[:, :2])), tuple(led[:, 3]), DT)
    given = TimeGapToGiven(told, name="leader") if gap else FollowingGiven(told, name="leader")
    alone = solved((driver(given),), with_clock(CAR), clocked(BEHIND[1:]))
    assert np.abs(alone[:, 0, :4] - together[:, 1]).max() < 1e-6


def test_a_clock_that_starts_later_sees_the_car_later() -> None:
    player = driver(FollowingGiven(braking()))
    first, later = (
        solved((player,), with_clock(CAR), clocked(BEHIND[1:], time)) for time in (0.0, 2.0)
    )
    assert later[3, 0, 3] < first[3, 0, 3] - 0.5
    assert np.allclose(later[:, 0, 4], 2.0 + DT * np.arange(STEPS))


def test_coarse_samples_are_interpolated() -> None:
    fine, coarse = (
        solved((driver(FollowingGiven(braking(s))),), with_clock(CAR), clocked(BEHIND[1:]))
        for s in (1, 2)
    )
    assert np.abs(fine - coarse)[..., :4].max() < 0.15


def test_a_time_gap_is_reached() -> None:
    """Behind a leader of constant speed, who costs the follower nothing else."""
    places = tuple((40.0 + 10.0 * DT * k, 0.0) for k in range(80))
    car = GivenCar(places, (10.0,) * 80, DT)
    player = Player((TimeGapToGiven(car, seconds=2.0, standstill=6.0), *EFFORTS), LANE)
    game = Game((player,), with_clock(CAR), 60, DT)
    start = clocked(np.array([[0.0, 0.0, 0.0, 12.0]]))
    states = solve_olne(game, np.ones((1, 3)), start).states
    distance = 40.0 + 10.0 * DT * np.arange(60) - states[:, 0, 0]
    assert distance[30] == pytest.approx(6.0 + 2.0 * states[30, 0, 3], abs=0.1)
    assert states[30, 0, 3] == pytest.approx(10.0, abs=0.1)


def test_jerk_is_what_smooth_drivers_save() -> None:
    smooth = with_jerk(CAR)
    assert smooth.state_names[-1] == "acceleration"
    assert smooth.control_names == ("steering", "jerk")
    player = Player(
        (StateDeviation("speed", 20.0), ControlEffort("jerk", 4.0), ControlEffort("steering"))
    )
    states = solved((player,), smooth, np.array([[0.0, 0.0, 0.0, 10.0, 0.0]]))
    accelerations = states[:, 0, 4]
    assert np.allclose(np.diff(states[:, 0, 3]), DT * accelerations[:-1])
    assert accelerations[0] == 0 and accelerations[2] > 0.5
    with pytest.raises(ValueError, match="double_integrator has no control 'acceleration' but ax"):
        with_jerk(DOUBLE_INTEGRATOR)


def test_weights_of_followers_of_a_given_car_are_found() -> None:
    """Without noise, of a player behind it and of one that follows this player."""
    first = driver(FollowingGiven(braking(), scale=0.3))
    players = (first, driver(Following(0, scale=0.3)))
    game = Game(players, with_clock(CAR), STEPS, DT)
    truth = game.check_weights(np.array([[0.5, 0.2, 0.2, 0.1], [0.2, 0.4, 0.3, 0.1]]))
    states = solve_olne(game, truth, clocked(TURNED)).states
    problem = ob.Problem(game, FullView(), 1e-4, noise_scale=(1.0, 1.0, 0.1, 1.0, 0.01))
    found = ob.estimate(problem, Observation(states), "kkt_constrained")
    assert np.abs(found.weights - truth).max() < 2e-2


def test_weights_beside_a_preference_that_one_player_lacks_are_found() -> None:
    lone = Player((Absent("following"), StateDeviation("speed", 8.0), *EFFORTS), LANE)
    game = Game((lone, driver(Following(0, scale=0.3))), CAR, STEPS, DT)
    truth = game.check_weights(np.array([[0.2, 0.4, 0.2, 0.2], [0.2, 0.4, 0.3, 0.1]]))
    states = solve_olne(game, truth, TURNED).states
    problem = ob.Problem(game, FullView(), 1e-4)
    found = ob.estimate(problem, Observation(states), "map").weights
    assert found[0, 1] / found[0, 2] == pytest.approx(2.0, rel=1e-2)
    assert found[0, 3] == pytest.approx(0.2, rel=1e-2)  # against the lane, a task
    assert np.abs(found[1] - truth[1]).max() < 1e-3


def test_bad_cars_are_refused() -> None:
    with pytest.raises(ValueError, match="got 2 places and 1 speeds"):
        GivenCar(((0.0, 0.0), (1.0, 0.0)), (1.0,), 0.1)
    with pytest.raises(ValueError, match="positive number of seconds, got 0"):
        GivenCar(((0.0, 0.0),), (1.0,), 0.0)
