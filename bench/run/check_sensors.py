"""Check before a run that the sensors of a suite fit its scenarios, and both its kind."""

from contextlib import suppress
from itertools import product
from pathlib import Path

import msgspec
import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.trials import layers_of
from olne_bench.bench.plan.entries import ScenarioEntry, SensorEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.run.ask_child import asked
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.sensor import SensorModel


class Fit(msgspec.Struct):
    """What is wrong with a sensor in a scenario; empty if nothing is."""

    problem: str


def check_fit(suite: Suite, hidden: Path | None = None) -> None:
    """Refuse sensors that do not fit a scenario, such as one for a component that states lack.

    Args:
        suite: suite to be run.
        hidden: folder that foreign code cannot read.

    Raises:
        UserError: with a message that names the first such pair.
    """
    for scenario, sensor in product(suite.scenarios, suite.sensors):
        foreign = foreign_worlds(scenario, sensor)
        if not foreign:
            problem = _problem(sensor, None)
        else:
            found = asked(fit, scenario, sensor, kind=Fit, plugins=foreign, hidden=hidden)
            problem = found.problem if found else ""
        if problem:
            raise UserError(
                f"suite {suite.name!r}: sensor {sensor.label!r} does not fit scenario "
                f"{scenario.label!r}: {problem}"
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
    from olne_bench.envs.drive.cars import ROADS, STEPS, WEIGHTS
    from olne_bench.envs.drive.world import TRAFFIC

    known = {"traffic": TRAFFIC, "weights": WEIGHTS}
    for road in suite.scenarios:
        if road.name not in ROADS or road.trajectories > 1:
            raise UserError(
                f"scenario {road.label!r}: drives are on one of {', '.join(ROADS)}, with one "
                "trajectory"
            )
        for name, value in road.options.items():
            if value not in known.get(name, ()):
                choice = "; ".join(f"{key}: {', '.join(of)}" for key, of in known.items())
                raise UserError(
                    f"scenario {road.label!r}: option {name} = {value!r}; drives have {choice}"
                )
    for sensor in suite.sensors:
        if [layer.name for layer in sensor.layers] != ["full"]:
            raise UserError(f"sensor {sensor.label!r}: in a study of drives it is 'full'")
    if suite.rules.window > STEPS:
        raise UserError(f"rule window = {suite.rules.window}: a drive has {STEPS} samples")


def _check_lag(scenario: ScenarioEntry, lag: int) -> None:
    with suppress(NoEquilibriumError):  # another draw may be played
        samples = get_scenario(scenario.name, 0, **scenario.options).game.horizon
        if lag > samples:  # all draws have as many
            raise UserError(
                f"rule lag = {lag}: a motion of scenario {scenario.label!r} has {samples} samples; "
                "use fewer, or no lag for all so far"
            )


def fit(scenario: ScenarioEntry, sensor: SensorEntry) -> Fit:
    """What is wrong with a sensor in a scenario, found in this process."""
    if plugins.is_built_in(plugins.SCENARIO, scenario.name):
        return Fit(_problem(sensor, None))
    return Fit(_problem(sensor, scenario))


def _problem(sensor: SensorEntry, scenario: ScenarioEntry | None) -> str:
    """The problem on one line; without a scenario, for the states of built-in scenarios.

    Their states all have the same components, and a draw may take long, as it is solved and
    certified.
    """
    dynamics, scale = UNICYCLE, np.ones(UNICYCLE.state_size)
    if scenario is not None:
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
