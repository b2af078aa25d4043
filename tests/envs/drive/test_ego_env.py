"""The ego of a drive as an environment of Gymnasium, and what its driver sees."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import olne_bench.envs  # noqa: F401  registers the ids
from olne_bench.envs.drive.ego_env import SIZE, EgoEnv, EgoView
from olne_bench.envs.drive.setting import STOCK, DriveSetting
from olne_bench.envs.drive.world import DriveWorld


def driven(world: EgoEnv, seed: int, action: np.ndarray, steps: int) -> list:
    seen, _ = world.reset(seed=seed)
    found = [seen]
    for _ in range(steps):
        seen, reward, terminated, truncated, _ = world.step(action)
        found.append((seen, reward, terminated, truncated))
        if terminated or truncated:
            break
    return found


def test_it_passes_gymnasiums_checks() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(EgoEnv("highway", STOCK), skip_render_check=True)


def test_it_has_an_id() -> None:
    world = gymnasium.make("olne/Drive-v0", road="merge", traffic=STOCK)
    seen, _ = world.reset(seed=1)
    assert seen.shape == (SIZE,)
    world.close()


def test_the_same_seed_and_actions_make_the_same_drive() -> None:
    first, again, other = (driven(EgoEnv(), seed, np.array([0.1, -0.3]), 6) for seed in (3, 3, 4))
    np.testing.assert_equal(first, again)
    assert not np.array_equal(first[0], other[0])


def test_a_step_costs_one_at_most_and_a_collision_the_steps_that_are_left() -> None:
    world = EgoEnv("highway", STOCK)
    steps = driven(world, 0, np.array([1.0, 1.0]), 100)[1:]  # off the road, as fast as it can
    *before, (_, last, terminated, truncated) = steps
    assert all(-1 <= reward <= 0 for _, reward, _, _ in before)
    assert terminated or truncated
    if terminated:
        assert last <= -(100 - len(steps))


def test_without_an_action_the_ego_follows_its_route() -> None:
    """Round a corner and a roundabout, too; on the highway it changes to its lane first."""
    for road in ("highway", "intersection", "roundabout"):
        world = DriveWorld(DriveSetting(road, STOCK), 10_000_000)
        view, away = EgoView(world.cars[0]), []
        while not world.over and world.step < 60:
            state = world.states()[0]
            away.append(np.linalg.norm(view._route - state[:2], axis=1).min())
            world.advance(view.control(state, np.zeros(2)))
        assert max(away[20:]) < 4.0 and away[-1] < 1.0  # [m]: at an entry it cuts the corner


def test_the_view_turns_with_the_ego() -> None:
    """Positions and velocities of others are told in the frame of the ego."""
    world = DriveWorld(DriveSetting("highway", STOCK), 10_000_001)
    view = EgoView(world.cars[0])
    ahead = np.array([[50.0, 4.0, 0.0, 20.0], [60.0, 8.0, 0.0, 25.0]])
    first = view.of(ahead)[-4 * 7 :][:7]
    np.testing.assert_allclose(first, [1, 0.5, 0.2, 0.5, 0, 1, 0], atol=1e-6)
    turned = np.array([[50.0, 4.0, np.pi / 2, 20.0], [46.0, 14.0, np.pi / 2, 25.0]])
    np.testing.assert_allclose(view.of(turned)[-4 * 7 :][:7], first, atol=1e-6)
    assert (view.of(ahead[:1])[-4 * 7 :] == 0).all()


@pytest.mark.parametrize("what", [{"road": "sea"}, {"traffic": "none"}])
def test_what_is_unknown_is_refused(what: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"unknown (road|traffic) .* known are: "):
        EgoEnv(**what)
