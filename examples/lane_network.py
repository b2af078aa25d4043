"""Learn a cost that nobody can write down: a small network inside a game of two cars.

    python examples/lane_network.py [--seeds 1] [--figure lane_network.svg]

A driver likes some places across the road more than others. Nobody knows the formula, so the game
holds a tanh network of the lateral position instead. Its 30 parameters are unknown, and so are the
weights of both cars. All are learnt from eight noisy trajectories. Then the learnt game predicts
20 starts that it has not seen, which it knows by a noisy measurement only. So does the game with
the true cost, which is no network.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import matplotlib

matplotlib.use("agg")

import matplotlib.pyplot as plt
import numpy as np

from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.games.model.costs import ControlEffort, Proximity, Stage, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.model.unknowns import Unknown
from olne_bench.games.solve.olne import solve_olne

SIGMA = 0.02  # noise of every component of a state [m, rad, m/s]
WEIGHTS = np.full((2, 4), 0.25)  # the true ones
ROAD = (-0.6, 1.4)  # [m] where the driver may start, across the road
TRAJECTORIES, HELD_OUT, HIDDEN = 8, 20, 10


class OfPlace:
    """A feature of the lateral position ``px`` alone."""

    def running_cost(self, stage: Stage) -> ca.SX:
        return self.cost(stage.own_state("px"))

    def final_cost(self, stage: Stage) -> ca.SX:
        return self.running_cost(stage)


@dataclass(frozen=True)
class Network(OfPlace):
    """``sum_k height_k tanh(slope_k px + shift_k)``; a constant would not change the motion."""

    slopes: tuple[float | Unknown, ...]
    shifts: tuple[float | Unknown, ...]
    heights: tuple[float | Unknown, ...]
    name: str = "lane"

    def cost(self, px: ca.SX) -> ca.SX:
        units = zip(self.slopes, self.shifts, self.heights, strict=True)
        return sum(height * ca.tanh(slope * px + shift) for slope, shift, height in units)


@dataclass(frozen=True)
class Habit(OfPlace):
    """The truth: the left lane (0 m) is liked, the right one (1 m) less; it is no such network."""

    scale: float = 0.3
    width: float = 0.6
    right: float = 0.4
    name: str = "lane"

    def cost(self, px: ca.SX) -> ca.SX:
        left, right = (ca.exp(-(((px - lane) / self.width) ** 2)) for lane in (0.0, 1.0))
        return -self.scale * ca.log(left + self.right * right)


@dataclass(frozen=True)
class Kerb(OfPlace):
    """Everybody knows that one does not drive there."""

    middle: float = 0.4
    half_width: float = 1.2
    name: str = "kerb"

    def cost(self, px: ca.SX) -> ca.SX:
        return ((px - self.middle) / self.half_width) ** 6


def unknown_network() -> Network:
    """A network whose steps are spread over the road, and whose heights are expected near zero.

    Different means keep the hidden units apart. Where all are equal, so are their gradients.
    """
    slope = 3.0

    def unknowns(name: str, means: np.ndarray, deviation: float) -> tuple[Unknown, ...]:
        reach = 10 * deviation
        return tuple(
            Unknown(f"{name} {k}", "1", mean - reach, mean + reach, mean, deviation)
            for k, mean in enumerate(map(float, means))
        )

    return Network(
        slopes=unknowns("slope", np.full(HIDDEN, slope), 1.0),
        shifts=unknowns("shift", -slope * np.linspace(ROAD[0], ROAD[1] + 0.2, HIDDEN), 1.0),
        heights=unknowns("height", np.zeros(HIDDEN), 0.3),
    )


def road(lane: Any) -> Game:
    """Two cars side by side; the first has the lane preference, the second keeps to the right."""

    def player(speed: float, *task: Any) -> Player:
        likes = (
            Proximity(scale=0.15, offset=0.5),
            StateDeviation("speed", target=speed, scale=2.0),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate"),
        )
        return Player(likes, (*task, StateDeviation("heading", target=np.pi / 2, scale=2.0)))

    cars = player(0.4, lane, Kerb()), player(0.25, StateDeviation("px", target=1.8, scale=0.3))
    return Game(cars, UNICYCLE, horizon=16, dt=1.0)


def starts(rng: np.random.Generator, places: np.ndarray) -> np.ndarray:
    """Initial states (B, 2, 4) with the first car at given lateral positions (B,)."""
    count = len(places)
    first = [places, np.zeros(count), rng.uniform(-0.3, 0.3, count), rng.uniform(0.3, 0.5, count)]
    second = [
        rng.uniform(1.6, 2.2, count),
        rng.uniform(-1.0, 1.0, count),
        rng.uniform(-0.2, 0.2, count),
        rng.uniform(0.2, 0.35, count),
    ]
    states = np.stack([np.stack(first, axis=1), np.stack(second, axis=1)], axis=1)
    return states + np.array([0, 0, np.pi / 2, 0])


def motion(game: Game, weights: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (T, 2, 4) of the equilibrium; nothing but game and start are used to find it."""
    found = solve_olne(game, weights, start, search_far=True)
    assert found.certificate.passed
    return found.states


