"""Check before a run that the parts of a suite fit each other and its kind."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.observe import layers_of
from olne_bench.bench.judge.priors import WITH_PRIOR, exclusion, prior_told
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.kinds import CONTINGENCY, EXPECTED, Rules
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.run.describe_plugins import LOAD_LIMIT, LOAD_MEMORY
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.sensor import SensorModel


def check_fit(suite: Suite, hidden: Path | None = None) -> None:
    """Refuse sensors that do not fit a scenario, such as one for a component that states lack.

    Raises:
        UserError: with a message that names the first such pair.
    """
    for scenario, sensor in product(suite.scenarios, suite.sensors):
        foreign = foreign_worlds(scenario, sensor)
        if problem := _asked(foreign, hidden, misfit, scenario, sensor):
            raise UserError(
                f"suite {suite.name!r}: sensor {sensor.label!r} does not fit scenario "
                f"{scenario.label!r}: {problem}"
            )


def check_priors(suite: Suite, hidden: Path | None = None) -> None:
    """Refuse priors that give the truth of a fixed scenario no mass.

    Truths that seeds draw are known when they are judged: such a trial is ``invalid``.

    Raises:
        UserError: with a message that names the first such pair, the weight, and what to do.
    """
    for scenario, estimator in suite.pairs():
        if scenario.family or estimator.name not in WITH_PRIOR:
            continue
        own = plugins.is_built_in(plugins.SCENARIO, scenario.name)
        foreign = () if own else (scenario.name, estimator.name)
        if why := _asked(foreign, hidden, excluded, scenario, estimator, suite.rules):
            raise UserError(
                f"suite {suite.name!r}: estimator {estimator.label!r} cannot be run in scenario "
                f"{scenario.label!r}: {why}; choose an alpha nearer to 1, or limit the estimator "
                "to other scenarios (key 'scenarios')"
            )


def check_kind(suite: Suite) -> None:
    """Refuse what cannot be run one sample at a time in a study of streams, or driven in others.

    Raises:
        UserError: in streams on several trajectories, on scenarios and sensors that are plugins,
            and on a lag longer than a motion; in drives on scenarios that are no roads, on unknown
            options of roads, on sensors but ``full``, and on a window longer than a drive.
    """
    if suite.kind == "drives":
        _check_drives(suite)
    if suite.kind != "streams":
        return
    for scenario, sensor in product(suite.scenarios, suite.sensors):
        if scenario.trajectories > 1:
            raise UserError(
                f"scenario {scenario.label!r} has {scenario.trajectories} trajectories; in a study "
                "of streams there is one motion at a time"
            )
        if foreign := foreign_worlds(scenario, sensor):
            raise UserError(
                f"{foreign[0]!r} is a plugin; in a study of streams, scenarios and sensors are "
                "built-in ones"
            )
    for scenario in suite.scenarios if suite.rules.lag else ():
        _check_lag(scenario, suite.rules.lag or 0)


def _check_drives(suite: Suite) -> None:
    # It imports HighwayEnv, which takes longer than all else.
    from olne_bench.envs.drive.cars import ROADS
    from olne_bench.envs.drive.setting import OPTIONS

    for road in suite.scenarios:
        if road.name not in ROADS or road.trajectories > 1:
            raise UserError(
                f"scenario {road.label!r}: drives are on one of {', '.join(ROADS)}, with one "
                "trajectory"
            )
        for name, value in road.options.items():
            if value not in OPTIONS.get(name, ()):
                choice = "; ".join(f"{key}: {', '.join(of)}" for key, of in OPTIONS.items())
                raise UserError(
                    f"scenario {road.label!r}: option {name} = {value!r}; drives have {choice}"
                )
        _check_drive(suite, road)
    for sensor in suite.sensors:
        if [layer.name for layer in sensor.layers] != ["full"]:
            raise UserError(f"sensor {sensor.label!r}: in a study of drives it is 'full'")


def _check_drive(suite: Suite, road: ScenarioEntry) -> None:
    """Check the setting of a road's drives, and what is asked of their planners."""
    from olne_bench.envs.drive.setting import KNOWN, DriveSetting

    try:
        setting = DriveSetting(road.name, **road.options)
    except ValueError as error:
        raise UserError(f"scenario {road.label!r}: {error}") from error
    if suite.rules.window > setting.steps:
        raise UserError(f"rule window = {suite.rules.window}: a drive has {setting.steps} samples")
    hedged = (entry for entry in suite.estimators if entry.planning in (CONTINGENCY, EXPECTED))
    planning = next(hedged, None)
    if planning is not None and setting.ego == KNOWN:
        raise UserError(
            f"estimator {planning.label!r} has planning = {planning.planning!r}, which needs "
            f"others that do not know the ego; scenario {road.label!r} has ego = {KNOWN!r}"
        )


def _check_lag(scenario: ScenarioEntry, lag: int) -> None:
    with suppress(NoEquilibriumError):  # another draw may be played
        samples = get_scenario(scenario.name, 0, **scenario.options).game.horizon
        if lag > samples:  # all draws have as many
            raise UserError(
                f"rule lag = {lag}: a motion of scenario {scenario.label!r} has {samples} samples; "
                "use fewer, or no lag for all so far"
            )


def _asked(
    foreign: Sequence[str], hidden: Path | None, function: Callable[..., str], *about: Any
) -> str:
    """What a function says, in its own process where foreign code takes part; StartError."""
    if not foreign:
        return function(*about)
    child = Child(restricted=True, memory=LOAD_MEMORY, plugins=foreign, hidden=hidden)
    try:
        return str(child.call(function, *about, kind=str, seconds=LOAD_LIMIT))
    except StartError:
        raise
    except (ChildError, RaisedError, UserError):
        return ""  # a draw that fails there is shown by the trials
    finally:
        child.stop()


def excluded(scenario: ScenarioEntry, estimator: EstimatorEntry, rules: Rules) -> str:
    """Why the prior of an estimator excludes the truth of a scenario; empty if it does not."""
    try:
        drawn = get_scenario(scenario.name, **scenario.options)
        return exclusion(estimator, drawn, prior_told(drawn, rules))
    except NoEquilibriumError:
        return ""


def misfit(scenario: ScenarioEntry, sensor: SensorEntry) -> str:
    """What is wrong with a sensor in a scenario, on one line; empty if nothing is."""
    dynamics, scale = UNICYCLE, np.ones(UNICYCLE.state_size)
    # States of built-in scenarios all have the same components, and a draw may take long.
    if not plugins.is_built_in(plugins.SCENARIO, scenario.name):
        try:
            drawn = get_scenario(scenario.name, 0, **scenario.options)
        except NoEquilibriumError:
            return ""
        dynamics, scale = drawn.game.dynamics, np.asarray(drawn.noise_scale)
    try:
        SensorModel.of(layers_of(sensor), dynamics, scale)
    except ValueError as error:
        return " ".join(str(error).split())
    return ""
