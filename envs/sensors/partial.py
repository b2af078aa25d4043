"""Some components of the state; the paper's partial view."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.observation import ComponentView
from olne_bench.games.model.sensor import Layer


@dataclass(frozen=True)
class Partial:
    """The named components only, by default those of the paper: no speed.

    Attributes:
        components: names of the components, at least one.

    Raises:
        ValueError: if these are not different names.
    """

    name: ClassVar[str] = "partial"
    components: Sequence[str] = ("px", "py", "heading")

    def __post_init__(self) -> None:
        chosen = self.components
        is_list = isinstance(chosen, list | tuple) and all(isinstance(one, str) for one in chosen)
        if not (is_list and chosen and len(set(chosen)) == len(chosen)):
            raise ValueError(f"components must be a list of different names, got {chosen!r}")

    def layers(self) -> tuple[Layer, ...]:
        """One view."""
        return (ComponentView(self.name, tuple(self.components)),)
