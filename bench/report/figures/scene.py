"""The truth behind trials, and the plane in which it is drawn."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from olne_bench.bench.judge.observe import observe
from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.predicted_motion import predict_again
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import UNKNOWN_HERE, USUAL, Study, why_unknown
from olne_bench.envs.recording import Recording
from olne_bench.games.observation import FullView

_MARGIN = 0.12  # of its own extent, on each side
_LEAST_MARGIN = 0.05  # of the larger extent
_ELONGATED = 2.0  # ratio of extents from which a scene is drawn along the page


@dataclass(frozen=True)
class Scene:
    """One recording and the trials that observed it.

    Attributes:
        entry: the scenario with its options.
        recording: the truth.
        trials: rows of the scenario with this truth: all of them in a fixed scenario, one draw's
            in a seeded family.
        axes_order: which position component is drawn to the right and which upwards.
        limits: ((low, high) to the right, (low, high) upwards) [m].
    """

    study: Study
    name: str
    recording: Recording
    trials: pd.DataFrame
    axes_order: tuple[int, int]
    limits: tuple[tuple[float, float], tuple[float, float]]

    @property
    def extents(self) -> tuple[float, float]:
        """Width and height [m]."""
        (left, right), (bottom, top) = self.limits
        return right - left, top - bottom

    @property
    def is_wide(self) -> bool:
        """Whether panels belong below rather than beside each other."""
        width, height = self.extents
        return width > _ELONGATED * height

    def observed(self, sigma: float, seed: int) -> np.ndarray:
        """Full states (T, N, n) under a trial's noise, whatever its sensor shows of them."""
        noise = self.study.noise_seed(self.name, sigma, seed)
        return observe((self.recording,), (FullView(),), sigma, noise)[0].y

    def predicted(self, trial: Mapping[Any, Any]) -> np.ndarray | None:
        """The predicted states (T, N, n) of a trial's row, None where it has none."""
        return predict_again(self.study.draw(self.name, int(trial["seed"])), trial)

    def plane(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates to the right and upwards of states (..., n)."""
        return states[..., self.axes_order[0]], states[..., self.axes_order[1]]

    def frame(self, axes: Axes) -> None:
        """Limits, equal aspect and axis labels."""
        names = self.recording.scenario.game.dynamics.state_names
        right, up = self.axes_order
        axes.set(xlim=self.limits[0], ylim=self.limits[1], aspect="equal")
        axes.set(xlabel=f"{names[right]} [m]", ylabel=f"{names[up]} [m]")


def player_colour(player: int) -> str:
    """Colour of a player, the same in all figures."""
    return style.PLAYER_COLOURS[player % len(style.PLAYER_COLOURS)]


def scene_of(trials: pd.DataFrame, study: Study = USUAL) -> Scene:
    """The scene of one scenario's attempts; of a seeded family it is the lowest seed's draw.

    Raises:
        NotDrawnError: without attempts, or where the scenario cannot be played here.
    """
    trials = attempts_of(trials)
    if trials.empty:
        raise NotDrawnError("nothing was attempted")
    name = str(trials["scenario"].iloc[0])
    seed = int(trials["seed"].min())
    try:
        draw = study.draw(name, seed)
        recording = true_recording(draw)
    except UNKNOWN_HERE as error:
        raise NotDrawnError(f"it cannot be played here: {why_unknown(error)}") from error
    positions = recording.states[..., :2].reshape(-1, 2)
    low, high = positions.min(axis=0), positions.max(axis=0)
    extents = high - low
    margins = np.maximum(_MARGIN * extents, _LEAST_MARGIN * extents.max())
    limits = [(float(a), float(b)) for a, b in zip(low - margins, high + margins, strict=True)]
    width, height = (b - a for a, b in limits)
    order = (1, 0) if height > _ELONGATED * width else (0, 1)
    rows = trials[trials["seed"] == seed] if study.is_family(name) else trials
    return Scene(study, name, recording, rows, order, (limits[order[0]], limits[order[1]]))
