"""``olne-bench estimate``: run an estimator on a recording, whose true weights may be unknown."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread

import click
import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.commands.recordings import read_episode
from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.fit import Fit
from olne_bench.bench.judge.observe import sensor_model
from olne_bench.bench.judge.players import PlayerFault, PlayerTask
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.bench.text import one_line
from olne_bench.envs.tracks.checks import FEWEST_STEPS
from olne_bench.envs.tracks.explained import DATA, Assumption, Explained, explain
from olne_bench.errors import UserError
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.sample_series import with_unseen
from olne_bench.files import check_new_file
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import ComponentView, FullView, View
from olne_bench.plugins import ESTIMATOR, SCENARIO, is_built_in, loading, named_by_data

#: Least noise level of positions [m]: smaller deviations are rounding.
LEAST_NOISE = 1e-6
FREE = "estimated"  # of --targets: guesses are
TOLD = "--noise"  # source of a noise level that the user gave
NOISE_SPREAD = 1.5  # of log sigma around the roughness of tracks, which smoothing takes away
MOST_STEPS = 400  # longer games are not solved within minutes
SET_UP = 600.0  # [s] in which an estimator is compiled, apart from its budget
REHEARSAL = 1e-3  # [s], budget of an estimate that is made to have all compiled
#: Shares of the budget: after the first an estimator is stopped, the second is left for intervals.
OVERTIME, LEAST = 1.25, 0.2
UNKNOWN = "; --targets fixed takes guesses for the truth"
HINT = "; give a longer --budget, or import fewer --players, a shorter --window or --resample"


def estimate(
    recording: Path,
    scenario: str | None,
    seed: int | None,
    estimator: str,
    episode: int,
    noise: float | None,
    ahead: float,
    targets: str,
    budget: float,
    out: Path | None,
) -> None:
    """Estimate the weights of every player in RECORDING."""
    if out is not None:
        check_new_file("--out", out, (".csv",))
    known = read_episode(recording, episode)
    states, players = known.states[episode], known.metadata.episodes[episode].players
    _check_seen(recording, states, players)
    _check_length(recording, len(states), known.metadata.dt, ahead)
    name = scenario or _named(recording, known.metadata.scenario)
    with loading(name):
        explained = explain(name, seed, known, episode, noise, targets == FREE, ahead)
    problem, y = recorded_problem(explained, known.metadata.state_names, states, noise)
    _say_assumptions(name, known.metadata.dt, explained.assumptions)
    click.echo(f"plans end {f'{ahead:g} s after' if ahead else 'with'} the recording (--ahead)")
    for warning in explained.warnings:
        click.echo(f"warning: {one_line(warning)}", err=True)

    result, seconds = _estimate(estimator, problem, Observation(y), budget)
    fit = Fit(problem, y, result)
    table = _table(players, problem.weight_names, fit)
    _add_targets(table, fit)
    found = "estimated" if "sigma" in result.extras else "from the roughness of the tracks"
    _say_result(table, players, fit, TOLD if noise else found)
    try:
        _find_intervals(table, fit, max(budget - seconds, LEAST * budget))
    finally:  # an interrupt leaves the weights
        if out is not None:
            write_csv(table, out, new=True)


def recorded_problem(
    explained: Explained, names: list[str], states: np.ndarray, noise: float | None
) -> tuple[Problem, np.ndarray]:
    """The problem that states (T, N, n) with these names pose, and samples (T, N, d).

    Samples are missing where the game ends later. Without a noise level [m], the roughness of the
    tracks is a guess of it.
    """
    game = explained.scenario.game
    view, seen = _observation(game, names, states)
    level = noise or max(LEAST_NOISE, float(np.nan_to_num(explained.noise)))
    scale = sensor_model(explained.scenario, (view,)).noise_scale
    spread = 0.0 if noise else NOISE_SPREAD
    y = with_unseen(seen, game.horizon)
    return Problem(game, view, sigma=level, noise_scale=scale, sigma_spread=spread), y


def _named(path: Path, scenario: str | None) -> str:
    """The scenario that a recording names; it never names code to be run."""
    if scenario is None:
        raise UserError(f"{path} names no scenario; give one with --scenario")
    return named_by_data(SCENARIO, scenario, str(path), "--scenario")


def _check_seen(path: Path, states: np.ndarray, players: list[str]) -> None:
    """Refuse players that are hardly seen in states (T, N, n)."""
    seen = np.isfinite(states[..., :2]).all(axis=-1).sum(axis=0)
    for player, count in zip(players, seen, strict=True):
        if count < FEWEST_STEPS:
            raise UserError(
                f"{path}: player {player!r} has a position at {count} times, expected at least "
                f"{FEWEST_STEPS}"
            )


def _check_length(path: Path, steps: int, dt: float, ahead: float = 0.0) -> None:
    if steps > MOST_STEPS:
        raise UserError(
            f"{path} has {steps} steps of {dt:g} s, a game at most {MOST_STEPS}; import it again "
            f"with --resample {max(0.1, 2 * dt):g} or a shorter --window"
        )
    if steps + round(ahead / dt) > MOST_STEPS:
        raise UserError(
            f"--ahead {ahead:g}: {path} has {steps} steps of {dt:g} s, a game at most "
            f"{MOST_STEPS}; expected at most {(MOST_STEPS - steps) * dt:g} s"
        )


def _say_assumptions(scenario: str, dt: float, assumptions: Sequence[Assumption]) -> None:
    click.echo(f"costs of {scenario!r} at steps of {dt:.6g} s, with these targets:")
    rows = [(a.player, a.what, a.value, a.source, a.how) for a in assumptions]
    names = ["player", "target", "value", "source", "how"]
    shown = pd.DataFrame(rows, columns=names).map(one_line)
    click.echo(shown.to_string(index=False, justify="left"))
    guessed = sorted({a.what for a in assumptions if a.source == DATA and not a.is_free})
    if guessed:
        click.echo(
            f"warning: targets guessed from the data (source 'data'): {', '.join(guessed)}; the "
            "weights depend on these values",
            err=True,
        )


def _table(players: list[str], names: Sequence[str], fit: Fit) -> pd.DataFrame:
    """Weights, standard errors where known, and what speaks against them; a row per player."""
    table = pd.DataFrame(fit.result.weights, columns=list(names))
    table.insert(0, "player", players)
    errors = fit.standard_errors
    if errors is not None:
        table[[f"{name}_error" for name in names]] = errors
    table["converged"] = fit.result.converged
    table["residual"] = np.nan if fit.residuals is None else fit.residuals
    table["noise"] = fit.problem.sigma
    table["fit"], table["fit_p"] = fit.test.verdict, fit.test.p
    return table


def _add_targets(table: pd.DataFrame, fit: Fit) -> None:
    """Add targets that were estimated to the table of weights, and say them."""
    values, deviations = fit.result.parameters, fit.result.parameter_deviations
    if values is None:
        return
    shown = table[["player"]].copy()
    for i, own in enumerate(fit.problem.game.parameters.unknowns):
        for k, unknown in enumerate(own):
            table.loc[i, unknown.name] = values[i, k]
            text = f"{values[i, k]:.4g}"
            if deviations is not None:
                table.loc[i, f"{unknown.name}_error"] = deviations[i, k]
                text += f" ± {deviations[i, k]:.1g}"
            shown.loc[i, f"{unknown.name} [{unknown.unit}]"] = text
    click.echo("targets that were estimated:")
    click.echo(shown.fillna("").map(one_line).to_string(index=False))


def _say_result(table: pd.DataFrame, players: list[str], fit: Fit, source: str) -> None:
    shown = table[["player"]].copy()
    for name in fit.problem.weight_names:
        text = table[name].map("{:.4f}".format)
        if f"{name}_error" in table:
            text += " ± " + table[f"{name}_error"].map("{:.1g}".format)
        shown[name] = text
    click.echo("weights" + (" ± standard error:" if "±" in shown.to_string() else ":"))
    click.echo(shown.to_string(index=False))
    noise = f"noise {fit.problem.sigma:.2g} m ({source})"
    if fit.residual is None:
        click.echo(f"the estimator gives no motion to compare; {noise}")
    else:
        click.echo(f"residual {fit.residual:.2g} m, {noise}")
    click.echo(str(fit.test))
    _say_doubts(players, fit, source)


def _say_doubts(players: list[str], fit: Fit, source: str) -> None:
    if fit.standard_errors is None:
        click.echo("no standard errors: the estimator gives no covariance for these data", err=True)
    if fit.unexplained:
        who = ", ".join(
            f"{players[i]} ({fit.residuals[i]:.2g} m)"  # type: ignore[index]
            for i in fit.unexplained
        )
        click.echo(
            "warning: the model does not explain the motion, do not rely on these weights: "
            f"residuals are far above the noise for {who}",
            err=True,
        )
        if source != TOLD:
            click.echo("smoothed tracks look less noisy than they are; set --noise", err=True)
    if fit.test.verdict == "does not fit" and not fit.unexplained:
        click.echo("warning: the model does not fit, do not rely on these weights", err=True)
    if not fit.result.converged:
        reason = fit.result.message or "the estimator gives no reason"
        click.echo(f"not converged, do not rely on these weights: {reason}", err=True)
    elif fit.result.message:
        click.echo(f"note: {fit.result.message}", err=True)


def _find_intervals(table: pd.DataFrame, fit: Fit, seconds: float) -> None:
    """Add intervals to the table of weights, as far as they are found in time, and say them."""
    deadline = time.monotonic() + seconds
    with _stage("intervals", seconds):
        intervals = fit.intervals(deadline)
    late = time.monotonic() > deadline
    if intervals is None:
        return
    shown = table[["player"]].copy()
    for k, name in enumerate(fit.problem.weight_names):
        table[[f"{name}_low", f"{name}_high"]] = intervals[:, k]
        low, high = (table[f"{name}_{end}"].map(_shown_end) for end in ("low", "high"))
        shown[name] = low + " to " + high
    click.echo("95 % intervals:")
    click.echo(shown.to_string(index=False))
    if np.isnan(intervals).any():
        slow = f"?: not found within {seconds:.3g} s; a longer --budget finds more"
        lost = "?: the fit cannot be followed so far; the data may not limit this weight"
        click.echo(slow if late else lost, err=True)


def _shown_end(value: float) -> str:
    return "?" if np.isnan(value) else f"{value:.3f}"


def _observation(game: Game, names: list[str], states: np.ndarray) -> tuple[View, np.ndarray]:
    """A view of the components that have known values, and its observations (T, N, d)."""
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


@contextmanager
def _stage(what: str, seconds: float) -> Iterator[None]:
    """Say what is done, for how long already, and at the end for how long it was done [s]."""
    began, done = time.monotonic(), Event()
    shown = f"{what}: {{elapsed}}, at most {seconds:.3g} s"
    with tqdm(bar_format=shown, disable=None, leave=False) as bar:  # terminals only

        def tick() -> None:
            while not done.wait(1):
                bar.refresh()

        Thread(target=tick, daemon=True).start()
        try:
            yield
        finally:
            done.set()
    click.echo(f"{what}: {time.monotonic() - began:.1f} s", err=True)


def _estimate(
    reference: str, problem: Problem, observation: Observation, budget: float
) -> tuple[Estimate, float]:
    """The estimate, and the time that it took without compilation [s]."""
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
        time_limit=max(OVERTIME * budget, budget + 1),
        budget=budget,
        set_up_limit=SET_UP,
    )
    try:
        if not task.plugin:
            _compile(player, task)
        with _stage("estimate", budget):
            answer = player.estimate(task)
        if answer.estimate is None:
            hint = UNKNOWN if problem.game.parameters.count else ""
            raise UserError(
                f"estimator {reference!r} does not take this recording: {answer.declined}{hint}"
            )
        return check_estimate(answer.estimate, problem), answer.seconds
    except (PlayerFault, InvalidEstimateError) as error:
        late = isinstance(error, PlayerFault) and error.status == "timeout"
        raise UserError(f"estimator {reference!r}: {error}{HINT if late else ''}") from error
    finally:
        player.stop()


def _compile(player: PlayerProcess, task: PlayerTask) -> None:
    """Have all that an estimate needs compiled, by one that ends at once."""
    with _stage("compilation", SET_UP), suppress(PlayerFault):  # the estimate will tell
        player.estimate(replace(task, time_limit=SET_UP, budget=REHEARSAL))
