"""Some components of the state; the paper's partial view."""

from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.observation import ComponentView
from olne_bench.games.model.sensor import Layer


@dataclass(frozen=True)
class Partial:
    """The named components only, by default those of the paper: no speed."""

    name: ClassVar[str] = "partial"
    components: tuple[str, ...] = ("px", "py", "heading")  # names of the components, at least one

    def __post_init__(self) -> None:
        self.layers()

    def layers(self) -> tuple[Layer, ...]:
        """One view."""
        return (ComponentView(self.name, self.components),)
