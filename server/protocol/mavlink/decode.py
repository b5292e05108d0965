"""The compiled way from frames to rows: sender by sender, stamp by stamp, to each message's decoder.

Everything depends on the order of the frames only, never on how the stream was cut or on the host's clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.protocol.mavlink.inertial import highres_imu, integer_imu, raw_imu_has_units, scaled_pressure
from server.protocol.mavlink.layout import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    COMMAND_ACK,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    HIGHRES_IMU,
    NONE,
    RANK_RAW,
    RANK_SCALED,
    RANK_SCALED2,
    RANK_SCALED3,
    RAW_IMU,
    S_COMPONENT,
    S_FILTERED,
    S_GAP,
    S_HAS_AIRSPEED,
    S_PY,
    S_RIVAL_BEATS,
    S_ROWS,
    S_SYSTEM,
    SCALED_IMU,
    SCALED_IMU2,
    SCALED_IMU3,
    SCALED_PRESSURE,
    SIM_STATE,
    STATUSTEXT,
    SYS_STATUS,
    SYSTEM_TIME,
    TIMESYNC,
)
from server.protocol.mavlink.position import (
    attitude,
    attitude_quaternion,
    global_position_int,
    gps_raw_int,
    sim_state,
    system_time,
)
from server.protocol.mavlink.rows import read_u32
from server.protocol.mavlink.scanner import (
    F_COMPONENT,
    F_ID,
    F_INDEX,
    F_OFFSET,
    F_SEQ,
    F_SYSTEM,
    F_VERSION,
)
from server.protocol.mavlink.senders import N_LOST, choose_again, choose_at_first, count_sender, heartbeat
from server.protocol.mavlink.stamps import DISBELIEVED, REBOOTED, believe, stamp_ns

PAYLOAD_BYTES: Final = 256
LONGEST_DECODED: Final = 96
"""No message decoded here is longer: SIM_STATE has 92 bytes."""
ROWS_PER_FRAME: Final = 4  # HIGHRES_IMU: inertial, magnetic, baro, and the profile before them

SENSOR_DIFFERENTIAL_PRESSURE: Final = 16


# What is to be done with a message; every id decoded here is below 256.
NOT_DECODED: Final = 0
STAMPED: Final = 1  # it shows the board's clock
UNSTAMPED: Final = 2
ROLES: Final = np.zeros(256, np.uint8)
ROLES[[HIGHRES_IMU, RAW_IMU, SCALED_IMU, SCALED_IMU2, SCALED_IMU3, SCALED_PRESSURE]] = STAMPED
ROLES[[ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT, SYSTEM_TIME]] = STAMPED
ROLES[[GPS_RAW_INT, SIM_STATE, SYS_STATUS, HEARTBEAT, COMMAND_ACK, STATUSTEXT, TIMESYNC]] = UNSTAMPED


@kernel("void(uint8[::1], int64, int64, uint8[::1])")
def copy_payload(data: NDArray[np.uint8], at: int, size: int, p: NDArray[np.uint8]) -> None:
    """Copy a payload to the aligned scratch `p`, zero behind it: MAVLink 2 leaves out trailing zeros."""
    first = np.uint64(at)  # unsigned indices: no test for negative ones, ten times faster
    for k in range(np.uint64(size)):
        p[k] = data[first + k]
    for k in range(np.uint64(size), np.uint64(LONGEST_DECODED)):
        p[k] = np.uint8(0)


@kernel(
    "void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1], float32[::1], int64, int64)",
)
def decode_stamped(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    f: NDArray[np.float32],
    message: int,
    t_ns: int,
) -> None:
    """Call the decoder of a message whose stamp is believed."""
    if message == HIGHRES_IMU:
        highres_imu(ints, values, heads, rows, p, f, t_ns)
    elif message == ATTITUDE_QUATERNION:
        attitude_quaternion(ints, heads, rows, f, t_ns)
    elif message == ATTITUDE:
        attitude(ints, heads, rows, f, t_ns)
    elif message == RAW_IMU:
        if p[26] == 0 and raw_imu_has_units(ints):
            integer_imu(ints, values, heads, rows, p, t_ns, RANK_RAW, 8, 27)
    elif message == SCALED_IMU:
        integer_imu(ints, values, heads, rows, p, t_ns, RANK_SCALED, 4, 22)
    elif message == SCALED_IMU2:
        integer_imu(ints, values, heads, rows, p, t_ns, RANK_SCALED2, 4, 22)
    elif message == SCALED_IMU3:
        integer_imu(ints, values, heads, rows, p, t_ns, RANK_SCALED3, 4, 22)
    elif message == GLOBAL_POSITION_INT:
        global_position_int(ints, heads, rows, p, t_ns)
    elif message == SCALED_PRESSURE:
        scaled_pressure(ints, values, heads, rows, p, f, t_ns)
    elif message == SYSTEM_TIME:
        system_time(ints, values, heads, rows, p, t_ns)


@kernel(
    "void(uint8[::1], int64[:,::1], int64, int64[:,::1], int64[::1], int64[::1], float64[::1], int64[:,::1], "
    "float64[:,::1], int64[::1], uint8[::1])",
)
def decode(
    data: NDArray[np.uint8],
    frames: NDArray[np.int64],
    count: int,
    senders: NDArray[np.int64],
    messages: NDArray[np.int64],
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    for_python: NDArray[np.int64],
    p: NDArray[np.uint8],
) -> None:
    """Turn `count` frames into rows.

    Args:
        data: the bytes the frame table points into.
        frames: the frame table of `scanner.scan`.
        count: number of frames.
        senders: shape (SENDERS, SENDER_WIDTH), added to.
        messages: frames of the board, or of anyone before it is chosen, by index of the message table; added to.
        ints: the state, `layout`.
        values: the state, `layout`.
        heads: output, shape (HEADS, ≥ ROWS_PER_FRAME * count), kind, stamp and boot of each row.
        rows: output, shape (≥ ROWS_PER_FRAME * count, ROW_WIDTH); `ints[S_ROWS]` of them are written.
        for_python: output, frames with messages that are left to Python; `ints[S_PY]` of them.
        p: scratch, PAYLOAD_BYTES.
    """
    f = p.view(np.float32)
    ints[S_ROWS] = 0
    ints[S_PY] = 0
    for i in range(count):
        system = frames[i, F_SYSTEM]
        component = frames[i, F_COMPONENT]
        index = frames[i, F_INDEX]
        key = system * 256 + component
        count_sender(ints, senders, key, frames[i, F_SEQ], index >= 0)
        chosen = system == ints[S_SYSTEM] and component == ints[S_COMPONENT]
        if index < 0:
            ints[S_FILTERED] += ints[S_SYSTEM] != NONE and not chosen
            continue
        at = int(frames[i, F_OFFSET])
        message = frames[i, F_ID]
        role = ROLES[message] if message < len(ROLES) else NOT_DECODED
        if role == NOT_DECODED and ints[S_SYSTEM] != NONE:
            ints[S_FILTERED] += not chosen
            messages[index] += chosen
            ints[S_RIVAL_BEATS] *= not chosen
            continue
        copy_payload(data, at + (10 if frames[i, F_VERSION] == 2 else 6), int(np.int64(data[at + 1])), p)
        if chosen:
            ints[S_RIVAL_BEATS] = 0
        elif ints[S_SYSTEM] == NONE:
            chosen = choose_at_first(ints, values, system, component, message, p)
            if not chosen:
                messages[index] += 1
        else:
            chosen = choose_again(ints, values, system, component, message, p)
            ints[S_FILTERED] += not chosen
        if not chosen:
            continue
        messages[index] += 1
        if role == STAMPED:
            t_ns = stamp_ns(ints, message, p)
            if t_ns == NONE:
                continue
            gap = ints[S_GAP]
            belief = believe(ints, values, t_ns)
            if belief == REBOOTED:  # its sequence numbers began again: that was no loss
                senders[key, N_LOST] -= gap
                ints[S_GAP] = 0
            if belief != DISBELIEVED:
                decode_stamped(ints, values, heads, rows, p, f, message, t_ns)
        elif message == SIM_STATE:
            sim_state(ints, heads, rows, p, f)
        elif message == GPS_RAW_INT:
            gps_raw_int(ints, values, heads, rows, p)
        elif message == SYS_STATUS:
            ints[S_HAS_AIRSPEED] = 1 if read_u32(p, 0) & SENSOR_DIFFERENTIAL_PRESSURE else 0
        elif message in (HEARTBEAT, COMMAND_ACK, STATUSTEXT, TIMESYNC):
            if message == HEARTBEAT:
                heartbeat(ints, p)
            for_python[ints[S_PY]] = i
            ints[S_PY] += 1
