"""How well recorded drivers are predicted, along their lanes.

    python scripts/people.py DATA [--out results/people]

DATA is a folder of CommonRoad scenarios, such as those of NGSIM. Each car counts once, at the first
moment at which it has been seen for 2.7 s, has a leader and is seen for 3 s more. Files that share
motion are one piece, and intervals are a bootstrap over pieces. ``game`` is what ``olne-bench
predict`` does; in ``own weights`` each car has those that ``map`` finds in what was seen of it; in
``alone`` a car plays against a leader that drives straight on; ``idm`` lets all cars ahead drive by
the intelligent driver model. ``idm`` and ``ridge``, a linear regression, are fitted to the other
half of the pieces. Kinds of moments are known before the prediction: in a
``wave`` leader and leader's leader differ by more than 2 m/s, ``closing`` cars are 1.5 m/s faster
than their leader, all others are ``calm``. Writes predictions.parquet (errors, no motion),
summary.csv and people.png.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import shared
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import minimize

from olne_bench.bench.report.figures import style
from olne_bench.envs.scenarios.following import NOISE_SCALE
from olne_bench.envs.tracks.grid import Grid
from olne_bench.envs.tracks.prediction import STEP, Foreseen, predict_cars
from olne_bench.envs.tracks.reading import grid_and_road, read_whole
from olne_bench.envs.tracks.road import Road
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import FullView

SEEN, AHEAD, FARTHER = 2.7, 3.0, 5.0  # [s]
HORIZONS = (1.0, 2.0, 3.0, 5.0)  # [s]
METHODS = ("straight", "game", "own weights", "alone", "idm", "ridge")
#: Names of roads in those of files.
ROADS = {"US101": "US-101", "Lanker": "Lankershim", "Peach": "Peachtree"}
CAR_LENGTH = 4.5  # [m]
DRAWS = 2000  # of the bootstrap
RIDGE = 1.0
#: Noise of what is seen [m], its logarithm's standard deviation, and the time for its weights [s].
SIGMA, SIGMA_SPREAD, SECONDS = 0.1, 1.0, 5.0
TUPLE = 25  # displacements that tell motions apart
MISSING = 1e3  # [m], of a leader's leader that is not there


@dataclass
class Case:
    """A car at its moment: what each method predicts, and what has happened."""

    road: str
    piece: int
    kind: str
    game: Foreseen
    weighed: np.ndarray  # (S, 2) errors along and to the left of the way, with own weights
    alone: np.ndarray  # the same, against a leader that drives straight on
    gaps: np.ndarray  # (C,) distances [m] from each car of the chain to the next
    speeds: np.ndarray  # (C,) [m/s], the car's own first
    driven: np.ndarray  # (S,) metres along the way since the moment, NaN where not recorded

    @property
    def features(self) -> np.ndarray:
        """What ``ridge`` predicts from."""
        speeds = np.append(self.speeds[:3], [self.speeds[-1]] * max(0, 3 - len(self.speeds)))
        gap = min(self.gaps[0], 80.0)
        return np.array([1.0, speeds[1] - speeds[0], speeds[2] - speeds[0], speeds[0], gap])


def main(data: Path, out: Path = Path("results/people")) -> None:
    """Measure, write and print."""
    cases = [*cases_of(sorted(data.glob("*.xml")))]
    print(f"{len(cases)} cars with a leader", flush=True)
    half = {piece: k % 2 for k, piece in enumerate(sorted({case.piece for case in cases}))}
    fitted = [fitted_to([c for c in cases if half[c.piece] != k]) for k in (0, 1)]
    rows = pd.DataFrame(r for case in cases for r in errors_of(case, *fitted[half[case.piece]]))
    out.mkdir(parents=True, exist_ok=True)
    rows.round(3).to_parquet(out / "predictions.parquet", index=False, compression="zstd")
    table = pd.DataFrame(summary(rows))
    table.round(3).to_csv(out / "summary.csv", index=False)
    with style.applied():
        style.save(picture(table), out / "people", ["png"])
    shared.show({str(k): v for k, v in row.items()} for row in table.round(3).to_dict("records"))


def cases_of(paths: Sequence[Path]) -> Iterator[Case]:
    """Each car of each piece once."""
    known: dict[tuple[float, ...], int] = {}  # displacements, and the piece that has them
    pieces: list[int] = []
    for number, path in enumerate(paths):
        grid, road = grid_and_road(read_whole(path, "commonroad"))
        if road is None:
            continue
        marks = {name: _marks(grid, name) for name in grid.players}
        shared_with = [known[m] for own in marks.values() for m in own if m in known]
        piece = min(shared_with, default=number)
        pieces.append(piece)
        for name in grid.players:
            if not any(mark in known for mark in marks[name]):
                case = _case(grid, road, name, _road_name(path), piece)
                if case is not None:
                    yield case
        known |= {mark: piece for own in marks.values() for mark in own}


def _marks(grid: Grid, name: str) -> list[tuple[float, ...]]:
    """Displacements [mm] of a car over spans of samples in which it does not stand."""
    own = grid.states[:, grid.players.index(name), :2]
    moved = np.round(np.linalg.norm(np.diff(own, axis=0), axis=1) * 1000)
    if len(moved) < TUPLE:
        return []
    spans = np.lib.stride_tricks.sliding_window_view(moved, TUPLE)
    return [tuple(span) for span in spans if np.isfinite(span).all() and len({*span}) > TUPLE / 2]


def _road_name(path: Path) -> str:
    name = path.name.split("_")[1].split("-")[0]
    return ROADS.get(name, name)


def _case(grid: Grid, road: Road, name: str, where: str, piece: int) -> Case | None:
    seen = np.flatnonzero(np.isfinite(grid.states[:, grid.players.index(name), 0]))
    if not seen.size or grid.times[seen[-1]] - grid.times[seen[0]] < SEEN + AHEAD - 1e-6:
        return None
    at = float(grid.times[seen[0]]) + SEEN
    left = float(grid.times[seen[-1]]) - at
    seconds = FARTHER if left > FARTHER - 1e-6 else AHEAD
    (game,) = predict_cars(grid, road, at, seconds, players=[name])
    if not game.leaders or not np.isfinite(game.recorded).all():
        return None
    (weighed,) = predict_cars(grid, road, at, seconds, players=[name], weights=own_weights)
    (alone,) = predict_cars(grid, road, at, seconds, players=[name], most=2)
    others = predict_cars(grid, road, at, STEP, players=[name, *game.leaders])
    speeds = np.array([np.linalg.norm(o.straight[1] - o.straight[0]) / STEP for o in others])
    gaps = [np.linalg.norm(a.game[0] - b.game[0]) for a, b in pairwise(others)]
    driven = game.errors(game.straight)[:, 0]
    return Case(
        where,
        piece,
        _kind(speeds),
        game,
        weighed.errors(weighed.game),
        alone.errors(alone.game),
        np.array(gaps),
        speeds,
        speeds[0] * game.times - driven,
    )


def own_weights(game: Game, states: np.ndarray) -> np.ndarray:
    """Weights (N, 4) by ``map`` of states (T, N, 4), with a flat prior; equal ones if it fails."""
    problem = Problem(game, FullView(), SIGMA, noise_scale=NOISE_SCALE, sigma_spread=SIGMA_SPREAD)
    given = problem, Observation(states)
    found = Map().estimate(*given, rng=np.random.default_rng(0), budget=SECONDS)
    return found.weights if found.converged else np.full((game.num_players, 4), 0.25)


def _kind(speeds: np.ndarray) -> str:
    if len(speeds) > 2 and abs(speeds[1] - speeds[2]) > 2:
        return "wave"
    return "closing" if speeds[0] - speeds[1] > 1.5 else "calm"


def idm(case: Case, parameters: np.ndarray) -> np.ndarray:
    """(S,) metres that a car drives by Treiber's model, as all ahead of it but the first."""
    acceleration, comfort, headway, distance = np.exp(parameters)
    speeds, places = case.speeds.copy(), np.concatenate([[0.0], np.cumsum(case.gaps)])
    found = [0.0]
    for _ in case.game.times[1:]:
        gap = np.maximum(np.diff(places) - CAR_LENGTH, 0.5)
        own, ahead = speeds[:-1], speeds[1:]
        closing = own * (own - ahead) / (2 * np.sqrt(acceleration * comfort))
        wanted = distance + np.maximum(0.0, own * headway + closing)
        free = (own / np.maximum(case.speeds[:-1] * 1.3, 5.0)) ** 4
        change = acceleration * (1 - free - (wanted / gap) ** 2)
        change = np.append(change.clip(-8, acceleration), 0.0)
        places = places + np.maximum(speeds * STEP + change * STEP**2 / 2, 0.0)
        speeds = np.maximum(speeds + change * STEP, 0.0)
        found.append(float(places[0]))
    return np.array(found)


