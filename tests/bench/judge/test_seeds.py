"""Seeds of streams."""

from olne_bench.bench.judge.seeds import stream


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
