"""The fast game of cars along references finds local Nash equilibria."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve import reference_game as module
from olne_bench.games.solve.reference_game import (
    FAR_AWAY,
    WEIGHT_NAMES,
    Plan,
    ReferenceGame,
    Situation,
    Units,
    _Games,
)

STEPS = 6


def solve(game: ReferenceGame, one: Situation, start: np.ndarray, **options: object) -> Plan:
    return game.solve_all([one], [start], **options)[0]  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def game() -> ReferenceGame:
    return ReferenceGame(steps=STEPS, dt=0.4, max_players=3, num_others=1)


def situation(count: int) -> Situation:
    initial = np.array([[0, 0, 0, 25.0], [18, 4, 0, 20], [-16, 4, 0, 24]])[:count]
    lanes, speeds = np.array([4.0, 4.0, 0.0])[:count], np.array([25.0, 20.0, 26.0])[:count]
    references = np.zeros((count, STEPS, 4))
    references[..., 1], references[..., 3] = lanes[:, None], speeds[:, None]
    others = np.full((count, 1, STEPS, 2), FAR_AWAY)
    return Situation(initial, np.full((count, 5), 1.0), references, others)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_solution_is_stationary_and_convex(game, count):
    plan = solve(game, situation(count), np.zeros((STEPS, count, 2)), tolerance=1e-9)
    assert plan.converged and plan.residual < 1e-9
    played = rollout(game.dynamics, plan.states[0], plan.controls, game.dt)
    np.testing.assert_allclose(plan.states, played, atol=1e-12)


def test_newton_matrix_is_the_derivative_of_the_gradients(game):
    """Central differences, away from the solution, other players' influence included."""
    here = _Games.of([situation(3)], game.max_players)
    rng = np.random.default_rng(0)
    unknowns = 0.01 * rng.standard_normal((3, STEPS, 2))
    direction = rng.standard_normal(unknowns.shape)
    ahead, behind = (
        game.evaluate(here, unknowns + step * direction).gradients for step in (1e-6, -1e-6)
    )
    change = (ahead - behind) / 2e-6
    at = game.evaluate(here, unknowns)
    assert np.linalg.eigvalsh(at.own_hessians).min() > 0  # else the matrix is regularised
    np.testing.assert_allclose(
        game.newton_step(here, replace(at, gradients=change)), -direction, rtol=1e-4, atol=1e-5
    )


def test_no_player_gains_by_a_small_deviation(game):
    """Costs by quadrature of gradients along the deviation: no private cost function needed."""
    here = situation(3)
    plan = solve(game, here, np.zeros((STEPS, 3, 2)), tolerance=1e-10)
    rng = np.random.default_rng(1)
    games = _Games.of([here], game.max_players)
    for player in range(3):
        offset = np.zeros((3, STEPS, 2))
        offset[player] = 1e-3 * rng.standard_normal((STEPS, 2))
        nodes, weights = np.polynomial.legendre.leggauss(5)
        start = plan.controls.swapaxes(0, 1)
        change = (
            sum(
                w / 2 * game.evaluate(games, start + (x + 1) / 2 * offset).gradients[player]
                for x, w in zip(nodes, weights, strict=True)
            )
            @ offset[player].ravel()
        )
        assert change > 0


def test_predicted_others_are_avoided(game):
    free = situation(1)
    start = np.zeros((STEPS, 1, 2))
    straight = solve(game, free, start).states[:, 0]
    beside = straight[1:, :2] + [0.0, 2.5]  # a car that drives alongside on the right
    aside = solve(game, replace(free, others=beside[None, None]), start).states[:, 0]
    assert aside[-1, 1] < straight[-1, 1] - 0.1


def test_unsolvable_situations_are_reported(game):
    broken = replace(situation(2), initial_state=np.full((2, 4), np.nan))
    assert not solve(game, broken, np.zeros((STEPS, 2, 2))).converged


