"""All components of the state."""

from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.observation import FullView
from olne_bench.games.model.sensor import Layer


@dataclass(frozen=True)
class Full:
    """Every component of the state, with independent noise."""

    name: ClassVar[str] = "full"

    def layers(self) -> tuple[Layer, ...]:
        """One view."""
        return (FullView(),)
