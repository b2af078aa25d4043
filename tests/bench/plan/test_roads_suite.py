"""The suite ``roads``, and the draws that come with it."""

from olne_bench.bench.judge import truth
from olne_bench.bench.judge.truth import Draw, held_out_recordings, true_recording
from olne_bench.bench.plan.draws import about, draws_of, draws_path
from olne_bench.bench.plan.load import load_suite
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.roads.road_scenario import MAX_DRAWS
from olne_bench.envs.solved import equilibrium, kept_draws

ROADS = load_suite("roads")


def test_all_roads_are_played_with_known_and_with_unknown_speeds() -> None:
    parts = [[], []]
    for entry in ROADS.scenarios:
        assert entry.family and entry.options["num_players"] == "drawn"
        assert entry.options["weights"] in ("temperaments", "dirichlet")
        parts[entry.options.get("unknown_speeds", False)].append(entry.name)
    assert sorted(parts[0]) == sorted([*ROAD_NAMES, "merging"])
    assert sorted(parts[1]) == sorted(ROAD_NAMES)


def test_the_fast_see_forty_draws_and_the_slow_twenty() -> None:
    for scenario, estimator in ROADS.pairs():
        slow = estimator.name in ("bilevel", "maxent_residual", "particle", "posterior", "ukf")
        assert ROADS.seeds_of(scenario, estimator) >= 1.25 * (20 if slow else 40)


def test_the_draws_that_come_with_it_are_small_and_those_of_the_present_code(monkeypatch) -> None:
    """If this fails after a change of draws: raise the version of ``envs.solved.draws_file``."""
    draws = draws_of("roads", ROADS)
    assert draws is not None and draws.about == about(ROADS)
    assert draws_path("roads").stat().st_size < 2.5e6
    for cached in (truth._recording, truth._nearby, equilibrium._solve):
        cached.cache_clear()
    monkeypatch.setattr(equilibrium, "solve_olne", None)
    for label in ("intersection", "roundabout"):
        draw = Draw.of(ROADS.scenario(label), 1, ROADS.salt)
        with kept_draws.travelling(draws):
            found = [true_recording(draw), *held_out_recordings(draw)]
        assert len(found) == 1 + truth.HELD_OUT and all(one.certificate.passed for one in found)
        assert len(draws.refused) < MAX_DRAWS * len(draws.motions)
