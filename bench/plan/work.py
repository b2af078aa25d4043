"""Units of work: what an executor hands to a referee process, whatever it is."""

from typing import Protocol, TypeVar

from olne_bench.bench.plan.draws import DrawsSource


class Work(Protocol):
    """A trial, a motion or a drive."""

    @property
    def plugin(self) -> str:
        """Identifies an estimator that is a plugin; empty for a built-in one."""

    @property
    def home_plugins(self) -> tuple[str, ...]:
        """References of plugins that run in the referee's own process."""

    @property
    def guest_plugins(self) -> tuple[str, ...]:
        """References of plugin files that run in processes which the referee starts."""

    @property
    def time_limit(self) -> float:
        """Wall-clock time [s] that a stage of foreign code may take."""

    @property
    def draws(self) -> DrawsSource | None:
        """File that holds its truth, if there is one."""

    def code_difference(self) -> str | None:
        """How this process's code differs from the code it was made for; None if it does not."""


W = TypeVar("W", bound=Work)
