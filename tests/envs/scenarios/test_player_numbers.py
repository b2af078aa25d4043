"""Numbers of players and true weights, given or drawn."""

from collections import Counter

import numpy as np
import pytest

from olne_bench.envs.scenarios import check_options, get_scenario, is_family
from olne_bench.envs.scenarios.player_numbers import player_number, player_range
from olne_bench.envs.scenarios.true_weights import flat_dirichlet
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.plugins import PluginError


def test_a_number_is_given_as_such_as_a_range_or_drawn_from_all() -> None:
    given = (3, 8, [4, 6], (4, 4), "drawn")
    ranges = [player_range("highway", number, 3, 8) for number in given]
    assert ranges == [(3, 3), (8, 8), (4, 6), (4, 4), (3, 8)]


def test_a_road_holds_so_many_cars() -> None:
    for number, wrong in ((2, 2), (9, 9), ([2, 4], 2), ([4, 9], 9)):
        with pytest.raises(ValueError, match=f"holds 3 to 8 players, got num_players = {wrong}$"):
            player_range("highway", number, 3, 8)
    with pytest.raises(ValueError, match=r"must be \[fewest, most\], got \[5, 4\]"):
        player_range("highway", [5, 4], 3, 8)
    with pytest.raises(ValueError, match=r"num_players must be a whole number, got 3\.5"):
        player_range("highway", 3.5, 3, 8)
    for number in ("many", [3], [3, 4.5], [3, 4, 5], []):
        with pytest.raises(ValueError, match=r"a whole number, 'drawn' or \[fewest, most\], got"):
            player_range("highway", number, 3, 8)


def test_each_number_of_the_range_is_drawn_about_as_often() -> None:
    drawn = Counter(player_number((3, 8), seed) for seed in range(1200))
    assert sorted(drawn) == [3, 4, 5, 6, 7, 8]
    assert min(drawn.values()) > 150
    assert {player_number((4, 4), seed) for seed in range(4)} == {4}


@pytest.mark.parametrize(("name", "most"), [("merge", 6), ("intersection", 4), ("merging", 4)])
def test_roads_refuse_more_than_they_hold(name: str, most: int) -> None:
    message = f"holds . to {most} players, got num_players = {most + 1}"
    with pytest.raises(PluginError, match=message):
        check_options(name, num_players=[3, most + 1])


@pytest.mark.parametrize(("name", "range_"), [("merging", (3, 4)), ("intersection", (2, 4))])
def test_a_drawn_number_is_that_of_the_game(name: str, range_: tuple[int, int]) -> None:
    seeds = (2, 4) if name == "merging" else (3,)
    counts = [player_number(range_, seed) for seed in seeds]
    drawn = [get_scenario(name, seed, num_players="drawn") for seed in seeds]
    assert [one.game.num_players for one in drawn] == counts
    same = get_scenario(name, seeds[0], num_players=counts[0])
    assert (same.initial_state == drawn[0].initial_state).all()


def test_constraints_hold_for_all_pairs_of_a_drawn_number() -> None:
    family = check_options("intersection", num_players="drawn", distance=6.0)
    for seed in (0, 1, 2, 3):
        count = family.count(seed)
        game = family.constrained(np.random.default_rng(seed), count).game
        assert len(game.constraints) == count * (count - 1) // 2


def test_the_flat_dirichlet_is_uniform_on_the_simplex() -> None:
    rows = np.concatenate([flat_dirichlet(seed, 5, 4) for seed in range(400)])
    np.testing.assert_allclose(rows.sum(axis=1), 1)
    # Each weight has a beta distribution: P(w > x) = (1 - x)^3.
    for x in (0.02, 0.25, 0.7):
        assert np.mean(rows > x) == pytest.approx((1 - x) ** 3, abs=0.025)
    assert np.abs(flat_dirichlet(0, 5, 4) - flat_dirichlet(1, 5, 4)).max() > 0.1


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_the_published_scenarios_draw_weights_if_asked(name: str) -> None:
    published = get_scenario(name)
    assert not is_family(name) and is_family(name, weights="dirichlet")
    one, other = (get_scenario(name, seed, weights="dirichlet") for seed in (1, 2))
    assert one.game == published.game
    np.testing.assert_array_equal(one.initial_state, published.initial_state)
    assert np.abs(one.weights - other.weights).max() > 0.1
    assert certified_equilibrium(one).certificate.passed


@pytest.mark.parametrize("name", ["random", "highway", "merge"])
def test_families_draw_wide_or_moderate_weights(name: str) -> None:
    wide = get_scenario(name, 2, weights="dirichlet", num_players=3)
    drawn = flat_dirichlet(2, *wide.weights.shape)
    np.testing.assert_allclose(wide.weights, drawn / drawn.sum(axis=1, keepdims=True))
    moderate = get_scenario(name, 2, num_players=3)
    assert np.abs(moderate.weights - wide.weights).max() > 0.05


@pytest.mark.parametrize("name", ["two_player", "random", "two_way"])
def test_unknown_kinds_are_refused(name: str) -> None:
    with pytest.raises(PluginError, match=r"weights must be one of .*dirichlet.*, got 'flat'"):
        check_options(name, weights="flat")
