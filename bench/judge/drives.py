"""The referee of drives: an ego among others, whose planner sees noisy samples of them.

Drives are paired: all planners begin at the same start, and the same cars have the same noise. What
the ego does changes what the others do.
"""

import gc
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from time import perf_counter
from typing import Any

import msgspec
import numpy as np

from olne_bench.bench.judge.beliefs import (
    Beliefs,
    EstimatedBeliefs,
    EstimateRules,
    PopulationBeliefs,
    TrueBeliefs,
    UniformBeliefs,
)
from olne_bench.bench.judge.learned_driver import LearnedDriver
from olne_bench.bench.judge.players import PlayerTask, Staff, StreamPlayer
from olne_bench.bench.judge.seeds import stream
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.kinds import (
    CONSTANT_VELOCITY,
    CONTINGENCY,
    EXPECTED,
    FEEDBACK,
    ORACLE,
    POPULATION,
    PPO,
    STOCK,
)
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.text import clip
from olne_bench.envs.drive.cars import ROADS, STEP, Car, EgoCost, prior_of
from olne_bench.envs.drive.ego_seen import AverageEgo
from olne_bench.envs.drive.feedback_planner import FeedbackPlanner
from olne_bench.envs.drive.planner import (
    CONSTRAINED,
    EgoPlan,
    GamePlanner,
    Planner,
    StraightOnPlanner,
)
from olne_bench.envs.drive.responding import RespondingPlanner
from olne_bench.envs.drive.setting import KNOWN, THROUGH, DriveSetting
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.drive.world import DriveWorld, seen
from olne_bench.envs.roads.footprint import gap
from olne_bench.estimators.protocol import Problem

#: How far ahead predictions are scored [s].
AHEAD = (1.0, 2.0, 3.0)
ERROR_COLUMNS = tuple(f"fde_{ahead:g}s" for ahead in AHEAD)
_CYCLES = (50, 95, 99)

#: Steps that an update may spend: it counts late then, and is worth little after that.
_BUDGET = 2
#: Time [s] for a drive, beside twice that after which a player is killed: its first plans may have
#: to wait for a compiler.
_DRIVE_SECONDS = 1200.0


@dataclass(frozen=True)
class DriveRow:
    """What became of one drive.

    With another status than ``ok`` there were no further estimates from some time on, and the ego
    drove on with what it had.
    """

    status: str  # skipped if no start was found or the estimator declines, else of ``STATUSES``
    message: str = ""
    collision: bool | None = None  # of the ego
    collision_time: float | None = None  # [s]
    collision_speed: float | None = None  # relative to what the ego hit [m/s]
    value: float | None = None  # of information, in an encounter (``envs.drive.information``)
    cost: float | None = None  # mean over the steps, 0 to 1 (``EgoCost``)
    progress: float | None = None  # way that the ego drove [m]
    jerk: float | None = None  # of the ego, root mean square [m/s^3]
    gap: float | None = None  # smallest one to another car [m]
    #: percentiles of the time of a cycle [ms]: the estimate up to the deadline, then the plan
    cycle_50: float | None = None
    cycle_95: float | None = None
    cycle_99: float | None = None
    fallback: float | None = None  # share of cycles without a plan that keeps the distance
    late: float | None = None  # share of samples whose estimate was late
    failed: float | None = None  # share of samples without a valid estimate
    #: mean distance [m] between predicted and driven positions, by column
    errors: dict[str, float] = field(default_factory=dict)
    plans_solved: int | None = None  # plans of the others (``PlanCounts``)
    plans_apart: int | None = None
    plans_kept: int | None = None
    plans_braked: int | None = None
    entered: int | None = None  # other cars that came
    left: int | None = None  # other cars that went
    others_collided: int | None = None  # without the ego


#: Sees each step before it is driven: the world, and the ego's plan if it has one.
Watch = Callable[[DriveWorld, EgoPlan | None], None]


def setting(scenario: ScenarioEntry) -> DriveSetting:
    """What the drives of a scenario have in common."""
    return DriveSetting(scenario.name, **scenario.options)


