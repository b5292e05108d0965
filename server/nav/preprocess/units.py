"""Raw counts → SI, and from the sensor's own axes to the vehicle's body, before a sample is judged."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import B_MOUNT, B_SCALE, B_ZERO
from server.nav.types import Float

MOUNTINGS: Final = tuple(
    f"{roll}{pitch}{yaw}" or "none"
    for roll in ("", "roll90", "roll180", "roll270")
    for pitch in ("", "pitch90", "pitch180", "pitch270")
    for yaw in ("", "yaw45", "yaw90", "yaw135", "yaw180", "yaw225", "yaw270", "yaw315")
)
"""Names of mountings, as autopilots write them in small letters."""


def mounting_deg(name: str) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw) in degrees of a mounting by name, "roll180yaw90".

    Raises:
        ValueError: no such name.
    """
    text = name.strip().lower().replace("_", "")
    if text not in MOUNTINGS:
        raise ValueError(
            f"{name[:40]!r} is no mounting; take none, or roll, pitch, yaw with multiples of 90 degrees (yaw: of 45)"
            " in this order, as in roll180yaw90"
        )
    angles = dict.fromkeys(("roll", "pitch", "yaw"), 0.0)
    for axis in angles:
        if axis in text:
            rest = text.partition(axis)[2]
            angles[axis] = float(rest[: next((i for i, letter in enumerate(rest) if not letter.isdigit()), len(rest))])
    return angles["roll"], angles["pitch"], angles["yaw"]


def mounting_matrix(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Float:
    """Return R from the sensor's axes to the body, shape (3, 3): R = Rz(yaw) Ry(pitch) Rx(roll).

    The angles say how the sensor is turned against the body: first about down, then right, then forward. Multiples
    of 90 degrees give exact zeros and ones.
    """
    (cr, sr), (cp, sp), (cy, sy) = (_turn(angle) for angle in (roll_deg, pitch_deg, yaw_deg))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)


def _turn(angle_deg: float) -> tuple[float, float]:
    quarter, rest = divmod(angle_deg, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))


@kernel("void(float64[::1], int64, float64[::1], int64)")
def convert(c: Float, block: int, row: Float, first: int) -> None:
    """Convert three numbers in place: mounting · (scale · (counts − zero)).

    Args:
        c: the chain's array.
        block: where the sensor's block begins in it.
        row: the sample; row[first : first + 3] is converted.
    """
    k = c[block + B_SCALE]
    x = k * (row[first] - c[block + B_ZERO])
    y = k * (row[first + 1] - c[block + B_ZERO + 1])
    z = k * (row[first + 2] - c[block + B_ZERO + 2])
    for i in range(3):
        m = block + B_MOUNT + 3 * i
        row[first + i] = c[m] * x + c[m + 1] * y + c[m + 2] * z
