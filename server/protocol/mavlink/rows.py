"""Compiled helpers of the decoder: writing rows, choosing among sources, reading integers at any offset."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.nav.types import Kind
from server.protocol.mavlink.layout import (
    AUTOPILOT_ARDUPILOT,
    NONE,
    RANK_BEST,
    S_AUTOPILOT,
    S_BOOT,
    S_BOOT_FIRST_SLOT,
    S_HAS_AIRSPEED,
    S_IMU_SOURCE,
    S_PROFILE,
    S_ROWS,
    S_SUSPECTS,
    S_T_FIRST,
    S_TYPE,
)

# Rows of the heads (int64), one column per sample row.
H_KIND: Final = 0
H_T: Final = 1
H_BOOT: Final = 2
HEADS: Final = 3

# How long lesser sources wait for a better one after the first stamp of a power-up, and how long the better one may be
# silent before they take over: in board time, so that it depends on the bytes only.
HOLD_NS: Final = 500_000_000
SOURCE_SILENT_NS: Final = 2_000_000_000

KIND_PROFILE: Final = int(Kind.PROFILE)

# MAV_TYPE → VehicleClass; every other type is UNKNOWN, which takes the general parameters. VTOL types stay unknown:
# they fly both ways.
CLASS_OF_TYPE: Final = np.zeros(256, np.int64)
CLASS_OF_TYPE[[2, 3, 4, 13, 14, 15, 29, 35, 43]] = 1
CLASS_OF_TYPE[[1]] = 2
CLASS_OF_TYPE[[10]] = 3

ARDUPILOT_IMU_DELAY_S: Final = 0.011
"""ArduPilot's own low-pass on the IMU; this and the next two are minima of the innovations on recorded flights."""
ARDUPILOT_MAG_DELAY_S: Final = 0.050
ARDUPILOT_GNSS_DELAY_S: Final = 0.098


@kernel("void(int64[::1], float64[::1])")
def forget_boot(ints: NDArray[np.int64], values: NDArray[np.float64]) -> None:
    """Forget everything that belongs to one power-up."""
    ints[S_BOOT_FIRST_SLOT:] = NONE
    ints[S_SUSPECTS] = 0
    ints[S_PROFILE] = 1 if ints[S_AUTOPILOT] != NONE else 0
    ints[S_IMU_SOURCE : S_IMU_SOURCE + 8] = 0
    ints[S_HAS_AIRSPEED] = 0
    values[:] = np.nan


@kernel("boolean(int64[::1], int64, int64, int64)")
def take(ints: NDArray[np.int64], slot: int, rank: int, t_ns: int) -> bool:
    """Say whether a sample of a source of this rank is to be emitted; the best source seen is the one in use."""
    used = ints[slot]
    if rank > used or (rank < used and t_ns - ints[slot + 1] > SOURCE_SILENT_NS):
        ints[slot] = rank
    if rank != ints[slot]:
        return False
    ints[slot + 1] = t_ns
    return rank == RANK_BEST or t_ns - ints[S_T_FIRST] >= HOLD_NS


@kernel("int64(int64[::1], int64[:,::1], float64[:,::1], int64, int64)")
def add_plain(
    ints: NDArray[np.int64], heads: NDArray[np.int64], rows: NDArray[np.float64], kind: int, t_ns: int
) -> int:
    """Append a row of NaN and return its index."""
    k = ints[S_ROWS]
    ints[S_ROWS] = k + 1
    heads[H_KIND, k] = kind
    heads[H_T, k] = t_ns
    heads[H_BOOT, k] = ints[S_BOOT]
    rows[k, :] = np.nan
    return int(k)


@kernel("int64(int64[::1], int64[:,::1], float64[:,::1], int64, int64)")
def add_row(ints: NDArray[np.int64], heads: NDArray[np.int64], rows: NDArray[np.float64], kind: int, t_ns: int) -> int:
    """Append a row of NaN and return its index; the profile of the board goes before its first row."""
    if ints[S_PROFILE] == 1:
        ints[S_PROFILE] = 2
        k = add_plain(ints, heads, rows, KIND_PROFILE, t_ns)
        if ints[S_AUTOPILOT] == AUTOPILOT_ARDUPILOT:
            rows[k, 0] = ARDUPILOT_IMU_DELAY_S
            rows[k, 1] = ARDUPILOT_MAG_DELAY_S
            rows[k, 2] = ARDUPILOT_GNSS_DELAY_S
            rows[k, 3] = 0.0
        rows[k, 4] = CLASS_OF_TYPE[ints[S_TYPE]]
    return int(add_plain(ints, heads, rows, kind, t_ns))


@kernel("int64(uint8[::1], int64)")
def read_i16(p: NDArray[np.uint8], at: int) -> int:
    """Return the little-endian int16 at any offset."""
    value = np.int64(p[at]) | (np.int64(p[at + 1]) << 8)
    return int(value - 65536 if value & 0x8000 else value)


@kernel("int64(uint8[::1], int64)")
def read_u32(p: NDArray[np.uint8], at: int) -> int:
    """Return the little-endian uint32 at any offset."""
    return int(np.int64(p[at]) | (np.int64(p[at + 1]) << 8) | (np.int64(p[at + 2]) << 16) | (np.int64(p[at + 3]) << 24))


@kernel("int64(uint8[::1], int64)")
def read_i32(p: NDArray[np.uint8], at: int) -> int:
    """Return the little-endian int32 at any offset."""
    value = read_u32(p, at)
    return int(value - 4294967296 if value & 0x80000000 else value)


@kernel("int64(uint8[::1], int64)")
def read_i64(p: NDArray[np.uint8], at: int) -> int:
    """Return the little-endian int64 at any offset."""
    return int(read_u32(p, at) | (read_u32(p, at + 4) << 32))
