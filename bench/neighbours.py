"""The same players from other starts nearby: for studies of several trajectories, for predictions.

Starts are drawn around a recording's own, and the equilibrium is followed there from the
recording's and certified like any other ground truth.
"""

import zlib
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from envs.recording import NoEquilibriumError, Recording
from games.batch import Batch, solve_batch
from games.continuation import follow_coupling
from games.dynamics import rollout
from games.kkt import consistent_costates
from games.newton import Root, newton_root
from games.olne import RESIDUAL_TOLERANCE, certify

#: Standard deviations of starts: positions relative to the least distance between two players
#: (1 m for a player on its own), speeds relative to the mean one.
POSITION, HEADING, SPEED = 0.05, 0.03, 0.05  # [-], [rad], [-]

#: Draws per start that is wanted, as some have no certified equilibrium nearby.
_DRAWS = 10


def neighbours(recording: Recording, count: int, stream: str, seed: int) -> tuple[Recording, ...]:
    """Certified recordings of the same players from so many other starts.

    Args:
        recording: what happened, from the scenario's own start.
        count: how many others.
        stream: what they are for; another use gets other starts.
        seed: of the draw.

    Raises:
        NoEquilibriumError: where too few starts have a certified equilibrium.
    """
    name = recording.scenario.name
    key = [zlib.crc32(f"{stream} {name}".encode()), seed]
    found = tuple(islice(_certified(recording, _starts(recording, key, _DRAWS * count)), count))
    if len(found) < count:
        raise NoEquilibriumError(
            f"only {len(found)} of {count} starts near that of {name!r} have a certified "
            f"equilibrium, in {_DRAWS * count} draws"
        )
    return found


def _starts(recording: Recording, key: list[int], draws: int) -> Iterator[np.ndarray]:
    """Initial states (N, n) around the recording's."""
    own = recording.scenario.initial_state
    names = recording.scenario.game.dynamics.state_names
    sizes = {"px": POSITION * _least_distance(own), "py": POSITION * _least_distance(own)}
    sizes["heading"] = HEADING
    if "speed" in names:
        sizes["speed"] = SPEED * float(np.abs(own[:, names.index("speed")]).mean())
    deviation = np.array([sizes.get(name, 0.0) for name in names])
    rng = np.random.default_rng(key)
    for _ in range(draws):
        yield own + deviation * rng.standard_normal(own.shape)


def _least_distance(states: np.ndarray) -> float:
    """Least distance between two of the players' positions, (N, n)."""
    gaps = states[:, None, :2] - states[None, :, :2]
    distances = np.linalg.norm(gaps, axis=-1)[~np.eye(len(states), dtype=bool)]
    return float(distances.min(initial=np.inf)) if distances.size else 1.0


def _certified(recording: Recording, starts: Iterator[np.ndarray]) -> Iterator[Recording]:
    scenario = recording.scenario
    game, weights = scenario.game, scenario.weights
    known = _root(recording)
    coast = np.zeros((1, *game.control_shape[1:]))
    for start in starts:
        batch = solve_batch(game, weights[None], known, weights, initial_states=start)
        root = _first(batch)
        certificate = certify(game, root, weights)
        if certificate.passed:
            yield Recording(
                scenario=replace(scenario, initial_state=start),
                states=root.states,
                controls=root.controls,
                costates=root.costates,
                extra_state=rollout(game.dynamics, root.states[-1], coast, game.dt)[-1],
                certificate=certificate,
            )


def follow_root(recording: Recording, weights: np.ndarray, limit: float) -> Root | None:
    """The game's root at other weights, from the recording's initial state.

    Followed from the recording; where that is lost, Newton's method from the recording's motion
    and continuation in the coupling between players. Far cheaper than the search for the root
    nearest the truth (``games.nearest_root``), which scores the recording itself.

    Args:
        recording: what happened at the true weights.
        weights: (N, K).
        limit: wall-clock seconds for each of the three.

    Returns:
        None where none of them finds a root.
    """
    game, known = recording.scenario.game, _root(recording)
    batch = solve_batch(game, weights[None], known, recording.scenario.weights, limit=limit)
    if batch.converged[0]:
        return _first(batch)
    costates = consistent_costates(game, known.states, known.controls, weights)
    if np.isfinite(costates).all():
        root = newton_root(game, known.states, known.controls, costates, weights, limit=limit)
        if root.residual < RESIDUAL_TOLERANCE:
            return root
    followed = follow_coupling(game, weights, known.states[0], known.controls, limit=limit)
    good = followed is not None and followed.residual < RESIDUAL_TOLERANCE
    return followed if good else None


def _root(recording: Recording) -> Root:
    return Root(recording.states, recording.controls, recording.costates, residual=0.0)


def _first(batch: Batch) -> Root:
    return Root(batch.states[0], batch.controls[0], batch.costates[0], float(batch.residuals[0]))
