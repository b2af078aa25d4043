"""A slice of one player's cost landscape, at the true and at the estimated weights."""

from collections.abc import Sequence
from itertools import combinations

import casadi as ca
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.panels import scene_panels
from olne_bench.bench.report.figures.scene import Scene, scene_of
from olne_bench.bench.report.figures.series import Series, contenders, sensors_in, split
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.predicted_motion import estimated_weights
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.scene import player_colour
from olne_bench.games.model.costs import Stage

_CELLS = 160  # along the longer side of the slice
_LEVELS = 11
#: On a road, the distance that a car can cover within a second or two [m]. Farther away only the
#: squared cost of its lane is visible, and opposite to an arc the lane's heading jumps.
_ROAD_REACH = 18.0
_ROAD_NEAR = 3.5  # [m] from the player; costs within it set the colour scale


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Cost of a position for one player, where and when it passes another most closely.

    There is one panel for the truth and one per estimator, at the median of its weights at the
    largest noise level that all estimators share, with the full sensor if there is one. Titles give
    the weights that the cost of a position depends on: panels differ in nothing else.

    Raises:
        NotDrawnError: as ``scene_of``, and if no trial has weights that fit the scenario.
    """
    scene = scene_of(trials, study)
    sensor = sensors_in(scene.trials)[0]
    series = contenders(split(scene.trials[scene.trials["sensor"] == sensor], study))
    sigma = _common_sigma(series, scene)
    panels = [("truth", scene.recording.scenario.weights)]
    for s in series:
        weights = median_weights(s, scene, sigma)
        if weights is not None:
            panels.append((style.printable(s.estimator), weights))

    states = scene.recording.states
    step, player = closest_pass(states)
    if scene.on_road:
        scene = scene.around(states[step, player], _ROAD_REACH)
    grid = _grid(scene)
    costs = [position_cost(scene, weights[player], step, player, *grid) for _, weights in panels]
    matter = _weights_that_matter(scene, step, player)
    between = ", " if scene.is_wide else "\n"
    names = [
        between.join(filter(None, [name, _told(scene, weights[player], matter)]))
        for name, weights in panels
    ]
    figure = _heat_maps(scene, grid, names, costs, step, player)
    time = step * scene.recording.scenario.game.dt
    figure.suptitle(
        f"{trials['scenario'].iloc[0]}: cost of a position for player {player + 1} at "
        f"t = {time:g} s,\nat median estimates ({style.printable(sensor)}, σ = {sigma:g})"
        f"{scene.stretch_note}"
    )
    return figure


def closest_pass(states: np.ndarray) -> tuple[int, int]:
    """Step and player where two players of (T, N, n) are nearest each other.

    The first step does not count, as no player chose its start.
    """
    pairs = list(combinations(range(states.shape[1]), 2))
    if not pairs:
        return len(states) // 2, 0
    distances = np.array(
        [np.linalg.norm(states[1:, i, :2] - states[1:, j, :2], axis=1) for i, j in pairs]
    )
    pair, step = np.unravel_index(distances.argmin(), distances.shape)
    return int(step) + 1, pairs[int(pair)][0]


def position_cost(
    scene: Scene, weights: np.ndarray, step: int, player: int, px: np.ndarray, py: np.ndarray
) -> np.ndarray:
    """Cost of one step for one player at other positions, minus the least of these costs.

    All else (its heading, speed and control, the other players) is as in the truth. Terms that do
    not depend on the position drop out.

    Args:
        scene: the truth.
        weights: (K,) weights of this player.
        step: index of the step.
        player: index of the player.
        px: positions [m], any shape.
        py: positions [m], of the same shape.
    """
    position, stage = _at_any_position(scene, step, player)
    model, theta = scene.recording.scenario.game.players[player], ca.SX(ca.DM(weights))
    final = stage.control is None
    cost = model.final_cost(stage, theta) if final else model.running_cost(stage, theta)
    values = np.array(ca.Function("cost", [position], [cost])(np.array([px.ravel(), py.ravel()])))
    return (values - values.min()).reshape(px.shape)


def _at_any_position(scene: Scene, step: int, player: int) -> tuple[ca.SX, Stage]:
    """A symbol for one player's position, and the true stage with the player there."""
    game, recording = scene.recording.scenario.game, scene.recording
    position = ca.SX.sym("position", 2)
    states = [ca.SX(ca.DM(state)) for state in recording.states[step]]
    states[player] = ca.vertcat(position, states[player][2:])
    last = step == game.horizon - 1
    control = None if last else ca.SX(ca.DM(recording.controls[step, player]))
    return position, Stage(player, tuple(states), control, game.dynamics, game.dt)


def _weights_that_matter(scene: Scene, step: int, player: int) -> list[int]:
    """Weights whose features depend on the position."""
    position, stage = _at_any_position(scene, step, player)
    features = scene.recording.scenario.game.players[player].preferences
    final = stage.control is None
    costs = [f.final_cost(stage) if final else f.running_cost(stage) for f in features]
    return [k for k, cost in enumerate(costs) if ca.depends_on(ca.SX(cost), position)]


