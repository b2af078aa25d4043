"""The same players from nearby starts, for studies of several trajectories and for predictions.

Equilibria are followed from the recording's own start, and certified like any other ground truth.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording, recorded
from olne_bench.envs.solved import kept_draws
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import Certificate, certify
from olne_bench.games.solve.root_following import follow_root

#: Standard deviations of starts: positions relative to the least distance between two players
#: (1 m for a single player), speeds relative to their mean.
POSITION, HEADING, SPEED = 0.05, 0.03, 0.05  # [-], [rad], [-]

#: Draws per wanted start, as some draws have no certified equilibrium.
_DRAWS = 10


def neighbours(recording: Recording, count: int, stream: str, seed: int) -> tuple[Recording, ...]:
    """Certified recordings of the same players from so many other starts.

    Each purpose ``stream`` gets starts of its own. Raises ``NoEquilibriumError`` if too few starts
    have a certified equilibrium.
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
    game, weights = recording.scenario.game, recording.scenario.weights
    known = recording.root
    for start in starts:
        if kept_draws.was_refused(game, weights, start):
            continue
        solved = kept_draws.travelled(game, weights, start)
        if solved is not None:
            root = Root(solved.states, solved.controls, solved.costates, solved.residual)
            yield _played(recording, root, solved.certificate)
            continue
        root = solve_batch(game, weights[None], known, weights, initial_states=start).root(0)
        certificate = certify(game, root, weights, search_far=True)
        if certificate.passed:
            yield _played(recording, root, certificate)
        else:
            kept_draws.refuse(game, weights, start)


def _played(recording: Recording, root: Root, certificate: Certificate) -> Recording:
    """The recording of the same players from another start."""
    scenario = replace(recording.scenario, initial_state=root.states[0])
    return recorded(scenario, root, certificate)


def follow_start(recordings: Sequence[Recording], weights: np.ndarray, known: Root) -> list[Root]:
    """Roots of the game at other weights, from the recordings' initial states.

    Each is followed from ``known``, a root at those weights, while the initial state moves, or else
    from the recording's own motion (``games.solve.root_following``).

    Args:
        recordings: the motions at the true weights, all of one game.
        weights: (N, K), or (N, K + U) with the standardised unknowns of the scenario's ``told``.
        known: a root at the weights, from another initial state.

    Returns:
        The roots, up to the first recording for which none is found.
    """
    starts = np.stack([one.scenario.initial_state for one in recordings])
    game, repeated = recordings[0].scenario.told, np.repeat(weights[None], len(recordings), axis=0)
    try:
        batch = solve_batch(game, repeated, known, weights, initial_states=starts)
        followed = [batch.root(k) if batch.converged[k] else None for k in range(len(starts))]
    except ValueError:  # singular at the known root
        followed = [None] * len(recordings)
    roots: list[Root] = []
    for one, root in zip(recordings, followed, strict=True):
        found = root or follow_root(game, one.root, one.scenario.theta, weights)
        if found is None:
            break
        roots.append(found)
    return roots
