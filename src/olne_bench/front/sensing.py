"""Sensors by name or as objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from olne_bench import plugins
from olne_bench.bench.plan.entries import PluginEntry, SensorEntry
from olne_bench.games.model.observation import View
from olne_bench.games.model.sensor import GapsLayer, Layer, NoiseLayer


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
    """A sensor from a name, an object with ``layers()``, a layer, or a stack of these.

    Raises:
        TypeError: on anything else.
        ValueError: on an unknown name, with the alternatives.
    """
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
