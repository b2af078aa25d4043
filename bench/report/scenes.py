"""Scenes for pictures and pages: a stored truth, what was seen of it, what estimates predict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.observe import observe_states
from olne_bench.bench.judge.scene import NoSceneError, TrueScene
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.score import BASELINE, REFERENCE
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.worlds.recorded import RecordedWorld

if TYPE_CHECKING:
    from olne_bench.envs.roads.road_shapes import LaneShape

#: Noise level and seed of a sequence.
Place = tuple[float, int]
Limits = tuple[tuple[float, float], tuple[float, float]]

_MARGIN, _LEAST_MARGIN = 0.12, 0.05  # of the extent, on each side; of the larger extent
_ROAD_MARGIN = 7.0  # [m] on each side of a road's cars
_ELONGATED = 2.0  # ratio of extents above which a scene is drawn along the page
_FLATTEST, _MOST_STRETCH = 6.0, 3.0  # ratio of extents of a stretched road, and largest stretch
_ENOUGH = 0.5  # share of the draws that both estimators of a choice must predict
_TRIES = 5  # draws that are looked at for two predictions
_TRIAL = ["sensor", "sigma", "seed"]


@dataclass(frozen=True)
class Scene:
    """One truth, and the plane in which it is drawn."""

    study: Study
    name: str  # label of the scenario
    truth: TrueScene
    axes_order: tuple[int, int]  # position components that are drawn to the right and upwards
    limits: Limits  # of these [m]
    lanes: "tuple[LaneShape, ...]" = ()  # of HighwayEnv's road, if it is on one

    @property
    def on_road(self) -> bool:
        """Whether it is on HighwayEnv's road: y points down, and cars have a size."""
        return bool(self.truth.road)

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

    @property
    def stretch(self) -> float:
        """Stretch of the ordinate against the abscissa, as a long road would look like a line."""
        width, height = self.extents
        wanted = round(2 * width / height / _FLATTEST) / 2
        return float(np.clip(wanted, 1, _MOST_STRETCH)) if self.on_road else 1.0

    @property
    def axis_names(self) -> tuple[str, str]:
        """Names of the position components to the right and upwards."""
        right, up = self.axes_order
        return self.truth.state_names[right], self.truth.state_names[up]

    def observed(self, sigma: float, seed: int) -> np.ndarray:
        """Full states (T, N, n) under a trial's noise, whatever its sensor shows of them."""
        truth, noise = self.truth, self.study.noise_seed(self.name, sigma, seed)
        world = RecordedWorld(truth.states, truth.state_names, truth.dt)
        return observe_states(world, truth.noise_scale, sigma, noise)

    def predicted(self, trial: Mapping[Any, Any]) -> np.ndarray | None:
        """The states (T, N, n) that a row predicts, as far as the published step finds them.

        None if there are none, or they are not stored; NotDrawnError if they cannot be read.
        """
        if trial["status"] != "ok" or trial["published_forward"] == 0:
            return None
        try:
            return self.study.scenes.motion(trial, self.truth.states.shape)
        except NoSceneError as error:
            raise NotDrawnError(str(error)) from error

    def plane(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates to the right and upwards of states (..., n)."""
        return states[..., self.axes_order[0]], states[..., self.axes_order[1]]


def scene_of(name: str, seed: int, study: Study = USUAL) -> Scene:
    """The scene of a scenario's draw; NotDrawnError if it is not stored, or cannot be read."""
    try:
        truth = study.scenes.truth(name, seed)
    except NoSceneError as error:
        raise NotDrawnError(str(error)) from error
    limits = _limits(truth.states[..., :2].reshape(-1, 2), bool(truth.road))
    if truth.road:
        from olne_bench.envs.roads.road_shapes import lane_shapes  # HighwayEnv is slow to import

        lanes = tuple(lane_shapes(truth.road, *np.array(limits).T))
        return Scene(study, name, truth, (0, 1), limits, lanes)
    width, height = (high - low for low, high in limits)
    order = (1, 0) if height > _ELONGATED * width else (0, 1)
    return Scene(study, name, truth, order, (limits[order[0]], limits[order[1]]))


def _limits(positions: np.ndarray, road: bool) -> Limits:
    """What to show around positions (S, 2): ((low, high) of px, (low, high) of py) [m]."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    extents = high - low
    usual = np.maximum(_MARGIN * extents, _LEAST_MARGIN * extents.max())
    margins = np.full(2, _ROAD_MARGIN) if road else usual
    (left, bottom), (right, top) = (low - margins).tolist(), (high + margins).tolist()
    return (left, right), (bottom, top)


def estimated_weights(value: Any, truth: TrueScene) -> np.ndarray | None:
    """Weights (N, K) of a row; None if it has none; NotDrawnError if they do not fit the truth."""
    if value is None or (isinstance(value, float) and np.isnan(value)) or value is pd.NA:
        return None
    try:
        rows = np.array([list(row) for row in value], dtype=float)
    except (TypeError, ValueError) as error:
        raise NotDrawnError(f"stored weights do not fit the scenario: {error}") from error
    if rows.shape != truth.weights.shape or not (np.isfinite(rows) & (rows >= 0)).all():
        raise NotDrawnError(f"stored weights do not fit the scenario: {rows.tolist()}")
    return rows


@dataclass(frozen=True)
class Choice:
    """Trials that may be shown, all with the same sensor and noise."""

    estimators: tuple[str, str]  # whose predictions are shown
    sensor: str
    sigma: float
    seeds: tuple[int, ...]  # those first whose difference of errors is nearest to the median


def tried(trials: pd.DataFrame) -> pd.DataFrame:
    """The attempts of a scenario; NotDrawnError if there are none."""
    attempts = attempts_of(trials)
    if attempts.empty:
        raise NotDrawnError("nothing was attempted")
    return attempts


def choose(trials: pd.DataFrame, study: Study = USUAL) -> Choice:
    """Choose the trial of a scenario to show, by a rule that no result can bend.

    The first estimator has the least median position error, the second one is the paper's baseline,
    its method, or the next one. The noise is the largest at which both predict at least half of the
    draws, with the first sensor for which they do. NotDrawnError if two predict no trial in common.
    """
    attempts = tried(trials)
    first, second = _two_estimators(attempts, study)
    drawn = attempts["status"].eq("ok") & ~attempts["published_forward"].eq(0)
    told = attempts[_TRIAL].assign(drawn=drawn, error=attempts["position_error"])
    parts = [told[attempts["estimator"] == name] for name in (first, second)]
    pairs = parts[0].merge(parts[1], on=_TRIAL)
    pairs["drawn"] = pairs["drawn_x"] & pairs["drawn_y"]
    shares = pairs.groupby(["sensor", "sigma"])["drawn"].mean()
    if not (shares > 0).any():
        raise NotDrawnError(f"{first} and {second} predict no trial in common")
    enough = shares[shares >= min(_ENOUGH, shares.max())].index
    order = sorted(attempts["sensor"].unique(), key=lambda s: (s != "full", s))
    sensor, sigma = max(enough, key=lambda cell: (cell[1], -order.index(cell[0])))
    here = pairs[(pairs["sensor"] == sensor) & (pairs["sigma"] == sigma) & pairs["drawn"]]
    gaps = (here["error_x"] - here["error_y"]).abs()
    seeds = here["seed"].to_numpy(int)[np.lexsort((here["seed"], gaps))]
    middle = np.argsort(np.abs(np.arange(len(seeds)) - (len(seeds) - 1) // 2), kind="stable")
    return Choice((first, second), str(sensor), float(sigma), tuple(seeds[middle].tolist()))


def _two_estimators(attempts: pd.DataFrame, study: Study) -> tuple[str, str]:
    if "position_error" not in attempts:
        raise NotDrawnError("there is no position error")
    failed = attempts["status"].ne("ok") | attempts["position_error"].isna()
    errors = attempts["position_error"].astype(float).where(~failed, np.inf)
    medians = errors.groupby(attempts["estimator"]).median().sort_values(kind="stable")
    names = [str(name) for name in medians.index if not study.is_floor(str(name))]
    if len(names) < 2:
        raise NotDrawnError("it takes two estimators")
    others = [name for name in (BASELINE, REFERENCE, names[1]) if name in names[1:]]
    return names[0], others[0]


def shown_trial(
    trials: pd.DataFrame, choice: Choice, study: Study = USUAL
) -> tuple[int, Scene, list[dict[Any, Any]], list[np.ndarray]]:
    """The first draw of a choice whose predictions are stored: seed, scene, rows, predictions.

    NotDrawnError if none of the first draws has both, or it cannot be read.
    """
    for seed in choice.seeds[:_TRIES]:
        here = trials[trials["seed"] == seed]
        here = here[(here["sensor"] == choice.sensor) & (here["sigma"] == choice.sigma)]
        rows = here.set_index("estimator", drop=False).loc[list(choice.estimators)]
        scene = scene_of(str(rows["scenario"].iloc[0]), seed, study)
        told = rows.to_dict("records")
        found = [states for row in told if (states := scene.predicted(row)) is not None]
        if len(found) == len(told):
            return seed, scene, told, found
    raise NotDrawnError("the predictions of the chosen trials are not stored")


def sequences(
    trials: pd.DataFrame, most: int, wanted: Sequence[Place] = (), study: Study = USUAL
) -> tuple[list[Place], list[str]]:
    """Sequences of a scenario that a page plays, the chosen one first, and the two estimators.

    The others are the ``wanted`` ones that the scenario has, and up to the number ``most`` those of
    the same draw at other noise levels. NotDrawnError if nothing was attempted.
    """
    attempts = tried(trials)
    known = {(float(sigma), int(seed)) for sigma, seed in attempts[["sigma", "seed"]].to_numpy()}
    try:
        choice = choose(attempts, study)
        first, shown = (choice.sigma, choice.seeds[0]), [*choice.estimators]
    except NotDrawnError:
        first = max(known, key=lambda place: (place[0], -place[1]))
        shown = sorted(attempts["estimator"].unique())[:2]
    same_draw = sorted((place for place in known if place[1] == first[1]), reverse=True)
    asked = [place for place in wanted if place in known]
    kept = list(dict.fromkeys([first, *asked, *same_draw]))
    return kept[: max(most, 1 + len(asked))], shown
