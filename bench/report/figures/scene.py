"""The truth behind trials, and the plane in which it is drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Polygon

from olne_bench.bench.judge.observe import observe
from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.report.figures.telling import telling_trial
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.predicted_motion import predict_again
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import UNKNOWN_HERE, USUAL, Study, why_unknown
from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.worlds.scene import car_outline, is_on_road
from olne_bench.games.model.observation import FullView

if TYPE_CHECKING:
    from olne_bench.envs.roads.road_shapes import LaneShape

_MARGIN = 0.12  # of the extent, on each side
_LEAST_MARGIN = 0.05  # of the larger extent
_ELONGATED = 2.0  # ratio of extents above which a scene is drawn along the page
_FARTHEST = 0.5  # of the extents, beyond which a prediction is not shown
_ROAD_MARGIN = 7.0  # [m] on each side of a road's cars
_FLATTEST, _MOST_STRETCH = 6.0, 3.0  # ratio of extents of a stretched road, and largest stretch

_ASPHALT, _LANE_MARK = "#DADBDE", "#FFFFFF"
_MARK_WIDTH = 1.1  # [pt]
_DASHES = (0, (5, 5))


@dataclass(frozen=True)
class Scene:
    """One recording and the trials that observed it.

    Attributes:
        entry: the scenario with its options.
        recording: the truth.
        trials: rows of the scenario with this truth: all rows of a fixed scenario, or those of
            one draw of a family.
        axes_order: indices of the position components drawn to the right and upwards.
        limits: ((low, high) to the right, (low, high) upwards) [m].
        lanes: lanes of HighwayEnv's road, if it is on one.
    """

    study: Study
    name: str
    recording: Recording
    trials: pd.DataFrame
    axes_order: tuple[int, int]
    limits: tuple[tuple[float, float], tuple[float, float]]
    lanes: "tuple[LaneShape, ...]" = ()

    @property
    def on_road(self) -> bool:
        """Whether it is on HighwayEnv's road: y points down, and cars have a size."""
        return is_on_road(self.recording.scenario)

    @property
    def stretch(self) -> float:
        """Stretch of the ordinate against the abscissa, as a long road would look like a line."""
        width, height = self.extents
        wanted = round(2 * width / height / _FLATTEST) / 2
        return float(np.clip(wanted, 1, _MOST_STRETCH)) if self.on_road else 1.0

    @property
    def stretch_note(self) -> str:
        """A note on the stretch; empty if there is none."""
        name = self.recording.scenario.game.dynamics.state_names[self.axes_order[1]]
        return f" ({name} stretched × {self.stretch:g})" if self.stretch > 1 else ""

    @property
    def extents(self) -> tuple[float, float]:
        """Width and height [m]."""
        (left, right), (bottom, top) = self.limits
        return right - left, top - bottom

    @property
    def is_wide(self) -> bool:
        """Whether panels are placed below each other rather than side by side."""
        width, height = self.extents
        return width > _ELONGATED * height

    def observed(self, sigma: float, seed: int) -> np.ndarray:
        """Full states (T, N, n) under a trial's noise, whatever its sensor shows of them."""
        noise = self.study.noise_seed(self.name, sigma, seed)
        return observe((self.recording,), (FullView(),), sigma, noise)[0].y

    def predicted(self, trial: Mapping[Any, Any]) -> np.ndarray | None:
        """The predicted states (T, N, n) of a trial's row; None if it has none."""
        return predict_again(self.study.draw(self.name, int(trial["seed"])), trial)

    def shows(self, state: np.ndarray) -> bool:
        """Whether the position of a state (n,) is within the limits."""
        pairs = zip(self.plane(state), self.limits, strict=True)
        return all(low <= value <= high for value, (low, high) in pairs)

    def around(self, position: np.ndarray, reach: float) -> "Scene":
        """The scene with its limits cut to within ``reach`` [m] of a position (2,)."""
        cut = []
        for axis, (low, high) in zip(self.axes_order, self.limits, strict=True):
            cut.append((max(low, position[axis] - reach), min(high, position[axis] + reach)))
        return replace(self, limits=(cut[0], cut[1]))

    def showing(self, *motions: np.ndarray) -> "Scene":
        """The scene of a road with limits that show further states (T, N, n), too.

        What lies farther away than half of the scene's extents is not shown.
        """
        seen = np.concatenate([self.recording.states, *motions])[..., :2].reshape(-1, 2)
        found = np.array(_limits(seen, self.on_road))
        own = np.array(self.limits)
        reach = _FARTHEST * np.ptp(own, axis=1)
        low = np.maximum(found[:, 0], own[:, 0] - reach)
        high = np.minimum(found[:, 1], own[:, 1] + reach)
        limits = [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
        lanes = _lanes(self.recording.scenario.name, low, high)
        return replace(self, limits=(limits[0], limits[1]), lanes=lanes)

    def plane(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates to the right and upwards of states (..., n)."""
        return states[..., self.axes_order[0]], states[..., self.axes_order[1]]

    def frame(self, axes: Axes, lanes: bool = True) -> None:
        """Set limits, aspect and axis labels, and draw the lanes unless told not to."""
        names = self.recording.scenario.game.dynamics.state_names
        right, up = self.axes_order
        vertical = self.limits[1][::-1] if self.on_road else self.limits[1]
        axes.set(xlim=self.limits[0], ylim=vertical, aspect=self.stretch)
        axes.set(xlabel=f"{names[right]} [m]", ylabel=f"{names[up]} [m]")
        if lanes and self.lanes:
            self.draw_asphalt(axes)
            self.draw_marks(axes, _LANE_MARK)

    def draw_asphalt(self, axes: Axes) -> None:
        """Draw the lanes as areas."""
        areas = [np.vstack([shape.edges[0], shape.edges[1][::-1]]) for shape in self.lanes]
        axes.set_facecolor("#F6F6F3")
        axes.grid(visible=False)
        axes.add_collection(PolyCollection(areas, facecolor=_ASPHALT, linewidth=0, zorder=0.5))

    def draw_marks(self, axes: Axes, colour: str) -> None:
        """Draw the lines between lanes and at their edges."""
        for kind, dashes in (("solid", "-"), ("dashed", _DASHES)):
            lines = [
                edge
                for shape in self.lanes
                for edge, mark in zip(shape.edges, shape.marks, strict=True)
                if mark == kind
            ]
            axes.add_collection(
                LineCollection(
                    lines, color=colour, linewidth=_MARK_WIDTH, linestyle=dashes, zorder=0.6
                )
            )

    def draw_car(
        self, axes: Axes, state: np.ndarray, colour: str, label: str = "", filled: bool = True
    ) -> None:
        """Draw a vehicle at a state (n,): a car on a road, elsewhere a dot."""
        x, y = (float(value) for value in self.plane(state))
        if self.on_road:
            face = to_rgba(colour, 1.0 if filled else 0.15)
            shape = Polygon(
                car_outline(state), facecolor=face, edgecolor=colour, linewidth=0.8, zorder=3
            )
            axes.add_patch(shape)
        else:
            size, alpha = (7, 1.0) if label else (2.5, 0.5)
            axes.plot(
                x, y, color=colour, marker="o", markersize=size, markeredgewidth=0, alpha=alpha
            )
        if label:
            text = axes.text(x, y, label, color="white", ha="center", va="center_baseline")
            text.set(fontsize=5.5, fontweight="bold", zorder=4, clip_on=True)


def scene_of(trials: pd.DataFrame, study: Study = USUAL) -> Scene:
    """The scene of one scenario's attempts; for a family, the scene of one draw.

    The draw is the one in which methods differ most (``telling.telling_trial``).

    Raises:
        NotDrawnError: if there are no attempts, or the scenario cannot be played here.
    """
    trials = attempts_of(trials)
    if trials.empty:
        raise NotDrawnError("nothing was attempted")
    name = str(trials["scenario"].iloc[0])
    family = study.is_family(name)
    seed = telling_trial(trials)[1] if family else int(trials["seed"].min())
    try:
        recording = true_recording(study.draw(name, seed))
    except UNKNOWN_HERE as error:
        raise NotDrawnError(f"it cannot be played here: {why_unknown(error)}") from error
    rows = trials[trials["seed"] == seed] if family else trials
    road = is_on_road(recording.scenario)
    limits = _limits(recording.states[..., :2].reshape(-1, 2), road)
    if road:
        low, high = np.array(limits).T
        lanes = _lanes(recording.scenario.name, low, high)
        return Scene(study, name, recording, rows, (0, 1), limits, lanes)
    width, height = (b - a for a, b in limits)
    order = (1, 0) if height > _ELONGATED * width else (0, 1)
    return Scene(study, name, recording, rows, order, (limits[order[0]], limits[order[1]]))


def _lanes(road: str, low: np.ndarray, high: np.ndarray) -> "tuple[LaneShape, ...]":
    from olne_bench.envs.roads.road_shapes import lane_shapes  # HighwayEnv is slow to import

    return tuple(lane_shapes(road, low, high))


Limits = tuple[tuple[float, float], tuple[float, float]]


def _limits(positions: np.ndarray, road: bool) -> Limits:
    """What to show around positions (S, 2): ((low, high) of px, (low, high) of py) [m]."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    extents = high - low
    margins = np.maximum(_MARGIN * extents, _LEAST_MARGIN * extents.max())
    if road:
        margins = np.full(2, _ROAD_MARGIN)
    (left, bottom), (right, top) = (low - margins).tolist(), (high + margins).tolist()
    return (left, right), (bottom, top)
