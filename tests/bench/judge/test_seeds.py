"""Seeds of streams."""

import pytest

from olne_bench.bench.judge.seeds import drawn_as, noise_seed, stream
from olne_bench.bench.judge.truth import Draw
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.scenarios.changed import Changed


def test_seeds_repeat_and_fit_into_63_bits() -> None:
    seeds = [stream("sea", "noise", "two_player", 0.1, k) for k in range(200)]
    assert seeds == [stream("sea", "noise", "two_player", 0.1, k) for k in range(200)]
    assert min(seeds) >= 0
    assert 2**62 < max(seeds) < 2**63
    assert {seed & 1 for seed in seeds} == {0, 1}


def test_whatever_else_is_asked_for_has_another_seed() -> None:
    asked = [
        ("sea", "noise", 1),
        ("rock", "noise", 1),
        ("sea", "draw", 1),
        ("sea", "noise", 2),
        ("sea", "noise", "1"),
        ("sea", "noise", 1, 1),
        ("sea", "noise", 1.5),
        ("sea", "noise1"),
    ]
    assert len({stream(*parts) for parts in asked}) == len(asked)


@pytest.mark.parametrize("dial", [0.0, 0.5])
def test_a_changed_scenario_has_the_draws_and_the_noise_of_the_scenario_itself(dial: float) -> None:
    options = {"num_players": 2}
    changed = {"of": "random", "change": "alone", "dial": dial, "options": options}
    one = ScenarioEntry(name=Changed.name, options=changed, family=True)
    own = ScenarioEntry(name="random", options=options, family=True)
    assert Draw.of(one, 3, "sea").seed == Draw.of(own, 3, "sea").seed
    assert noise_seed(one, 0.1, 3, "sea") == noise_seed(own, 0.1, 3, "sea")
    usual = ScenarioEntry(name=Changed.name, family=True)
    assert drawn_as(usual) == (Changed().of, "{}")
