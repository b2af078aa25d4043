"""Transform tracks to another frame: mirror, rotate, shift."""

from dataclasses import dataclass

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Frame:
    """A change of frame, applied in this order; headings change accordingly.

    Attributes:
        flip_y: whether to reverse the direction of y.
        rotate: angle [rad] from the x axis towards the y axis.
        shift: shift in x and y [m].
    """

    flip_y: bool = False
    rotate: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """The table of tracks in the new frame."""
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
