from olne_bench.bench.judge.metrics import formulas as metrics
from olne_bench.catalogue import estimators as estimators
from olne_bench.catalogue import scenarios as scenarios
from olne_bench.catalogue import sensors as sensors
from olne_bench.envs.scenarios.scenario import NoEquilibriumError as NoEquilibriumError
from olne_bench.envs.scenarios.scenario import Scenario as Scenario
from olne_bench.estimators.protocol import Estimate as Estimate
from olne_bench.estimators.protocol import Observation as Observation
from olne_bench.estimators.protocol import Problem as Problem
from olne_bench.front.behaving import behaviours as behaviours
from olne_bench.front.comparing import compare as compare
from olne_bench.front.drawing import scenario as scenario
from olne_bench.front.estimating import estimate as estimate
from olne_bench.front.games import NoRootError as NoRootError
from olne_bench.front.games import fisher_information as fisher_information
from olne_bench.front.games import solve_olne as solve_olne
from olne_bench.front.observing import observe as observe
from olne_bench.front.observing import problem as problem
from olne_bench.front.pooling import estimate_together as estimate_together
from olne_bench.front.pooling import population as population
from olne_bench.front.predicting import predict as predict
from olne_bench.front.studies import read as read
from olne_bench.front.studies import run as run
from olne_bench.front.worlds import parallel_env as parallel_env
from olne_bench.games.model import constraints, costs, dynamics
from olne_bench.games.model import observation as views
from olne_bench.games.model.game import Game as Game
from olne_bench.games.model.game import Player as Player
from olne_bench.games.model.unknowns import Unknown as Unknown
from olne_bench.games.solve.olne import certify as certify

__version__: str
__all__ = [
    "Estimate",
    "Game",
    "NoEquilibriumError",
    "NoRootError",
    "Observation",
    "Player",
    "Problem",
    "Scenario",
    "Unknown",
    "__version__",
    "behaviours",
    "certify",
    "compare",
    "constraints",
    "costs",
    "dynamics",
    "estimate",
    "estimate_together",
    "estimators",
    "fisher_information",
    "metrics",
    "observe",
    "parallel_env",
    "population",
    "predict",
    "problem",
    "read",
    "run",
    "scenario",
    "scenarios",
    "sensors",
    "solve_olne",
    "views",
]