def fitted_to(others: Sequence[Case]) -> tuple[np.ndarray, dict[float, np.ndarray]]:
    """Parameters of ``idm`` and coefficients of ``ridge``."""

    def error(parameters: np.ndarray) -> float:
        at = round(AHEAD / STEP)
        return float(np.mean([abs(idm(c, parameters)[at] - c.driven[at]) for c in others]))

    start = np.log([1.0, 1.5, 1.2, 2.0])
    parameters = minimize(error, start, method="Nelder-Mead", options={"maxiter": 60}).x
    coefficients = {}
    for horizon in HORIZONS:
        at = round(horizon / STEP)
        known = [case for case in others if len(case.driven) > at]
        inputs = np.stack([case.features for case in known])
        missing = np.array([case.driven[at] - case.speeds[0] * horizon for case in known])
        normal = inputs.T @ inputs + RIDGE * np.eye(inputs.shape[1])
        coefficients[horizon] = np.linalg.solve(normal, inputs.T @ missing)
    return parameters, coefficients


def errors_of(
    case: Case, parameters: np.ndarray, coefficients: dict[float, np.ndarray]
) -> Iterator[dict[str, object]]:
    """A row for each horizon and method."""
    game, straight = case.game.errors(case.game.game), case.game.errors(case.game.straight)
    by_idm = idm(case, parameters)
    for horizon, method in product(HORIZONS, METHODS):
        at = round(horizon / STEP)
        if at >= len(case.driven):
            continue
        ridge = case.speeds[0] * horizon + float(case.features @ coefficients[horizon])
        along, left = {
            "straight": straight[at],
            "game": game[at],
            "own weights": case.weighed[at],
            "alone": case.alone[at],
            "idm": (by_idm[at] - case.driven[at], straight[at, 1]),
            "ridge": (ridge - case.driven[at], straight[at, 1]),
        }[method]
        row = {"road": case.road, "piece": case.piece, "kind": case.kind, "method": method}
        row |= {"ahead": horizon, "along": along, "left": left}
        if method == "game":
            half = case.game.half_widths[at]
            row |= {"holds_along": abs(along) < half[0], "holds_left": abs(left) < half[1]}
        yield row


