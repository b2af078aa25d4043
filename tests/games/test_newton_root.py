import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.games.model.game import Game
from olne_bench.games.solve.newton import newton_root
from olne_bench.games.solve.olne import Equilibrium

Crossing = tuple[Game, np.ndarray, np.ndarray]


@given(st.integers(0, 2**32))
def test_returns_to_a_root_from_nearby(
    crossing: Crossing, crossing_equilibrium: Equilibrium, seed: int
) -> None:
    game, weights, _ = crossing
    found, rng = crossing_equilibrium, np.random.default_rng(seed)

    def nearby(values: np.ndarray) -> np.ndarray:
        return values + 1e-4 * rng.standard_normal(values.shape)

    states = np.concatenate([found.states[:1], nearby(found.states[1:])])
    root = newton_root(game, states, nearby(found.controls), nearby(found.costates), weights)
    assert root.residual < 1e-12
    np.testing.assert_allclose(root.states, found.states, atol=1e-9)
    np.testing.assert_allclose(root.controls, found.controls, atol=1e-9)
    np.testing.assert_allclose(root.costates, found.costates, atol=1e-9)


def test_never_ends_worse_than_it_began(
    crossing: Crossing, crossing_equilibrium: Equilibrium
) -> None:
    game, weights, _ = crossing
    found = crossing_equilibrium
    start = (found.states, found.controls + 0.5, found.costates)
    begun = newton_root(game, *start, weights, max_iterations=0).residual
    residuals = [
        newton_root(game, *start, weights, max_iterations=count).residual for count in (1, 3, 50)
    ]
    assert begun > 1e-3
    assert min(residuals) < begun
    assert residuals[-1] < 1e-12


def test_undefined_start_is_reported_by_its_residual(
    crossing: Crossing, crossing_equilibrium: Equilibrium
) -> None:
    game, weights, _ = crossing
    found = crossing_equilibrium
    root = newton_root(
        game, found.states, np.full_like(found.controls, np.nan), found.costates, weights
    )
    assert not root.residual < 1e-9
