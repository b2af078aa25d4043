"""Solutions of forward games, and the evidence for them."""

from dataclasses import dataclass, field

import numpy as np

#: Default certificate tolerance: largest gain of any player, relative to 1 + |J^i|.
CERTIFICATE_TOLERANCE = 1e-7

#: Largest violation of a constraint, in its margin's unit, that a certificate allows.
VIOLATION_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Gains:
    """What each player could gain by deviating alone, as far as it was searched."""

    #: (N,) J^i(equilibrium) - J^i(best response found); about 0 or negative at an equilibrium.
    values: np.ndarray
    starts: np.ndarray  # (N,) number of first plans from which responses were computed
    passed: bool  # whether every player's gain is within the tolerance


@dataclass(frozen=True)
class Certificate:
    """Evidence that no player gains by deviating alone (eqn. nash).

    Each player's best response is computed from several first plans. ``local`` has two, the
    equilibrium and a perturbed one, which leaves saddle points of the player's cost: no small
    change of a plan is better. ``global_so_far`` has those of ``games.solve.far_search``, which are
    far from the equilibrium: none of them leads to a better plan. That is no proof that there is
    none. With constraints, a response has to keep the player's private ones and, against the
    others' motion, the shared ones that look at it.
    """

    costs: np.ndarray  # (N,) J^i at the equilibrium
    tolerance: float  # allowed gain relative to 1 + |J^i|
    #: Gains by nearby plans. They do not pass unless G is zero and the responses converge.
    local: Gains
    global_so_far: Gains | None = None  # gains by plans far away; None if they were not looked for
    #: Largest violation of a constraint, in its margin's unit. Beyond ``VIOLATION_TOLERANCE``
    #: the local part does not pass.
    violation: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether every search that was made passed."""
        return self.local.passed and (self.global_so_far is None or self.global_so_far.passed)

    @property
    def gains(self) -> np.ndarray:
        """(N,) each player's largest gain in any search that was made."""
        if self.global_so_far is None:
            return self.local.values
        return np.asarray(np.maximum(self.local.values, self.global_so_far.values))

    def __str__(self) -> str:
        """One line: what was searched, from how many first plans, and who gains most."""
        far = "not searched" if self.global_so_far is None else self._told(self.global_so_far)
        return f"local: {self._told(self.local)}; global so far: {far}"

    def _told(self, gains: Gains) -> str:
        if np.isnan(gains.values).any():
            return "failed, no root of the first-order conditions"
        player = int(np.argmax(gains.values / (1 + np.abs(self.costs))))
        found = f"{int(gains.starts.sum())} first plans, largest gain {gains.values[player]:.1e}"
        return f"{'passed' if gains.passed else 'failed'}, {found} of player {player}"


def _none() -> np.ndarray:
    return np.zeros((0, 0))


@dataclass(frozen=True)
class Equilibrium:
    """A solution of a forward game."""

    states: np.ndarray  # (T, N, n)
    controls: np.ndarray  # (T-1, N, m)
    #: (T-1, N, n), of each player's own state; what constraints on the next state add to them
    #: is left out (``games.compiled.complementarity``).
    costates: np.ndarray
    residual: float  # max |G|, the complementarity of constraints included
    certificate: Certificate  # evidence; ``certificate.passed`` is False if the solver failed
    #: (T, C) of all margins, in the order of ``game.constraints``; those of a shared constraint
    #: are common to its players. Zero where a margin is not enforced.
    multipliers: np.ndarray = field(default_factory=_none)
    #: (T, C), infinite where they are not enforced. Without constraints, both are empty.
    margins: np.ndarray = field(default_factory=_none)

    def __repr__(self) -> str:
        """One line: its size, the residual, and the evidence for it."""
        steps, players, _ = self.states.shape
        return (
            f"Equilibrium({players} players, {steps} states; residual {self.residual:.1e}; "
            f"{self.certificate})"
        )

    @property
    def active(self) -> np.ndarray:
        """(T, C) which margins are active: their multiplier exceeds them."""
        return self.multipliers > self.margins
