"""The board's clock: which stamps a message shows, and which of them are believed."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.protocol.mavlink.layout import (
    EPOCH_USEC,
    HIGHRES_IMU,
    NONE,
    RAW_IMU,
    S_BOOT,
    S_EPOCH_BASE,
    S_GAP,
    S_HELD,
    S_SUSPECT_T,
    S_SUSPECTS,
    S_T_FIRST,
    S_T_LAST,
    SYSTEM_TIME,
)
from server.protocol.mavlink.rows import forget_boot, read_i64, read_u32

# A board's clock only runs forward, at one second a second. What does not fit must come three times in a row, each
# within two seconds of the one before, to be believed: one damaged stamp that passes its check sum changes nothing.
FORWARD_NS: Final = 3_000_000_000  # a longer step forward is a gap in the link, once it is confirmed
BACK_NS: Final = 5_000_000_000  # a step back by more is a reboot, once it is confirmed
NEAR_ZERO_NS: Final = 5_000_000_000  # so close to power-up a step back by RESTART_NS is enough
RESTART_NS: Final = 1_000_000_000
RUN_NS: Final = 2_000_000_000
CONFIRMATIONS: Final = 3

DISBELIEVED: Final = 0
BELIEVED: Final = 1
REBOOTED: Final = 2


@kernel("int64(int64[::1], float64[::1], int64)")
def believe(ints: NDArray[np.int64], values: NDArray[np.float64], t_ns: int) -> int:
    """Return DISBELIEVED, BELIEVED or REBOOTED for a stamp of the board's clock, and keep the clock's state."""
    last = ints[S_T_LAST]
    if last == NONE:
        ints[S_T_FIRST] = t_ns
        ints[S_T_LAST] = t_ns
        return BELIEVED
    step = t_ns - last
    restarted = step < -BACK_NS or (step < -RESTART_NS and t_ns < NEAR_ZERO_NS)
    if not restarted and step <= FORWARD_NS:
        ints[S_SUSPECTS] = 0
        ints[S_GAP] = 0
        ints[S_T_LAST] = max(last, t_ns)
        return BELIEVED
    run = ints[S_SUSPECTS] > 0 and abs(t_ns - ints[S_SUSPECT_T]) <= RUN_NS
    ints[S_SUSPECTS] = ints[S_SUSPECTS] + 1 if run else 1
    ints[S_SUSPECT_T] = t_ns
    if ints[S_SUSPECTS] < CONFIRMATIONS:
        ints[S_HELD] += 1
        return DISBELIEVED
    if restarted:
        ints[S_BOOT] += 1
        forget_boot(ints, values)
        ints[S_T_FIRST] = t_ns
    ints[S_SUSPECTS] = 0
    ints[S_T_LAST] = t_ns
    return REBOOTED if restarted else BELIEVED


@kernel("int64(int64[::1], int64, uint8[::1])")
def stamp_ns(ints: NDArray[np.int64], message: int, p: NDArray[np.uint8]) -> int:
    """Return the stamp on the board's own clock that a message carries, ns, or NONE.

    GPS_RAW_INT has one, but it freezes in an outage. IMU stamps in UNIX time are shifted so that the first one falls on
    the newest other stamp.
    """
    if message in (HIGHRES_IMU, RAW_IMU):
        usec = read_i64(p, 0)
        if usec < 0 or usec > 9_000_000_000_000_000:
            return NONE
        if usec < EPOCH_USEC:
            return int(usec * 1000)
        if ints[S_EPOCH_BASE] == NONE:
            ints[S_EPOCH_BASE] = usec * 1000 - max(ints[S_T_LAST], 0)
        return int(usec * 1000 - ints[S_EPOCH_BASE])
    if message == SYSTEM_TIME:
        return int(read_u32(p, 8) * 1_000_000)
    return int(read_u32(p, 0) * 1_000_000)
