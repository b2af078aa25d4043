"""Layout of a world's flat observation vectors, so that wrappers can split them.

An observation has one block of d numbers per player, the observer's own first, the others in the
order of their indices, and the time last::

    observation of player_1 of 3:  | player_1 (d) | player_0 (d) | player_2 (d) | time |

In a world without sensors a block is a state; views turn it into what a sensor reports.
"""

from dataclasses import dataclass

import numpy as np


def player_name(index: int) -> str:
    """Name of a player in a world: ``player_0``, ``player_1``, ..."""
    return f"player_{index}"


def player_index(name: str) -> int:
    """Inverse of ``player_name``."""
    return int(name.rpartition("_")[2])


@dataclass(frozen=True)
class ObservationLayout:
    """The layout of an observation vector of N*d + 1 entries.

    It names components as ``games.model.dynamics.Dynamics`` does, so observation models apply to
    blocks as they do to states.

    Attributes:
        state_names: names of the d entries of a block.
        num_players: N.
    """

    state_names: tuple[str, ...]
    num_players: int

    @property
    def state_size(self) -> int:
        """d, the number of entries of a block."""
        return len(self.state_names)

    @property
    def size(self) -> int:
        """Length of an observation vector."""
        return self.num_players * self.state_size + 1

    def order(self, player: str) -> list[int]:
        """Player indices in the order of a player's observation."""
        own = player_index(player)
        return [own, *(i for i in range(self.num_players) if i != own)]

    def blocks(self, observation: np.ndarray) -> np.ndarray:
        """The blocks (N, d) of an observation, the observer's own first."""
        return observation[:-1].reshape(self.num_players, -1)

    def by_index(self, observation: np.ndarray, player: str) -> np.ndarray:
        """The blocks (N, d) of a player's observation in the order of player indices.

        Stacked over time, these are the ``y`` (T, N, d) that estimators take.
        """
        ordered = np.empty((self.num_players, self.state_size), observation.dtype)
        ordered[self.order(player)] = self.blocks(observation)
        return ordered
