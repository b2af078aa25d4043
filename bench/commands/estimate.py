"""``olne-bench estimate``: run an estimator on a recording whose truth nobody needs to know."""

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pandas as pd

from olne_bench.bench.commands.options import BUDGET, PATH
from olne_bench.bench.judge.estimate_check import (
    CheckedEstimate,
    check_estimate,
)
from olne_bench.bench.judge.observe import sensor_model
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.bench.judge.referee import PlayerFault, PlayerTask
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.envs.recording import NoEquilibriumError
from olne_bench.envs.recording_file import RecordingFile, RecordingFileError, read_recording
from olne_bench.envs.scenarios import Scenario, get_scenario, scenario_options
from olne_bench.errors import UserError
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.files import check_new_file, whole_file
from olne_bench.games.features import Feature, FinalGoal
from olne_bench.games.game import Game, Player
from olne_bench.games.observation import ComponentView, FullView, View
from olne_bench.plugins import ESTIMATOR, is_built_in


@click.command()
@click.argument("recording", type=PATH)
@click.option("--scenario", required=True, help="Scenario whose cost features the players have.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Its draw, if a family.",
)
@click.option(
    "--estimator", default="kkt_constrained", show_default=True, help="Name, or FILE.py[:CLASS]."
)
@click.option(
    "--episode", type=click.IntRange(min=0), default=0, show_default=True, help="Which to look at."
)
@click.option(
    "--budget",
    type=BUDGET,
    default=60.0,
    show_default=True,
    help="Seconds that the estimator is told it has.",
)
@click.option("--out", type=PATH, help="CSV file of the weights, a new one.")
def estimate(
    recording: Path,
    scenario: str,
    seed: int,
    estimator: str,
    episode: int,
    budget: float,
    out: Path | None,
) -> None:
    """Estimate the weights of every player in RECORDING.

    Motion model, cost features, target speeds, lanes and noise scales are those of the scenario;
    horizon, step and number of players those of the recording. A player with a goal has it where
    it was last seen. Players stop a little short of their goals, and the weights bear the
    difference.
    """
    if out is not None:
        check_new_file("--out", out, (".csv",))
    known = _read(recording, episode)
    states = known.states[episode]
    explained = _scenario(scenario, seed, states, known.metadata.dt)
    game = explained.game
    view, y = _observation(game, known.metadata.state_names, states)
    scale = sensor_model(explained, (view,)).noise_scale
    result = _estimate(estimator, Problem(game, view, noise_scale=scale), Observation(y), budget)

    players = known.metadata.episodes[episode].players
    table = pd.DataFrame(result.weights, columns=list(game.weight_names))
    table.insert(0, "player", players)
    click.echo(table.to_string(index=False, float_format=lambda value: f"{value:.4f}"))
    if out is not None:
        _write(table, out)
    if not result.converged:
        reason = result.message or "the estimator gives no reason"
        click.echo(f"not converged, do not rely on these weights: {reason}", err=True)


def _write(table: pd.DataFrame, out: Path) -> None:
    try:
        with whole_file(out) as path:
            table.to_csv(path, index=False)
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written: {error.strerror or error}") from error


def _read(path: Path, episode: int) -> RecordingFile:
    try:
        known = read_recording(path)
    except RecordingFileError as error:
        raise UserError(str(error)) from error
    if episode >= len(known.states):
        raise UserError(
            f"--episode {episode}: {path} has the episodes 0 to {len(known.states) - 1}"
        )
    return known


def _scenario(name: str, seed: int, states: np.ndarray, dt: float) -> Scenario:
    """The scenario with the horizon, step, number of players and goals of the states."""
    steps, count, _ = states.shape
    try:
        sized = {"num_players": count} if "num_players" in scenario_options(name) else {}
        scenario = get_scenario(name, seed, **sized)
    except (ValueError, NoEquilibriumError) as error:
        raise UserError(f"--scenario: {error}") from error
    game = scenario.game
    if game.num_players != count:
        raise UserError(
            f"--scenario {name!r} has {game.num_players} players, the recording has {count}"
        )
    players = tuple(
        _with_goal(player, _last_seen(states[:, i, :2])) for i, player in enumerate(game.players)
    )
    return replace(scenario, game=replace(game, players=players, horizon=steps, dt=dt))


def _with_goal(player: Player, position: np.ndarray) -> Player:
    """The player with its goal, where it has one, moved to a position (2,)."""

    def moved(feature: Feature) -> Feature:
        if not isinstance(feature, FinalGoal):
            return feature
        return replace(feature, goal=(float(position[0]), float(position[1])))

    return Player(
        preferences=tuple(moved(feature) for feature in player.preferences),
        task=tuple(moved(feature) for feature in player.task),
    )


def _last_seen(positions: np.ndarray) -> np.ndarray:
    """The last position (2,) without a gap among (T, 2)."""
    seen = np.isfinite(positions).all(axis=1)
    return np.asarray(positions[seen][-1])


def _observation(game: Game, names: list[str], states: np.ndarray) -> tuple[View, np.ndarray]:
    """The view of those components of which anything is known, and what it shows (T, N, d)."""
    known = [k for k in range(len(names)) if np.isfinite(states[..., k]).any()]
    components = tuple(names[k] for k in known)
    absent = [name for name in components if name not in game.dynamics.state_names]
    if absent:
        raise UserError(
            f"the scenario's states have no {', '.join(absent)}; "
            f"they have: {', '.join(game.dynamics.state_names)}"
        )
    if components == game.dynamics.state_names:
        return FullView(), states
    return ComponentView("recorded", components), states[..., known]


def _estimate(
    reference: str, problem: Problem, observation: Observation, budget: float
) -> CheckedEstimate:
    (found,) = describe_all([(ESTIMATOR, reference, {})])
    if found.error:
        raise UserError(found.error)
    player = PlayerProcess(memory=None, hidden=None)
    task = PlayerTask(
        reference=found.reference,
        parameters={},
        plugin="" if is_built_in(ESTIMATOR, reference) else reference,
        homes=(),
        problem=problem,
        observations=(observation,),
        seed=0,
        time_limit=budget,
    )
    try:
        answer = player.estimate(task)
        if answer.estimate is None:
            raise UserError(
                f"estimator {reference!r} does not take this recording: {answer.declined}"
            )
        return check_estimate(answer.estimate, problem)
    except (PlayerFault, InvalidEstimateError) as error:
        raise UserError(f"estimator {reference!r}: {error}") from error
    finally:
        player.stop()