def summary(rows: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Mean errors by road, kind, horizon and method, over those of driving straight on."""
    kinds = {"all": ("wave", "closing", "calm"), **{k: (k,) for k in ("wave", "closing", "calm")}}
    for road, (kind, of), ahead in product(sorted(rows["road"].unique()), kinds.items(), HORIZONS):
        part = rows[(rows["road"] == road) & rows["kind"].isin(of) & (rows["ahead"] == ahead)]
        wide = {m: part[part["method"] == m].reset_index(drop=True) for m in METHODS}
        if wide["game"]["piece"].nunique() < 3:
            continue
        for method in METHODS:
            own, place = wide[method], {"road": road, "kind": kind, "ahead": ahead}
            row = place | {"method": method, "cars": len(own), "pieces": own["piece"].nunique()}
            row |= {"along": own["along"].abs().mean(), "left": own["left"].abs().mean()}
            row |= _ratio("straight", wide["straight"], own)
            row |= _ratio("alone", wide["alone"], own) if method == "game" else {}
            row |= _ratio("game", wide["game"], own) if method == "own weights" else {}
            if method == "game":
                row |= {c: own[c].astype(float).mean() for c in ("holds_along", "holds_left")}
            yield row


def picture(table: pd.DataFrame) -> Figure:
    """Errors over those of driving straight on, over the time ahead, on the large roads."""
    known = {*table["road"]}
    roads = [road for road in ("US-101", "Lankershim") if road in known] or sorted(known)[:2]
    figure = Figure(figsize=(4 * len(roads), 3.4), layout="constrained")
    panels = figure.subplots(1, len(roads), sharey=True, squeeze=False)[0]
    for axes, road in zip(panels, roads, strict=True):
        for k, method in enumerate(METHODS[1:]):
            own = table[(table["road"] == road) & (table["kind"] == "all")]
            own = own[own["method"] == method]
            middle = own["over_straight"]
            ends = [middle - own["over_straight_low"], own["over_straight_high"] - middle]
            at = own["ahead"] + 0.06 * (k - 1.5)
            axes.errorbar(at, middle, ends, label=method, marker="o", markersize=4, capsize=2)
        axes.axhline(1, color="black", linewidth=1)
        axes.set(title=f"{road}: {own['cars'].max()} cars", xlabel="seconds ahead")
    panels[0].set_ylabel("error along the lane / straight on")
    panels[0].legend(fontsize="small")
    return figure


def _ratio(name: str, base: pd.DataFrame, own: pd.DataFrame) -> dict[str, float]:
    """Mean error along the way over another method's, with a 95 % bootstrap over pieces."""
    sums = pd.DataFrame(
        {"own": own["along"].abs(), "base": base["along"].abs(), "piece": own["piece"]}
    )
    by_piece = sums.groupby("piece")[["own", "base"]].sum().to_numpy()
    rng = np.random.default_rng(0)
    drawn = by_piece[rng.integers(len(by_piece), size=(DRAWS, len(by_piece)))].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], (0.025, 0.975))
    ratio = by_piece[:, 0].sum() / by_piece[:, 1].sum()
    return {f"over_{name}": ratio, f"over_{name}_low": low, f"over_{name}_high": high}


if __name__ == "__main__":
    shared.command(main)
