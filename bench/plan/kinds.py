"""Kinds of studies: what one unit is, by which rules it is run, and what is run beside estimators.

A unit is a ``Trial`` whatever its kind. In a study of trials it is an estimate from a whole
observation, in one of streams an estimate after each sample of it, and in one of drives an ego
drives by what it is told of others.
"""

from typing import Annotated, Any, Literal

from pydantic import Field

from olne_bench.bench.plan.values import Label, Strict

StudyKind = Literal["trials", "streams", "drives"]
#: Figures of a study of trials; all but the first two are drawn of each scenario.
FigureKind = Literal[
    "scores",
    "damage",
    "trial",
    "errors",
    "failures",
    "identifiability",
    "calibration",
    "widths",
    "confusion",
]

#: Driving straight on, going on with the present controls, a policy that was cloned from players of
#: the simulator, HighwayEnv's own drivers on its roads, those fitted to the samples so far, and the
#: true weights.
CONSTANT_VELOCITY, CONSTANT_CONTROLS = "constant_velocity", "constant_controls"
CLONED, STOCK, STOCK_FITTED, TRUE_WEIGHTS = "cloned", "stock", "stock_fitted", "true_weights"
#: Planners that need no estimator: the true weights and target speeds, equal weights and middle
#: speeds, samples of what drivers are like, and a driver that has learned; for others that drive
#: straight on and for HighwayEnv's own driver, see above.
ORACLE, UNIFORM, POPULATION, PPO = "oracle", "uniform", "population", "ppo"
#: How the ego of a drive plans by an estimate: one equilibrium, of plans or of strategies
#: (``envs.drive.feedback_planner``); or for samples of it, with another plan for each after a
#: second, or with one for all (``envs.drive.responding``).
EQUILIBRIUM, FEEDBACK, CONTINGENCY, EXPECTED = "equilibrium", "feedback", "contingency", "expected"
Planning = Literal["equilibrium", "feedback", "contingency", "expected"]

#: What the referee itself compares estimators with; it is run like an estimator of that name.
REFERENCES: dict[StudyKind, tuple[str, ...]] = {
    "trials": (),
    "streams": (CONSTANT_VELOCITY, CONSTANT_CONTROLS, CLONED, STOCK, STOCK_FITTED, TRUE_WEIGHTS),
    "drives": (ORACLE, UNIFORM, POPULATION, CONSTANT_VELOCITY, STOCK, PPO),
}
#: Rules that a kind has.
RULES: dict[StudyKind, tuple[str, ...]] = {
    "trials": ("prior", "noise", "noise_spread"),
    "streams": ("deadline", "lag", "fit_every", "prior", "noise", "noise_spread"),
    "drives": ("deadline", "window", "contrasts"),
}

_Deadline = Annotated[float, Field(ge=1e-3, le=1e6, allow_inf_nan=False, strict=True)]
_Count = Annotated[int, Field(ge=2, le=10**6, strict=True)]
_Factor = Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)]
_Spread = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]


class Rules(Strict):
    """Rules by which units of a study are run."""

    # time [s] in which an estimate has to be there; None: until the next sample
    deadline: _Deadline | None = None
    lag: _Count | None = None  # number of latest samples that count; None: all
    # HighwayEnv's drivers are fitted after every so many samples; None: never
    fit_every: _Count | None = None
    #: pairs of planners that are tested in drives, and no others
    contrasts: tuple[tuple[Label, Label], ...] = Field(default=(), max_length=100)
    window: _Count = 6  # number of latest samples from which the planner of a drive estimates
    # parameter of the Dirichlet prior that estimators are told; None: that of the scenario
    prior: _Factor | None = None
    noise: _Factor = 1.0  # the noise level that they are told, over the true one
    noise_spread: _Spread = 0.0  # standard deviation of its logarithm; 0: it is known

    @property
    def given(self) -> dict[str, Any]:
        """The rules that a suite sets."""
        return self.model_dump(exclude_unset=True)
