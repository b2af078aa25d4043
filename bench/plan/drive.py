"""Drives: the unit of work of a study in which planners drive."""

from dataclasses import dataclass

from olne_bench.bench.plan.draws import DrawsSource
from olne_bench.bench.plan.versions import code_of_drive

#: Planners that need no estimator: the true weights and target speeds, equal weights and middle
#: speeds, others that drive straight on, HighwayEnv's own driver, and a driver that has learned.
ORACLE, UNIFORM, CONSTANT_VELOCITY, STOCK_EGO = "oracle", "uniform", "constant_velocity", "stock"
PPO = "ppo"
OWN_PLANNERS = (ORACLE, UNIFORM, CONSTANT_VELOCITY, STOCK_EGO, PPO)

#: Samples that a window has at least: two states make a game.
LEAST_WINDOW = 2


@dataclass(frozen=True)
class EstimateRules:
    """How an ego uses estimates.

    Attributes:
        window: number of latest samples that count.
        sigma: standard deviation of the noise on positions [m].
        deadline: time [s] in which an estimate has to be there.
        time_limit: time [s] after which a process is killed.
    """

    window: int
    sigma: float
    deadline: float
    time_limit: float


@dataclass(frozen=True)
class DriveTask:
    """One drive.

    Attributes:
        road: one of ``envs.drive.cars.ROADS``.
        traffic: one of ``envs.drive.first_cars.TRAFFIC``.
        weights: how hidden weights are drawn.
        seed: identifies the drive.
        planner: label of the planner.
        reference: name or file of its estimator; empty for ``OWN_PLANNERS``.
        plugin: identifies an estimator that is a plugin; empty for a built-in one.
        rules: how estimates are used.
        salt: seeds noise.
        code: fingerprint of the code that it was made for (``versions.code_of_drive``).
    """

    road: str
    traffic: str
    weights: str
    seed: int
    planner: str
    reference: str
    plugin: str
    rules: EstimateRules
    salt: str
    code: str = ""

    @property
    def key(self) -> tuple[str | int | float, ...]:
        """What a planner's drive has in common with all other planners'."""
        return (self.road, self.traffic, self.weights, self.rules.sigma, self.seed)

    @property
    def home_plugins(self) -> tuple[str, ...]:
        """None: roads and sensors are built in."""
        return ()

    @property
    def guest_plugins(self) -> tuple[str, ...]:
        """The estimator, if it is a plugin."""
        return (self.reference,) if self.plugin else ()

    @property
    def time_limit(self) -> float:
        """Of the rules."""
        return self.rules.time_limit

    @property
    def draws(self) -> DrawsSource | None:
        """None: drives are drawn as they go on."""
        return None

    def code_difference(self) -> str | None:
        """How this process's code differs from the code it was made for; None if it does not."""
        here = code_of_drive(self.reference)
        if here == self.code:
            return None
        return f"the code of drives is {here} in the worker and {self.code} where it was started"
