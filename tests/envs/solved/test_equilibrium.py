"""True motions are certified locally and globally so far, or refused."""

from collections.abc import Iterator

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved import equilibrium
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.solve import olne


@pytest.fixture
def trap() -> Iterator[Scenario]:
    """A draw at whose first equilibrium one player has a much better plan far away."""
    equilibrium._solve.cache_clear()
    yield get_scenario("random", 5, num_players=3)
    equilibrium._solve.cache_clear()


def test_a_truth_passes_both_searches(trap: Scenario) -> None:
    first = olne.solve_olne(trap.game, trap.weights, trap.initial_state)
    truth = certified_equilibrium(trap)
    assert first.certificate.passed and truth.certificate.passed
    assert truth.certificate.global_so_far is not None
    assert truth.certificate.global_so_far.passed
    assert np.abs(truth.states - first.states).max() > 0.1
    assert not truth.states.flags.writeable


def test_a_draw_whose_players_have_better_plans_is_refused(
    trap: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(olne, "_MOST_EQUILIBRIA", 1)
    with pytest.raises(NoEquilibriumError) as caught:
        certified_equilibrium(trap)
    told = str(caught.value)
    assert "no certified equilibrium of 'random': residual" in told
    assert "local: passed" in told
    assert "global so far: failed, 75 first plans, largest gain 2.5e-02 of player 0" in told
