"""Scenarios and sensors by name or as objects; scenarios are drawn as a study does."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from olne_bench import plugins
from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.draws import draws_path
from olne_bench.bench.plan.entries import PluginEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.learn import labelled
from olne_bench.envs.scenarios import check_options, checked_seed
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.solved.draws_file import Draws, read_draws
from olne_bench.envs.solved.kept_draws import travelling
from olne_bench.games.model.observation import View
from olne_bench.games.model.sensor import GapsLayer, Layer, NoiseLayer

#: Salt of the suite ``quick``, whose draws and noise are meant unless another suite is named.
SALT = "quick"


@dataclass(frozen=True, eq=False, repr=False)
class DrawnScenario(Scenario):
    """A scenario that knows how it was drawn, so that its noise can be that of a study.

    Attributes:
        entry: name, options and label, as a suite has them.
        seed: number of the draw; a fixed scenario has one draw only.
        salt: salt of the suite that the draw belongs to, which is the suite's name.
    """

    entry: ScenarioEntry = field(kw_only=True)
    seed: int = field(kw_only=True)
    salt: str = field(kw_only=True)

    def __repr__(self) -> str:
        """One line: the scenario and which draw it is."""
        which = f"draw {self.seed} of suite {self.salt!r}; " if self.entry.family else ""
        return f"Scenario({self.entry.label!r}: {which}{self.told!r}; true weights are known)"


def scenario(name: str, seed: int = 0, *, salt: str = SALT, **options: Any) -> DrawnScenario:
    """Draw a scenario: a game with known weights, whose equilibrium is certified.

    Args:
        name: one of ``olne_bench.scenarios()``, or ``path.py:Class``.
        seed: number of the draw. Trials of a study with this seed have the same draw.
        salt: salt of the study. Default: that of the suite ``quick``. With ``"roads"``, and the
            options that the suite ``roads`` has, draws come solved with the package.
        **options: the scenario's own options, such as ``num_players=3``.

    Raises:
        ValueError: on an unknown name or option, with the alternatives, or a seed below 0.
        NoEquilibriumError: where this draw has no certified equilibrium.
    """
    entry, number = scenario_entry(name, options), checked_seed(seed)
    with travelling(_shipped(salt)):
        drawn = true_recording(Draw.of(entry, number, salt)).scenario
    known = {name: getattr(drawn, name) for name in Scenario.__dataclass_fields__}
    return DrawnScenario(**known, entry=entry, seed=number, salt=salt)


def scenario_entry(name: str, options: dict[str, Any] | None = None) -> ScenarioEntry:
    """The entry that a suite would have for a scenario.

    Raises:
        ValueError: as ``scenario``.
    """
    if not isinstance(name, str):
        raise TypeError(f"a scenario is a name or a Scenario, got {name!r}")
    given = options or {}
    plugin = check_options(name, **given)
    return ScenarioEntry(
        name=plugins.absolute(name),
        options=given,
        label=labelled(plugins.label(plugins.SCENARIO, name), given),
        family=plugins.takes_seed(plugin),
    )


@dataclass(frozen=True)
class Place:
    """A scenario to be observed: its entry, the salt of its noise, and one draw or all.

    Attributes:
        entry: names it in tables and seeds its noise.
        salt: seeds its noise, and its draws where there are several.
        draw: the only draw; None if each seed has its own.
    """

    entry: ScenarioEntry
    salt: str
    draw: Draw | None

    def at(self, seed: int) -> Draw:
        """The draw of the trials with a seed."""
        return self.draw or Draw.of(self.entry, seed, self.salt)


def place_of(given: str | Scenario) -> Place:
    """Where to observe a scenario.

    A name stands for the scenario of a study: each seed has its own draw. A scenario that was
    drawn or written stands for itself: seeds differ in the noise only.

    Raises:
        TypeError: on anything else.
        ValueError: on an unknown name, with the alternatives.
    """
    if isinstance(given, DrawnScenario):
        return Place(given.entry, given.salt, Draw.of(given.entry, given.seed, given.salt))
    if isinstance(given, Scenario):
        entry = ScenarioEntry(name=given.name, label=given.name)
        return Place(entry, SALT, Draw.of_object(given))
    return Place(scenario_entry(given), SALT, None)


@lru_cache(maxsize=2)
def _shipped(salt: str) -> Draws | None:
    """The solved draws of a suite that come with the package; None if there are none."""
    path = draws_path(salt) if salt.isidentifier() else None
    return read_draws(path) if path is not None and path.exists() else None


@dataclass(frozen=True)
class ChosenSensor:
    """A sensor: its layers, the innermost first, and its name in tables."""

    layers: tuple[Layer, ...]
    label: str

    @property
    def entry(self) -> SensorEntry:
        """The entry that a suite would have for it."""
        return SensorEntry(label=self.label, layers=(PluginEntry(name=self.label),))


def chosen_sensor(given: Any) -> ChosenSensor:
    """A sensor from a name, an object with ``layers()``, a layer, or a stack of these."""
    if isinstance(given, str):
        made = plugins.make(plugins.SENSOR, given)
        return ChosenSensor(tuple(made.layers()), made.name)
    if isinstance(given, View | NoiseLayer | GapsLayer):
        return ChosenSensor((given,), getattr(given, "name", type(given).__name__))
    if callable(getattr(given, "layers", None)) and not isinstance(given, type):
        return ChosenSensor(tuple(given.layers()), getattr(given, "name", type(given).__name__))
    if isinstance(given, Sequence) and given:
        parts = [chosen_sensor(part) for part in given]
        layers = tuple(layer for part in parts for layer in part.layers)
        return ChosenSensor(layers, "+".join(part.label for part in parts))
    known = ", ".join(plugins.names(plugins.SENSOR))
    raise TypeError(
        f"a sensor is a name ({known}), an object with a method layers(), a view, or a tuple of "
        f"these, got {given!r}"
    )