def judge(trial: Trial, staff: Staff) -> Outcome:
    """Judge a drive; its row is JSON text in ``extras``. A seed without a start is ``skipped``."""
    staff.announce("drive", _DRIVE_SECONDS + 2 * trial.time_limit)
    try:
        row = driven(trial, staff.player)
    except NoDriveError as error:
        return Outcome("skipped", clip(str(error)))
    return Outcome(row.status, row.message, extras=msgspec.json.encode(asdict(row)).decode())


def driven(trial: Trial, player: StreamPlayer, watch: Watch | None = None) -> DriveRow:
    """Let a planner drive, or raise ``NoDriveError`` if the seed has no start."""
    drive = _Drive(trial, player)
    while not drive.world.over:
        drive.cycle(watch)
    if watch is not None:
        watch(drive.world, None)
    return drive.row()


class _Drive:
    """One drive and its log."""

    def __init__(self, trial: Trial, player: StreamPlayer) -> None:
        self._trial = trial
        stock = trial.reference == STOCK
        self.world = DriveWorld(setting(trial.scenario), trial.seed, stock_ego=stock)
        self._noise = stream(trial.salt, "drive", *_paired(trial))
        self._beliefs = _beliefs(trial, player)
        self._beliefs.ready(seen(self.world, trial.sigma, self._rng)[0])
        self._planner = _planner(trial, self.world.cars[0])
        self._driver = LearnedDriver(self.world.cars[0]) if trial.reference == PPO else None
        self._cost = EgoCost(self.world.cars[0])
        self._motion: list[dict[int, np.ndarray]] = []
        self._controls: list[np.ndarray] = []
        self._plans: list[EgoPlan] = []
        self._cycles: list[float] = []
        # Else a cycle waits for 0.1 s while what the start has left is looked through.
        gc.unfreeze()
        gc.collect()
        gc.freeze()

    def cycle(self, watch: Watch | None) -> None:
        """See the others, plan, and drive a step."""
        world, states = self.world, self.world.states()
        self._motion.append(_by_number(world.cars, states))
        plan, control = None, None
        if self._trial.reference != STOCK:
            cars, samples = seen(world, self._trial.sigma, self._rng)
            began = perf_counter()
            plan, control = self._planned(cars, samples)
            self._cycles.append(perf_counter() - began - self._beliefs.beyond)
        if watch is not None:
            watch(world, plan)
        world.advance(control)
        self._controls.append(world.ego_control(states[0]) if control is None else control)

    def _rng(self, car: Car) -> np.random.Generator:
        """Draws the noise of a car at this step."""
        return np.random.default_rng([self._noise, self.world.step, car.number])

    def _planned(self, cars: list[Car], samples: np.ndarray) -> tuple[EgoPlan | None, np.ndarray]:
        """What the ego does next (2,), and the plan that it is a part of if there is one."""
        if self._driver is not None:
            return None, self._driver.control(samples)
        self._beliefs.see(cars, samples)
        minds = self._beliefs.minds(cars)
        sampled = _planning(self._trial) in (CONTINGENCY, EXPECTED)
        if isinstance(self._planner, RespondingPlanner) and sampled:
            plan = self._planner.plan(minds, samples, self._beliefs.samples(cars))
        else:
            plan = self._planner.plan(minds, samples)
        self._plans.append(plan)
        return plan, plan.control

    def row(self) -> DriveRow:
        """The row, once the drive is over."""
        world = self.world
        self._motion.append(_by_number(world.cars, world.states()))
        motion = [np.stack(list(states.values())) for states in self._motion]
        speeds = np.array([states[0, 3] for states in motion])
        way = np.diff([states[0, :2] for states in motion], axis=0)
        fault = getattr(self._beliefs, "fault", None)
        counts = world.counts
        return DriveRow(
            status="ok" if fault is None else fault.status,
            message="" if fault is None else clip(str(fault)),
            collision=world.crashed,
            collision_time=world.step * STEP if world.crashed else None,
            collision_speed=world.collision_speed,
            value=world.value,
            cost=self._cost.of_drive(motion, self._controls, world.crashed, world.setting.steps),
            progress=float(np.linalg.norm(way, axis=1).sum()),
            jerk=float(np.sqrt(np.mean((np.diff(speeds, 2) / STEP**2) ** 2)))
            if len(speeds) > 2
            else None,
            gap=self._smallest_gap(motion),
            **self._shares(),
            errors=prediction_errors(self._plans, self._motion),
            **{f"plans_{what}": count for what, count in asdict(counts.plans).items()},
            entered=counts.entered,
            left=counts.left,
            others_collided=counts.collided,
        )

    def _smallest_gap(self, motion: list[np.ndarray]) -> float | None:
        if self.world.crashed and not self.world.at_lane_end:
            return 0.0
        found = [gap(states[0], states[1:]).min() for states in motion if len(states) > 1]
        return float(min(found)) if found else None

    def _shares(self) -> dict[str, Any]:
        """Times of cycles, and shares of what went wrong in them."""
        if not self._cycles:
            return {}
        cycles = np.percentile(1e3 * np.array(self._cycles), _CYCLES)
        shares: dict[str, Any] = {
            f"cycle_{level}": float(value) for level, value in zip(_CYCLES, cycles, strict=True)
        }
        if self._plans:
            shares["fallback"] = float(np.mean([plan.kind != CONSTRAINED for plan in self._plans]))
        if isinstance(self._beliefs, EstimatedBeliefs):
            updates = max(1, self._beliefs.updates)
            shares["late"] = self._beliefs.late / updates
            shares["failed"] = self._beliefs.failed / updates
        return shares


