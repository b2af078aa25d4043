"""Tracks in another frame: mirrored, turned, shifted."""

from dataclasses import dataclass

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Frame:
    """How positions change, in this order; headings follow.

    Attributes:
        flip_y: whether y counts in the other direction.
        rotate: angle [rad] from the x axis towards the y axis.
        shift: [m] in x and y.
    """

    flip_y: bool = False
    rotate: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """The table of tracks in that frame."""
        if self == Frame():
            return table
        sign = -1.0 if self.flip_y else 1.0
        x, y = table["x"], sign * table["y"]
        cos, sin = np.cos(self.rotate), np.sin(self.rotate)
        return table.assign(
            x=cos * x - sin * y + self.shift[0],
            y=sin * x + cos * y + self.shift[1],
            heading=sign * table["heading"] + self.rotate,
        )
