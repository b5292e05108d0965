"""Who is on the link, what each of them lost, and which one is the board."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.protocol.mavlink.layout import (
    AUTOPILOT_INVALID,
    HEARTBEAT,
    HIGHRES_IMU,
    NONE,
    RAW_IMU,
    S_AUTOPILOT,
    S_BOOT,
    S_CANDIDATE_COMPONENT,
    S_CANDIDATE_SYSTEM,
    S_CANDIDATE_T,
    S_COMPONENT,
    S_GAP,
    S_PROFILE,
    S_RIVAL_BEATS,
    S_RIVAL_COMPONENT,
    S_RIVAL_SYSTEM,
    S_SYSTEM,
    S_TYPE,
    S_WANT_COMPONENT,
    S_WANT_SYSTEM,
    SCALED_IMU,
    TYPE_GCS,
)
from server.protocol.mavlink.rows import forget_boot
from server.protocol.mavlink.stamps import stamp_ns

# Columns of the sender table (int64), one row per system * 256 + component.
N_FRAMES: Final = 0
N_LOST: Final = 1
N_SEQ: Final = 2  # newest sequence number, NONE = unknown
SENDER_WIDTH: Final = 3
SENDERS: Final = 65536

CANDIDATE_NS: Final = 1_500_000_000
"""Board time after which the first sender of IMU data is believed to be the board though no heartbeat came."""
RIVAL_BEATS: Final = 3
"""Heartbeats of another autopilot, with nothing of the chosen one between, after which the board has been exchanged."""
DUPLICATE: Final = 255


@kernel("void(int64[::1], int64[:,::1], int64, int64, boolean)")
def count_sender(ints: NDArray[np.int64], senders: NDArray[np.int64], key: int, seq: int, known: bool) -> None:
    """Count a frame and the gap before it; an unknown id counts only for a sender with checked frames.

    A number that repeats the last one is a duplicate (UDP), not a loss of 255.
    """
    if not known and senders[key, N_FRAMES] == 0:
        return
    last = senders[key, N_SEQ]
    if last != NONE:
        gap = (seq - last - 1) & 255
        if gap != DUPLICATE:
            senders[key, N_LOST] += gap
            if key == ints[S_SYSTEM] * 256 + ints[S_COMPONENT]:
                ints[S_GAP] += gap
    senders[key, N_FRAMES] += 1
    senders[key, N_SEQ] = seq


@kernel("boolean(int64[::1], int64, int64)")
def wanted(ints: NDArray[np.int64], system: int, component: int) -> bool:
    """Say whether the filter of the settings lets this sender through."""
    return bool(ints[S_WANT_SYSTEM] in (NONE, system) and ints[S_WANT_COMPONENT] in (NONE, component))


@kernel("void(int64[::1], float64[::1], int64, int64)")
def choose_sender(ints: NDArray[np.int64], values: NDArray[np.float64], system: int, component: int) -> None:
    """Listen to this sender from now on; another one than before is another board, so a new power-up."""
    if ints[S_SYSTEM] != NONE:
        ints[S_BOOT] += 1
    ints[S_SYSTEM] = system
    ints[S_COMPONENT] = component
    ints[S_AUTOPILOT] = NONE
    ints[S_TYPE] = NONE
    ints[S_RIVAL_BEATS] = 0
    forget_boot(ints, values)


@kernel("boolean(int64[::1], float64[::1], int64, int64, int64, uint8[::1])")
def choose_at_first(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    system: int,
    component: int,
    message: int,
    p: NDArray[np.uint8],
) -> bool:
    """Choose the board while none is chosen: by an autopilot's heartbeat, else the first sender of IMU data."""
    if not wanted(ints, system, component):
        return False
    if message == HEARTBEAT:
        chosen = p[5] != AUTOPILOT_INVALID and p[4] != TYPE_GCS
    elif message in (HIGHRES_IMU, RAW_IMU, SCALED_IMU):
        t_ns = stamp_ns(ints, message, p)
        if ints[S_CANDIDATE_SYSTEM] == NONE:
            ints[S_CANDIDATE_SYSTEM] = system
            ints[S_CANDIDATE_COMPONENT] = component
            ints[S_CANDIDATE_T] = t_ns
        same = ints[S_CANDIDATE_SYSTEM] == system and ints[S_CANDIDATE_COMPONENT] == component
        if same and t_ns < ints[S_CANDIDATE_T]:
            ints[S_CANDIDATE_T] = t_ns
        chosen = same and t_ns - ints[S_CANDIDATE_T] > CANDIDATE_NS
    else:
        chosen = False
    if chosen:
        choose_sender(ints, values, system, component)
    return bool(chosen)


@kernel("boolean(int64[::1], float64[::1], int64, int64, int64, uint8[::1])")
def choose_again(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    system: int,
    component: int,
    message: int,
    p: NDArray[np.uint8],
) -> bool:
    """Move to another autopilot once it has sent heartbeats while the chosen one said nothing at all."""
    if message != HEARTBEAT or p[5] == AUTOPILOT_INVALID or p[4] == TYPE_GCS or not wanted(ints, system, component):
        return False
    same = ints[S_RIVAL_SYSTEM] == system and ints[S_RIVAL_COMPONENT] == component
    ints[S_RIVAL_BEATS] = ints[S_RIVAL_BEATS] + 1 if same else 1
    ints[S_RIVAL_SYSTEM] = system
    ints[S_RIVAL_COMPONENT] = component
    if ints[S_RIVAL_BEATS] < RIVAL_BEATS:
        return False
    choose_sender(ints, values, system, component)
    return True


@kernel("void(int64[::1], uint8[::1])")
def heartbeat(ints: NDArray[np.int64], p: NDArray[np.uint8]) -> None:
    """Keep what kind of board it is; the profile goes out before the next row."""
    if p[5] == AUTOPILOT_INVALID or p[4] == TYPE_GCS:
        return
    if ints[S_AUTOPILOT] != p[5] or ints[S_TYPE] != p[4] or ints[S_PROFILE] == 0:
        ints[S_PROFILE] = 1
    ints[S_AUTOPILOT] = p[5]
    ints[S_TYPE] = p[4]