def turned(here: Situation, angle: float, shift: np.ndarray) -> Situation:
    """The same situation, shifted and rotated."""
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    def moved(rows: np.ndarray) -> np.ndarray:
        rows = rows.copy()
        rows[..., :2] = rows[..., :2] @ rotation + shift
        if rows.shape[-1] > 2:
            rows[..., 2] += angle
        return rows

    initial, references, others = map(moved, (here.initial_state, here.references, here.others))
    return replace(here, initial_state=initial, references=references, others=others)


@pytest.mark.parametrize("angle", [0.9, -2.0])
def test_it_does_not_matter_where_the_road_lies_and_leads(game, angle):
    here = replace(situation(3), others=np.full((3, 1, STEPS, 2), [40.0, 2.0]))
    start = np.zeros((STEPS, 3, 2))
    plan = solve(game, here, start, tolerance=1e-9)
    there = solve(game, turned(here, angle, np.array([300.0, -20.0])), start, tolerance=1e-9)
    assert plan.converged and there.converged
    np.testing.assert_allclose(there.controls, plan.controls, atol=1e-7)


def step_cost(game: ReferenceGame, state, control=(0.0, 0.0), other=(1e3, 1e3)) -> np.ndarray:
    """The five terms of one step, each by a weight of its own; the reference leads along 0.3."""
    reference = ca.SX(ca.DM([10.0, 5.0, 0.3, 20.0]))
    row, played, near = (ca.SX(ca.DM(values)) for values in (state, control, other))
    units = np.eye(len(WEIGHT_NAMES))
    terms = [
        module._step_cost(game, row, played, [near], reference, ca.SX(ca.DM(one))) for one in units
    ]
    return np.array([float(ca.evalf(term)) for term in terms])


def at(beside: float = 0.0, off: float = 0.0, speed: float = 20.0) -> tuple[float, ...]:
    """A state two metres ahead of the reference, with given offsets beside it and in heading."""
    cos, sin = np.cos(0.3), np.sin(0.3)
    return 10 + 2 * cos - beside * sin, 5 + 2 * sin + beside * cos, 0.3 + off, speed


def test_a_unit_of_each_preference_costs_one(game):
    units = Units()
    _, *others = step_cost(game, at())
    assert others == pytest.approx([0, 0, 0, 0], abs=1e-9)
    for sign in (-1, 1):
        assert step_cost(game, at(speed=20 + sign * units.speed))[1] == pytest.approx(1)
        acceleration = step_cost(game, at(), (0.0, sign * units.acceleration))
        assert acceleration[2] == pytest.approx(1)
        assert step_cost(game, at(beside=sign * units.lane))[4] == pytest.approx(1)
        assert step_cost(game, at(off=sign * units.heading))[4] == pytest.approx(1, rel=0.01)
        # Across: speed times yaw rate, and the steering angle by itself.
        steering = sign * 0.02
        yaw_rate = 20 * np.sin(np.arctan(np.tan(steering) / 2)) / game.rear_axle
        effort = (20 * yaw_rate / units.turning) ** 2 + (steering / units.steering) ** 2
        assert step_cost(game, at(), (steering, 0.0))[3] == pytest.approx(effort)
        at_rest = step_cost(game, at(speed=0.0), (sign * units.steering, 0.0))
        assert at_rest[3] == pytest.approx(1)
    x, y, heading, _ = at()
    along = np.array([np.cos(heading), np.sin(heading)])
    ahead = np.array([x, y]) + units.length * along
    aside = np.array([x, y]) + units.width * np.array([-along[1], along[0]])
    assert step_cost(game, at(), other=ahead)[0] == pytest.approx(-np.log(1.1))
    assert step_cost(game, at(), other=aside)[0] == pytest.approx(-np.log(1.1))


def test_steps_of_the_search_are_limited(game):
    here, start = situation(2), np.zeros((STEPS, 2, 2))
    hasty = replace(here, references=here.references + np.array([0, 3.0, 0, 30.0]))
    for limit in ((0.02, 0.3), (0.2, 3.0)):
        once = solve(game, hasty, start, max_iterations=1, max_change=limit)
        assert once.iterations == 1 and not once.converged
        assert (np.abs(once.controls) / limit).max() <= 1 + 1e-12
    assert solve(game, hasty, start, max_iterations=0).iterations == 0
    done = solve(game, here, start)
    assert done.residual < 1e-4
    again = solve(game, here, done.controls)
    assert again.iterations == 0
    np.testing.assert_array_equal(again.controls, done.controls)


