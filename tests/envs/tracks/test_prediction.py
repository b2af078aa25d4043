"""What recorded cars do next."""

import numpy as np
import pytest

from olne_bench.envs.tracks.grid import Grid
from olne_bench.envs.tracks.prediction import (
    NO_LANE,
    NO_LEADER,
    places,
    predict_cars,
    prediction_table,
    respond,
)
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.errors import UserError
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import ArcLane, StraightLane

ROAD = Road({"lane": RoadLane((StraightLane((-100.0, 0.0), (1.0, 0.0), 1000.0),))})
AT, AHEAD = 2.0, 3.0


def straight_on(*lefts: float) -> Grid:
    """Cars 20 m behind each other at 10 m/s, so far to the left of the lane."""
    times = 0.2 * np.arange(26)
    states = [
        np.column_stack([80 - 20 * k + 10 * times, 0 * times + left, 0 * times, 0 * times + 10])
        for k, left in enumerate(lefts)
    ]
    return Grid(times, [f"car {k}" for k in range(len(lefts))], np.stack(states, axis=1))


def test_who_follows_at_its_leaders_speed_goes_straight_on_where_it_is_in_its_lane() -> None:
    first, second = predict_cars(straight_on(0.0, 0.6), ROAD, AT, AHEAD)
    assert (first.why, second.why, second.leaders) == (NO_LEADER, "", ("car 0",))
    for one in (first, second):
        assert one.game == pytest.approx(one.recorded, abs=1e-6)
        assert one.straight == pytest.approx(one.recorded, abs=1e-9)


def test_a_faster_car_slows_down_for_its_leader_and_more_with_its_weight() -> None:
    grid = straight_on(0.0, 0.0)
    grid.states[:, 1, 0] = 20 + 14 * grid.times
    grid.states[:, 1, 3] = 14
    reached = []
    for follow in (0.1, 0.5):
        weights = np.array([follow, *[(1 - follow) / 3] * 3])
        _, one = predict_cars(grid, ROAD, AT, AHEAD, weights=weights)
        reached.append(one.game[-1, 0])
        assert one.straight[-1, 0] == pytest.approx(20 + 14 * 5)
    assert reached[1] < reached[0] < 20 + 14 * 5
    assert reached[1] > 20 + 14 * 2 + 10 * 3  # not slower than its leader


def test_weights_may_be_found_in_what_was_seen() -> None:
    grid = straight_on(0.0, 0.5)
    grid.states[:, 1, 0] = 20 + 14 * grid.times
    grid.states[:, 1, 3] = 14
    grid.states[:3, 0] = np.nan  # the leader is seen later
    weights = np.array([[0.2, 0.3, 0.4, 0.1], [0.4, 0.3, 0.2, 0.1]])
    asked = []

    def found(game: Game, states: np.ndarray) -> np.ndarray:
        asked.append((game.horizon, game.dt, states))
        return weights

    _, one = predict_cars(grid, ROAD, AT, AHEAD, weights=found)
    ((horizon, dt, states),) = asked
    assert (dt, states.shape) == (pytest.approx(0.2), (11, 2, 4))
    assert horizon == 11 + round(AHEAD / dt)  # plans end with the prediction
    assert np.isnan(states[:3, 1]).all() and np.isfinite(states[3:, 1]).all()
    along = 120 + 14 * grid.times[:11]
    assert states[:, 0] == pytest.approx(
        np.column_stack([along, 0 * along + 0.5, 0 * along, 0 * along + 14])
    )
    (same,) = predict_cars(grid, ROAD, AT, AHEAD, players=["car 1"], weights=weights)
    assert one.game == pytest.approx(same.game)


def test_a_chain_passes_on_what_its_first_car_does() -> None:
    """The leader's leader is slow: in the game its leader will slow down, alone it will not."""
    grid = straight_on(0.0, 0.0, 0.0)
    grid.states[:, 0, 0] = 80 + 5 * grid.times
    grid.states[:, 0, 3] = 5
    together = predict_cars(grid, ROAD, AT, AHEAD, players=["car 2"])[0]
    alone = predict_cars(grid, ROAD, AT, AHEAD, players=["car 2"], most=2)[0]
    assert (together.leaders, alone.leaders) == (("car 1", "car 0"), ("car 1",))
    assert together.game[-1, 0] < alone.game[-1, 0] - 0.3
    assert alone.game[-1] == pytest.approx(alone.straight[-1], abs=1e-6)


