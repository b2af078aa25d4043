"""Another scenario in a world that is not what estimators are told (``envs.changes``)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from olne_bench.envs.changes import make_change
from olne_bench.envs.changes.change import Departed
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.plugins import SCENARIO, is_built_in


@dataclass(frozen=True)
class Changed:
    """A scenario with a change; estimators are told the scenario without it."""

    name: ClassVar[str] = "changed"
    of: str = "highway"  # name of the scenario
    change: str = "replanning"  # name of the change
    dial: float = 0.8  # how far it goes; 0 is the scenario itself
    options: Mapping[str, Any] = field(default_factory=dict)  # options of the scenario

    def __post_init__(self) -> None:
        from olne_bench.envs.scenarios import check_options  # finds this file

        if self.of == self.name or not is_built_in(SCENARIO, self.of):
            raise ValueError(f"'of' names a built-in scenario other than this, got {self.of!r}")
        make_change(self.change, self.dial)
        check_options(self.of, **self.options)

    def draw(self, seed: int = 0) -> Scenario:
        """The member of a seed."""
        from olne_bench.envs.scenarios import get_scenario

        if not self.dial:
            return get_scenario(self.of, seed, **self.options)
        change, options = make_change(self.change, self.dial), dict(self.options)
        if change.unreported:
            count = get_scenario(self.of, seed, **options).game.num_players
            options["num_players"] = count + change.unreported
        drawn = get_scenario(self.of, seed, **options)
        return replace(change.told(drawn), departure=Departed(change, drawn, seed))
