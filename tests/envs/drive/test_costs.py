import numpy as np
import pytest
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.drive.cars import ROADS, STEP, STEPS, EgoCost, least_gaps, proposed_cars
from olne_bench.envs.roads.footprint import gap


@pytest.fixture
def cost() -> tuple[EgoCost, np.ndarray]:
    ego = proposed_cars(ROADS["highway"], np.random.default_rng(3), "temperaments")[0]
    on_lane = ego.start.copy()
    on_lane[1], on_lane[2], on_lane[3] = ego.lanes[0].start[1], 0.0, ego.target_speed  # type: ignore[attr-defined]
    return EgoCost(ego), on_lane


def test_who_drives_as_it_wants_pays_nothing(cost) -> None:
    ego, state = cost
    assert ego.of_step(state[None], np.zeros(2)) == pytest.approx(0, abs=1e-9)
    far = state + np.array([40, 4, 0, 0])
    assert ego.of_step(np.stack([state, far]), np.zeros(2)) == pytest.approx(0, abs=1e-9)


def test_terms_have_their_weights_and_units(cost) -> None:
    ego, state = cost
    weights = ego._weights
    slow = state - np.array([0, 0, 0, 3.0])
    assert ego.of_step(slow[None], np.zeros(2)) == pytest.approx(weights[1])
    assert ego.of_step(state[None], np.array([0, 2.0])) == pytest.approx(weights[2])
    assert ego.of_step(state[None], np.array([0.03, 0])) == pytest.approx(weights[3])
    beside = state + np.array([0, 1.5, 0, 0])
    assert ego.of_step(beside[None], np.zeros(2)) == pytest.approx(0.25)  # the mean weight
    near = state + np.array([6.0, 0, 0, 0])
    both = ego.of_step(np.stack([state, near]), np.zeros(2))
    assert both == pytest.approx(weights[0] * np.log(25.1 / 1.1))
    assert pytest.approx(0.2) == STEP


def test_standing_at_the_start_costs_one_and_so_does_a_collision(cost) -> None:
    ego, state = cost
    motion, controls = [state[None]] * 3, [np.zeros(2)] * 2
    assert ego.of_drive(motion, controls, crashed=False) == pytest.approx(0, abs=1e-9)
    whole = ego.of_drive(motion, controls, crashed=True)
    assert whole == pytest.approx((STEPS - 2) / STEPS)
    stands = proposed_cars(ROADS["highway"], np.random.default_rng(3), "temperaments")[0].start
    stands = stands * np.array([1, 1, 1, 0])
    assert ego.share(stands[None], np.zeros(2)) == pytest.approx(1.0)
    beyond = stands + np.array([0, 50.0, 0, 0])
    assert ego.of_step(beyond[None], np.zeros(2)) > ego.of_step(stands[None], np.zeros(2))
    assert ego.share(beyond[None], np.zeros(2)) == 1.0


def test_the_cost_of_plans_is_that_of_their_steps_until_cars_overlap(cost) -> None:
    ego, state = cost
    slow = state - np.array([0, 0, 0, 3.0])
    aside, on_top = slow + np.array([0, 8.0, 0, 0]), slow + np.array([0.5, 0, 0, 0])
    free = np.stack([np.stack([slow, aside])] * 5)
    hit = free.copy()
    hit[2, 1] = on_top
    controls = np.zeros((4, 2))
    costs = ego.of_plans(np.stack([free, hit]), np.stack([controls] * 2))
    step, touching = ego.share(free[0], controls[0]), ego.share(hit[2], controls[0])
    assert costs[0] == pytest.approx(step)
    assert costs[1] == pytest.approx((2 * step + 2) / 4)
    assert touching > step
    drive = ego.of_drive(list(hit[:3]), list(controls[:2]), crashed=True, steps=4)
    assert costs[1] == pytest.approx(drive)
    alone = ego.share(free[0, :1], controls[0])
    assert ego.of_plans(free[:, :1], controls) == pytest.approx(alone)  # nobody is there


def test_cars_that_cross_between_two_steps_are_too_near() -> None:
    """At both steps they are apart; a third of a step later the ego is in the other's way."""
    before = np.array([[-6.0, 0.0, 0.0, 60.0], [0.0, 0.0, np.pi / 2, 0.0]])
    after = np.array([[6.0, 0.0, 0.0, 60.0], [0.0, 0.0, np.pi / 2, 0.0]])
    motion = np.stack([before, after, after])
    assert gap(motion[:, :1], motion[:, 1:]).min() > 2
    np.testing.assert_allclose(least_gaps(motion)[0], 0.0)
    assert least_gaps(motion)[1] > 2
    assert np.isinf(least_gaps(motion[:, :1])).all()  # nobody is there


def test_a_plan_that_leaves_half_of_the_room_collides_with_a_chance_of_one_half(cost) -> None:
    ego, state = cost
    slow = state - np.array([0, 0, 0, 3.0])
    motion = np.stack([np.stack([slow, slow + np.array([0, 8.0, 0, 0])])] * 5)
    motion[2, 1] = slow + np.array([0, Vehicle.WIDTH + 0.4, 0, 0])
    controls = np.zeros((4, 2))
    assert gap(motion[2, 0], motion[2, 1]) == pytest.approx(0.4)
    steps = ego.shares(motion[:-1], controls)
    after = 0.5 + 0.5 * steps[2:]
    expected = np.concatenate([steps[:2], after]).mean()
    assert ego.of_plans(motion, controls, room=0.8) == pytest.approx(expected)
    assert ego.of_plans(motion, controls, room=0.4) == pytest.approx(steps.mean())