def test_errors_are_along_the_way_and_across_it_on_a_bend() -> None:
    bend = RoadLane((ArcLane((0.0, 50.0), 50.0, -np.pi / 2, np.pi / 2),))
    times = 0.2 * np.arange(26)
    angle = 10 * times / 50
    states = np.column_stack(
        [50 * np.sin(angle), 50 - 50 * np.cos(angle), angle, np.full(len(times), 10.0)]
    )
    grid = Grid(times, ["car"], states[:, None])
    (one,) = predict_cars(grid, Road({"bend": bend}), AT, AHEAD)
    assert one.errors(one.straight) == pytest.approx(np.zeros((16, 2)), abs=0.1)
    shifted = 49 * np.column_stack([np.sin(angle), -np.cos(angle)])[10:] + [0, 50]
    assert one.errors(shifted)[:, 1] == pytest.approx(1.0, abs=0.1)


def test_a_car_in_no_lane_drives_straight_on() -> None:
    grid = straight_on(30.0)
    (one,) = predict_cars(grid, ROAD, AT, AHEAD)
    assert one.why == NO_LANE
    assert one.game == pytest.approx(one.recorded)


def test_what_is_not_recorded_is_missing_and_samples_after_the_time_do_not_count() -> None:
    grid = straight_on(0.0, 0.5)
    (early, *_), later = predict_cars(grid, ROAD, AT, AHEAD), straight_on(0.0, 0.5)
    later.states[later.times > AT + 1e-6] += 7.0
    assert predict_cars(later, ROAD, AT, AHEAD)[0].game == pytest.approx(early.game)
    (late, *_) = predict_cars(grid, ROAD, 4.0, AHEAD)
    assert np.isfinite(late.recorded).all(axis=1).tolist() == [True] * 6 + [False] * 10


def test_the_table_has_a_row_for_each_car_and_time() -> None:
    table = prediction_table(predict_cars(straight_on(0.0, 0.6), ROAD, AT, AHEAD))
    assert len(table) == 2 * 16
    assert table["game_along"].abs().max() < 1e-6
    assert (table["along_90"].diff().dropna() != 0).all()
    assert set(table["note"]) == {"", NO_LEADER}


@pytest.mark.parametrize(
    ("at", "ahead", "players", "said"),
    [
        (9.0, 3.0, (), "--at 9: the recording has times from 0 to 5 s"),
        (2.0, 0.0, (), "--ahead 0: expected 0.2 to 20 s"),
        (2.0, 3.0, ("nobody",), "player 'nobody' is seen moving at 2 s; there are: car 0"),
    ],
)
def test_bad_input_is_named(at: float, ahead: float, players: tuple[str, ...], said: str) -> None:
    with pytest.raises(UserError, match=said):
        predict_cars(straight_on(0.0), ROAD, at, ahead, players=players)


def test_who_knows_its_leader_answers_what_it_does():
    """With the motion that the leader has in the game, the response is the equilibrium."""
    grid = straight_on(0.0, 0.0)
    grid.states[:, 1, 0] = 20 + 14 * grid.times
    grid.states[:, 1, 3] = 14
    first, second = predict_cars(grid, ROAD, AT, AHEAD)
    led = places(second.way, first.straight)
    found = respond(second.drivers, led)
    assert found[:, 0] == pytest.approx(places(second.way, second.game)[:, 0], abs=1e-3)
    braking = led.copy()
    braking[:, 0] -= 0.5 * first.times**2
    slower = respond(second.drivers, braking)
    lost = found[:, 0] - slower[:, 0]
    assert (lost[2:] > 0).all() and lost[-1] < (led - braking)[-1, 0]


def test_who_drives_away_is_not_followed():
    speeds = (18.0, 10.0)
    grid = straight_on(0.0, 0.0)
    for k, speed in enumerate(speeds):
        grid.states[:, k, 0] = 60 - 20 * k + speed * grid.times
        grid.states[:, k, 3] = speed
    _, one = predict_cars(grid, ROAD, AT, AHEAD)
    assert one.leaders == ("car 0",) and one.why == ""
    assert one.game == pytest.approx(one.straight, abs=1e-6)
    grid.states[:, 0, 0] = 60 + 14 * grid.times
    grid.states[:, 0, 3] = 14.0
    _, one = predict_cars(grid, ROAD, AT, AHEAD)
    assert one.game[-1, 0] > one.straight[-1, 0] + 1


def test_regions_grow_with_time_and_with_what_changes():
    grid = straight_on(0.0, 0.0)
    _, same = predict_cars(grid, ROAD, AT, AHEAD)
    grid.states[:, 1, 0] = 20 + 14 * grid.times
    grid.states[:, 1, 3] = 14
    _, slower = predict_cars(grid, ROAD, AT, AHEAD)
    assert (np.diff(same.half_widths, axis=0) > 0).all() and (same.half_widths[0] == 0).all()
    more = slower.half_widths - same.half_widths
    assert more[-1, 0] == pytest.approx(0.6 * (slower.straight - slower.game)[-1, 0], rel=1e-3)
    assert more[:, 1] == pytest.approx(0, abs=1e-9)
