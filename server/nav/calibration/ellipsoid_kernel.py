"""The streaming accumulator's inner loop: each sample adds to the moments of its small cube of the sensor's space.

Moments up to the fourth order are all that the 10 × 10 normal equations of a quadric hold (35 numbers). They are kept
per cube, so that outliers can still be left out, and coverage judged, after the samples themselves are gone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.kernel import kernel
from server.nav.types import Float, Int

CUBES: Final = 1500
"""Most cubes held: on a sphere then about a ninth of its radius wide. When they are used up, all grow by √2."""
TABLE: Final = 8192  # slots of the hash table: a power of two, well above CUBES
MOMENTS: Final = 35
SUMS: Final = 36  # the moments, then Σ|raw|
HUGE: Final = 1.0e30  # no sensor's reading; its fourth power is still a number
INDEX_LIMIT: Final = 4.0e15  # a coordinate this many cubes away cannot be told apart in a float64

# Extremes, one row per axis and side (−x, +x, −y, …): value, how often, then min and max of the two other axes there.
E_VALUE, E_COUNT, E_MIN_A, E_MAX_A, E_MIN_B, E_MAX_B, E_SIZE = 0, 1, 2, 3, 4, 5, 6


@kernel("void(float64, float64, float64, float64[::1])", contract=True, inline=True)
def add_moments(x: float, y: float, z: float, out: Float) -> None:
    """Add the monomials up to order 4, graded: 1, x, y, z, xx, xy, xz, yy, yz, zz, xxx, …, zzzz; shape (36,)."""
    xx, xy, xz, yy, yz, zz = x * x, x * y, x * z, y * y, y * z, z * z
    yyy, yyz, yzz, zzz = y * yy, y * yz, y * zz, z * zz
    out[0] += 1.0
    out[1] += x
    out[2] += y
    out[3] += z
    out[4] += xx
    out[5] += xy
    out[6] += xz
    out[7] += yy
    out[8] += yz
    out[9] += zz
    out[10] += x * xx
    out[11] += x * xy
    out[12] += x * xz
    out[13] += x * yy
    out[14] += x * yz
    out[15] += x * zz
    out[16] += yyy
    out[17] += yyz
    out[18] += yzz
    out[19] += zzz
    out[20] += xx * xx
    out[21] += xx * xy
    out[22] += xx * xz
    out[23] += xx * yy
    out[24] += xx * yz
    out[25] += xx * zz
    out[26] += x * yyy
    out[27] += x * yyz
    out[28] += x * yzz
    out[29] += x * zzz
    out[30] += yy * yy
    out[31] += yy * yz
    out[32] += yy * zz
    out[33] += yz * zz
    out[34] += zz * zz


@kernel("void(float64, float64, float64, float64, float64[::1])", inline=True)
def note_extreme(value: float, a: float, b: float, sign: float, row: Float) -> None:
    """Keep the extreme of one axis, how often it was hit exactly, and how wide the others were there."""
    if value * sign < row[0] * sign:
        return
    if value != row[0]:
        row[0], row[1], row[2], row[3], row[4], row[5] = value, 1.0, a, a, b, b
        return
    row[1] += 1.0
    row[2], row[3] = min(row[2], a), max(row[3], a)
    row[4], row[5] = min(row[4], b), max(row[5], b)


@kernel("void(float64, float64, float64, float64[::1])", inline=True)
def note_roughness(x: float, y: float, z: float, rough: Float) -> None:
    """Add the length of the second difference (white noise has plenty, a slow change of the field none)."""
    dx, dy, dz = x - 2.0 * rough[0] + rough[3], y - 2.0 * rough[1] + rough[4], z - 2.0 * rough[2] + rough[5]
    length = (dx * dx + dy * dy + dz * dz) ** 0.5
    if length < np.inf:  # false for the first two samples, whose past is NaN
        rough[6] += length
        rough[7] += 1.0
    rough[3], rough[4], rough[5] = rough[0], rough[1], rough[2]
    rough[0], rough[1], rough[2] = x, y, z


@kernel("int64(int64, int64, int64, int64[::1], int64[:,::1])")
def find_slot(kx: int, ky: int, kz: int, table: Int, keys: Int) -> int:
    """Return the hash slot that holds this cube, or the free one where it belongs."""
    slot = ((kx * 73856093) ^ (ky * 19349663) ^ (kz * 83492791)) * 2654435761
    slot = (slot >> 15) & (TABLE - 1)
    while table[slot] >= 0:
        at = table[slot]
        if keys[at, 0] == kx and keys[at, 1] == ky and keys[at, 2] == kz:
            break
        slot = (slot + 1) & (TABLE - 1)
    return int(slot)


@kernel(
    "int64(float64[:,::1], int64, float64[::1], float64, int64[::1], int64[:,::1], float64[:,::1], float64[:,::1], "
    "float64[:,::1], int64[::1], float64[::1])",
    contract=True,
)
def accumulate(
    xyz: Float,
    start: int,
    zero: Float,
    width: float,
    table: Int,
    keys: Int,
    origins: Float,
    sums: Float,
    extremes: Float,
    counts: Int,
    rough: Float,
) -> int:
    """Take samples from `start` on; return the row at which a new cube found no room, or their number when done.

    Args:
        xyz: shape (n, 3), raw; non-finite rows and rows out of any range are counted and left out.
        start: first row to take.
        zero: shape (3,), corner of the cube (0, 0, 0); width: of all cubes.
        table: shape (TABLE,), cube of each slot, −1 free. keys: shape (CUBES, 3), place of each cube.
        origins: shape (CUBES, 3), the first sample in each cube, about which its moments are taken.
        sums: shape (CUBES, SUMS).
        extremes: shape (6, E_SIZE).
        counts: shape (3,): cubes in use, samples taken, samples left out.
        rough: shape (8,): the last two samples, then Σ|second difference| and its count.
    """
    inverse = 1.0 / width
    last, lx, ly, lz = -1, 0, 0, 0
    for i in range(start, len(xyz)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        fx, fy, fz = (x - zero[0]) * inverse, (y - zero[1]) * inverse, (z - zero[2]) * inverse
        if not (
            abs(fx) < INDEX_LIMIT
            and abs(fy) < INDEX_LIMIT
            and abs(fz) < INDEX_LIMIT
            and abs(x) + abs(y) + abs(z) < HUGE
        ):
            counts[2] += 1
            continue
        kx, ky, kz = int(fx // 1.0), int(fy // 1.0), int(fz // 1.0)
        if last < 0 or kx != lx or ky != ly or kz != lz:
            slot = find_slot(kx, ky, kz, table, keys)
            last = table[slot]
            if last < 0:
                if counts[0] >= keys.shape[0]:
                    return i
                last = counts[0]
                counts[0] += 1
                table[slot] = last
                keys[last, 0], keys[last, 1], keys[last, 2] = kx, ky, kz
                origins[last, 0], origins[last, 1], origins[last, 2] = x, y, z
            lx, ly, lz = kx, ky, kz
        counts[1] += 1
        row = sums[last]
        add_moments(x - origins[last, 0], y - origins[last, 1], z - origins[last, 2], row)
        row[35] += (x * x + y * y + z * z) ** 0.5
        note_roughness(x, y, z, rough)
        note_extreme(x, y, z, -1.0, extremes[0])
        note_extreme(x, y, z, 1.0, extremes[1])
        note_extreme(y, x, z, -1.0, extremes[2])
        note_extreme(y, x, z, 1.0, extremes[3])
        note_extreme(z, x, y, -1.0, extremes[4])
        note_extreme(z, x, y, 1.0, extremes[5])
    return len(xyz)