def _paired(trial: Trial) -> tuple[str | float, ...]:
    """What a planner's drive has in common with all other planners'."""
    known = setting(trial.scenario)
    more = () if known.scene == THROUGH else (known.scene,)
    return known.road, known.traffic, known.weights, *more, trial.sigma, trial.seed


def _beliefs(trial: Trial, player: StreamPlayer) -> Beliefs:
    road, prior = ROADS[trial.scenario.name], prior_of(setting(trial.scenario).weights)
    if trial.reference == ORACLE:
        return TrueBeliefs()
    if trial.reference == POPULATION:
        return PopulationBeliefs(road, prior)
    if trial.reference:
        return UniformBeliefs(road)
    rules = EstimateRules(trial.rules.window, trial.sigma, trial.rules.deadline or STEP)
    return EstimatedBeliefs(player, partial(_asked, trial, rules), road, rules, prior)


def _planner(trial: Trial, ego: Car) -> Planner:
    """How the ego plans."""
    known, straight_on = setting(trial.scenario), trial.reference == CONSTANT_VELOCITY
    if trial.estimator.planning == FEEDBACK:
        return FeedbackPlanner()
    if known.ego == KNOWN:
        return StraightOnPlanner() if straight_on else GamePlanner()
    road, contingent = ROADS[known.road], _planning(trial) == CONTINGENCY
    seen = AverageEgo(road)
    return RespondingPlanner(road, ego, seen, straight_on=straight_on, contingent=contingent)


def _planning(trial: Trial) -> str | None:
    """How the ego uses what it is not sure of; who knows the population alone is never sure.

    The oracle expects to respond after a second, too: else it waits for longer than it has to.
    """
    usual = CONTINGENCY if trial.reference in (POPULATION, ORACLE) else None
    return trial.estimator.planning or usual


def _asked(trial: Trial, rules: EstimateRules, problem: Problem) -> PlayerTask:
    label = trial.estimator.label
    seed = stream(trial.salt, "estimator of a drive", *_paired(trial), label)
    budget = _BUDGET * STEP
    return PlayerTask.of(trial, problem, seed, lag=rules.window, budget=budget)


def _by_number(cars: list[Car], states: np.ndarray) -> dict[int, np.ndarray]:
    return {car.number: state for car, state in zip(cars, states, strict=True)}


def prediction_errors(
    plans: list[EgoPlan], motion: list[dict[int, np.ndarray]]
) -> dict[str, float]:
    """Mean distance [m] of others from where the ego expected them, by column."""
    errors: dict[str, float] = {}
    for ahead, column in zip(AHEAD, ERROR_COLUMNS, strict=True):
        steps = round(ahead / STEP)
        found = [
            float(np.linalg.norm(plan.states[steps, place, :2] - later[number][:2]))
            for plan, later in zip(plans, motion[steps:], strict=False)
            for place, number in enumerate(plan.numbers)
            if place and number in later and steps < len(plan.states)
        ]
        if found:
            errors[column] = float(np.mean(found))
    return errors