def test_games_at_once_are_those_one_by_one(game):
    """Games of all sizes, one of which cannot be solved: no game affects another."""
    broken = replace(situation(2), initial_state=np.full((2, 4), np.nan))
    here = [situation(3), situation(1), broken, situation(2), situation(3)]
    starts = [np.zeros((STEPS, len(one.weights), 2)) for one in here]
    starts[4] += 0.01
    together = game.solve_all(here, starts, tolerance=1e-9)
    assert [plan.converged for plan in together] == [True, True, False, True, True]
    for plan, one, start in zip(together, here, starts, strict=True):
        alone = solve(game, one, start, tolerance=1e-9)
        assert plan.iterations == alone.iterations
        np.testing.assert_allclose(plan.controls, alone.controls, atol=1e-10)


def test_gradients_and_own_hessians_are_derivatives_of_the_cost(game):
    """Against CasADi's own derivatives of the cost, written down as one expression."""
    here = situation(2)
    rng = np.random.default_rng(3)
    start = 0.05 * rng.standard_normal((2, STEPS, 2))
    games = _Games.of([here], game.max_players)
    at = game.evaluate(games, start)
    u = ca.SX.sym("u", 2 * STEPS)
    state, cost = ca.SX(here.initial_state[0]), 0.0
    far = ca.SX([FAR_AWAY, FAR_AWAY])
    for t, control in enumerate(ca.vertsplit(u, 2)):
        state = game.dynamics.step(state, control, game.dt)
        near = [ca.SX(at.states[1, t, :2]), far, far]
        reference, weights = ca.SX(here.references[0, t]), ca.SX(here.weights[0])
        cost += module._step_cost(game, state, control, near, reference, weights)
    hessian, gradient = ca.hessian(cost, u)
    values = ca.Function("f", [u], [gradient, hessian])(start[0].ravel())
    np.testing.assert_allclose(at.gradients[0], values[0].full()[:, 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(at.own_hessians[0], values[1].full(), rtol=1e-9, atol=1e-9)


def test_the_last_step_may_be_a_small_one(game):
    """What it leaves is far smaller than itself."""
    start = np.full((STEPS, 3, 2), 0.003)
    exact = solve(game, situation(3), start, tolerance=1e-9)
    early = solve(game, situation(3), start, tolerance=1e-9, small_change=(2e-3, 0.1))
    assert early.converged and early.iterations < exact.iterations
    np.testing.assert_allclose(early.controls[..., 0], exact.controls[..., 0], atol=2e-4)
    np.testing.assert_allclose(early.controls[..., 1], exact.controls[..., 1], atol=1e-2)
    played = rollout(game.dynamics, early.states[0], early.controls, game.dt)
    np.testing.assert_allclose(early.states, played, atol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5])
def test_a_lone_car_goes_straight_on_however_many_may_play_and_wherever_the_road_leads(turn):
    cos, sin = np.cos(turn), np.sin(turn)
    references = np.zeros((1, STEPS, 4))
    references[..., 2:] = turn, 25.0
    for players, others in ((2, 1), (5, 3)):
        game = ReferenceGame(steps=STEPS, dt=0.4, max_players=players, num_others=others)
        alone = Situation(
            initial_state=np.array([[0, 0, turn, 25.0]]),
            weights=np.array([[2.5, 1, 0.5, 0.5, 1.0]]),
            references=references,
            others=np.full((1, others, STEPS, 2), FAR_AWAY),
        )
        plan = solve(game, alone, np.zeros((STEPS, 1, 2)), tolerance=1e-9, max_iterations=40)
        expected = 25.0 * 0.4 * STEPS * np.array([cos, sin])
        np.testing.assert_allclose(plan.states[-1, 0, :2], expected, atol=1e-6)
