"""Check before a run that the sensors of a suite fit its scenarios."""

from itertools import product
from pathlib import Path

import msgspec
import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.referee import layers_of
from olne_bench.bench.plan.entries import ScenarioEntry, SensorEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.run.asking import asked
from olne_bench.envs.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError
from olne_bench.games.dynamics import UNICYCLE
from olne_bench.games.sensor import SensorModel


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