def _told(scene: Scene, weights: np.ndarray, matter: Sequence[int]) -> str:
    names = scene.recording.scenario.game.weight_names
    return ", ".join(f"{names[k]} {weights[k]:.2g}" for k in matter)


def median_weights(series: Series, scene: Scene, sigma: float) -> np.ndarray | None:
    """Componentwise median (N, K) of the estimates at a noise level, rows scaled to sum one."""
    rows = series.trials.loc[series.trials["sigma"] == sigma, "weights"]
    game = scene.recording.scenario.game
    found = [w for w in (estimated_weights(value, game) for value in rows) if w is not None]
    if not found:
        return None
    median = np.median(found, axis=0)
    return median / median.sum(axis=1, keepdims=True)


def _common_sigma(series: Sequence[Series], scene: Scene) -> float:
    """Largest noise level at which every estimator has weights, else at which any has."""
    game = scene.recording.scenario.game

    def left_weights(one: Series, sigma: float) -> bool:
        values = one.trials.loc[one.trials["sigma"] == sigma, "weights"]
        return any(estimated_weights(value, game) is not None for value in values)

    levels = sorted({sigma for s in series for sigma in s.trials["sigma"]}, reverse=True)
    for enough in (all, any):
        for sigma in levels:
            if enough(left_weights(s, sigma) for s in series):
                return float(sigma)
    raise NotDrawnError("no estimate left weights")


def _grid(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Positions px, py [m] over the scene, as drawn."""
    longer = max(scene.extents)
    right, up = (
        np.linspace(low, high, max(round(_CELLS * (high - low) / longer), 12))
        for low, high in scene.limits
    )
    plane = np.meshgrid(right, up)
    return (plane[0], plane[1]) if scene.axes_order == (0, 1) else (plane[1], plane[0])


def _heat_maps(
    scene: Scene,
    grid: tuple[np.ndarray, np.ndarray],
    names: Sequence[str],
    costs: Sequence[np.ndarray],
    step: int,
    player: int,
) -> Figure:
    columns = 1 if scene.is_wide else 3
    places = [divmod(k, columns) for k in range(len(names))]
    margin = (0.3, 1.4) if scene.is_wide else (1, 0.6)
    figure, panels = scene_panels(scene, places, margin, lanes=False)
    right, up = scene.plane(np.stack(grid, axis=-1))
    levels = np.linspace(0, _largest(scene, costs, right, up, step, player) or 1.0, _LEVELS)
    for axes, name, cost in zip(panels, names, costs, strict=True):
        image = axes.pcolormesh(
            right, up, cost, vmin=0, vmax=levels[-1], cmap="cividis", rasterized=True
        )
        axes.contour(
            right, up, cost, levels=levels[1:-1], colors="white", linewidths=0.5, alpha=0.7
        )
        _players(axes, scene, step, player)
        axes.set_title(name)
    place = "bottom" if scene.is_wide else "right"
    beyond = "max" if any(cost.max() > levels[-1] for cost in costs) else "neither"
    figure.colorbar(
        image,
        ax=panels,
        location=place,
        label="Cost above the least [-]",
        aspect=45,
        extend=beyond,
    )
    style.legend_below(figure, _entries(scene, step, player))
    return figure


def _largest(
    scene: Scene,
    costs: Sequence[np.ndarray],
    right: np.ndarray,
    up: np.ndarray,
    step: int,
    player: int,
) -> float:
    """Upper end of the colours; on a road the largest cost near the player, as others are huge."""
    if not scene.on_road:
        return float(max(cost.max() for cost in costs))
    x, y = scene.plane(scene.recording.states[step, player])
    near = np.hypot(right - x, up - y) < _ROAD_NEAR
    return float(max(cost[near].max() for cost in costs))


def _players(axes: Axes, scene: Scene, step: int, player: int) -> None:
    """True paths and true positions at the step; a star marks the player whose cost is drawn."""
    states = scene.recording.states
    for i in range(states.shape[1]):
        axes.plot(*scene.plane(states[:, i]), color="white", linewidth=0.9, alpha=0.8)
        if scene.on_road:
            scene.draw_car(axes, states[step, i], player_colour(i), label=str(i + 1))
        else:
            marker = _marker(i, i == player)
            marker.set_data(*([float(v)] for v in scene.plane(states[step, i])))
            axes.add_line(marker)
    axes.grid(visible=False)
    scene.draw_marks(axes, "#FFFFFF66")


def _entries(scene: Scene, step: int, player: int) -> list[tuple[Artist, str]]:
    entries: list[tuple[Artist, str]] = []
    for i, state in enumerate(scene.recording.states[step]):
        if scene.shows(state):
            marker = _marker(i, i == player)
            if scene.on_road:
                marker.set(marker="s", markersize=7)
            entries.append((marker, f"player {i + 1}{' (whose cost)' * (i == player)}"))
    return entries


def _marker(player: int, is_subject: bool) -> Line2D:
    return Line2D(
        [],
        [],
        linestyle="none",
        marker="*" if is_subject else "o",
        markersize=12 if is_subject else 7,
        color=player_colour(player),
        markeredgecolor="white",
        markeredgewidth=0.9,
    )