@dataclass(frozen=True)
class Drives:
    """What happened: seen drives, with noise, and held-out ones (B, T, 2, 4), with noisy starts."""

    seen: tuple[Observation, ...]
    held_out: np.ndarray
    noisy_starts: np.ndarray


def drives(seed: int, trajectories: int = TRAJECTORIES, held_out: int = HELD_OUT) -> Drives:
    """Drives by the true cost. The seen ones start evenly spread over the road."""
    rng = np.random.default_rng(seed)
    places = np.concatenate([np.linspace(*ROAD, trajectories), rng.uniform(*ROAD, held_out)])
    truth = road(Habit())
    states = np.array([motion(truth, WEIGHTS, start) for start in starts(rng, places)])
    noisy = states + SIGMA * rng.standard_normal(states.shape)
    seen = tuple(map(Observation, noisy[:trajectories]))
    return Drives(seen, states[trajectories:], noisy[trajectories:, 0])


def learnt(seen: tuple[Observation, ...], *, prior: bool = True) -> tuple[Game, Estimate]:
    """The game with the learnt network, and the estimate with its weights."""
    asked = road(unknown_network())
    problem = Problem(asked, VIEWS["full"], SIGMA)
    method = Bilevel(starts=2, prior=prior)
    found = method.estimate(problem, seen, rng=np.random.default_rng(0), budget=300.0)
    return asked.known(found.parameters), found


def prediction_error(
    game: Game, weights: np.ndarray, true: np.ndarray, from_starts: np.ndarray
) -> float:
    """Mean distance [m] of predicted positions to the true ones (B, T, 2, 4)."""
    predicted = np.array([motion(game, weights, start) for start in from_starts])
    return float(np.linalg.norm((predicted - true)[..., :2], axis=-1).mean())


def main() -> None:
    """Print a line of errors for each seed, and draw the first."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    print("mean distance of predicted to true positions [m], 20 held-out starts with noise")
    print("seed  true cost  learnt  ratio  no prior  no preference  learnt, exact starts  time [s]")
    for seed in range(options.seeds):
        happened = drives(seed)
        started = time.process_time()
        game, found = learnt(happened.seen)
        took = time.process_time() - started
        wild, likeliest = learnt(happened.seen, prior=False)
        indifferent = road(Network((0.0,) * HIDDEN, (0.0,) * HIDDEN, (0.0,) * HIDDEN))
        exact_starts = happened.held_out[:, 0]
        true, learned, no_prior, nothing, exact = (
            prediction_error(one, weights, happened.held_out, known)
            for one, weights, known in (
                (road(Habit()), WEIGHTS, happened.noisy_starts),
                (game, found.weights, happened.noisy_starts),
                (wild, likeliest.weights, happened.noisy_starts),
                (indifferent, found.weights, happened.noisy_starts),
                (game, found.weights, exact_starts),
            )
        )
        print(
            f"{seed:4} {true:10.4f} {learned:7.4f} {learned / true:6.2f} {no_prior:9.4f} "
            f"{nothing:14.4f} {exact:21.4f} {took:9.1f}",
            flush=True,
        )
        if options.figure and seed == 0:
            draw(options.figure, happened, game, found.weights)


def draw(path: Path, happened: Drives, game: Game, weights: np.ndarray) -> None:
    """The learnt preference beside the true one, and held-out drives beside their predictions."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    px = np.linspace(ROAD[0] - 0.2, ROAD[1] + 0.2, 200)
    driven = np.concatenate([one.y[:, 0, 0] for one in happened.seen])
    inside = (px > driven.min()) & (px < driven.max())
    for name, lane, colour, style in (
        ("true", Habit(), "#1f2328", "-"),
        ("learnt", game.players[0].task[0], "#D55E00", "--"),
    ):
        cost = np.array([float(lane.cost(place)) for place in px])
        left.plot(px, cost - cost[inside].mean(), style, color=colour, label=name)
    left.plot(driven, np.full(driven.size, 0.02), "|", color="#6b6b6b", clip_on=False,
              transform=left.get_xaxis_transform(), label="seen there")  # fmt: skip
    left.set(xlabel="lateral position [m]", ylabel="cost of a step")
    left.legend(frameon=False)
    for true, start in list(zip(happened.held_out, happened.noisy_starts, strict=True))[:6]:
        predicted = motion(game, weights, start)
        right.plot(true[:, 0, 1], true[:, 0, 0], "-", color="#1f2328", linewidth=1)
        right.plot(predicted[:, 0, 1], predicted[:, 0, 0], "--", color="#D55E00")
        right.plot(start[0, 1], start[0, 0], "o", color="#6b6b6b", markersize=4)
    right.set(xlabel="along the road [m]", ylabel="lateral position [m]")
    right.legend(*[right.lines[:3], ["true", "predicted", "start, measured"]], frameon=False)
    figure.savefig(path)
    plt.close(figure)


if __name__ == "__main__":
    main()
