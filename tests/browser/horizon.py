"""Reads the artificial horizon off the screen, as an eye would: how far down the sky reaches, left and right."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

LEFT, RIGHT = 0.36, 0.56
"""Columns, as shares of the display's width, that neither the tapes nor the aircraft symbol cover."""


@dataclass(frozen=True)
class Horizon:
    """Pixels of sky in two columns, and of earth in both, of one screenshot."""

    left_px: int
    right_px: int
    earth_px: int

    def moved_px(self, other: "Horizon") -> int:
        """Return the larger of the two columns' differences."""
        return max(abs(self.left_px - other.left_px), abs(self.right_px - other.right_px))

    @property
    def is_drawn(self) -> bool:
        """True when both sky and earth are in sight."""
        return min(self.left_px, self.right_px, self.earth_px) > 10


def read_horizon(display: Image.Image) -> Horizon:
    """Count blue (sky) and brown (earth) pixels in the two columns."""
    rgb = np.asarray(display, dtype=np.int16)
    red, blue = rgb[..., 0], rgb[..., 2]
    sky, earth = blue > red + 40, red > blue + 15
    columns = [round(share * rgb.shape[1]) for share in (LEFT, RIGHT)]
    left, right = (int(sky[:, column].sum()) for column in columns)
    return Horizon(left_px=left, right_px=right, earth_px=int(earth[:, columns].sum()))
