"""Compiled decoding of GNSS, the board's own estimate, the simulator's truth and the calendar date."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.nav.types import Kind
from server.protocol.mavlink.layout import (
    EPOCH_USEC,
    NONE,
    RANK_EULER,
    RANK_QUATERNION,
    S_ATT_SOURCE,
    S_GNSS_FIX,
    S_GNSS_USEC,
    S_REPEATED_OTHER,
    S_T_ATT,
    S_T_LAST,
    S_T_NO_FIX,
    S_T_REFERENCE,
    V_YEAR,
)
from server.protocol.mavlink.rows import add_row, read_i16, read_i32, read_i64, read_u32, take

KIND_GNSS: Final = int(Kind.GNSS)
KIND_ONBOARD: Final = int(Kind.ONBOARD)
KIND_REFERENCE: Final = int(Kind.REFERENCE)
KIND_DATE: Final = int(Kind.DATE)

OTHER_CLOCK_NS: Final = 10_000_000_000
"""A GNSS stamp this far from the board's newest is of another clock."""
NO_FIX_PERIOD_NS: Final = 1_000_000_000
DEG_PER_E7: Final = 1e-7
MILLI: Final = 1e-3
CENTI: Final = 0.01
UNKNOWN_U16: Final = 65535
FIX_2D: Final = 2
FIX_3D: Final = 3
# Fix types of MAVLink → ours (0-1 none, 2 two-dimensional, 3 three-dimensional, 4 differential, 5 float, 6 fixed):
# STATIC (7) is a base station's three-dimensional fix, PPP (8) a corrected one; those not defined yet are no fix.
FIX_TYPES: Final = np.array([0, 1, 2, 3, 4, 5, 6, 3, 4], np.int64)
YEAR_STEP: Final = 1e-3  # about nine hours: the field moves by arc seconds a day
OLDEST_UNIX_USEC: Final = 1_420_070_400_000_000  # 2015-01-01; before that the board's clock was never set


@kernel("void(float64[:,::1], int64, uint8[::1], int64)")
def fill_fix(rows: NDArray[np.float64], k: int, p: NDArray[np.uint8], fix: int) -> None:
    """Write position, velocity (the message has none downward) and accuracies; unknown stays NaN."""
    rows[k, 0] = read_i32(p, 8) * DEG_PER_E7
    rows[k, 1] = read_i32(p, 12) * DEG_PER_E7
    if fix >= FIX_3D:
        rows[k, 2] = read_i32(p, 16) * MILLI
    speed = np.int64(p[24]) | (np.int64(p[25]) << 8)
    course = np.int64(p[26]) | (np.int64(p[27]) << 8)
    if UNKNOWN_U16 not in (speed, course):
        course_rad = math.radians(course * CENTI)
        rows[k, 3] = speed * CENTI * math.cos(course_rad)
        rows[k, 4] = speed * CENTI * math.sin(course_rad)
    for i in range(3):  # h_acc, v_acc, vel_acc in mm and mm/s, extensions: 0 = unknown
        accuracy = read_u32(p, 34 + 4 * i)
        if accuracy != 0:
            rows[k, 6 + i] = accuracy * MILLI
    rows[k, 9] = fix
    if p[29] != 255:
        rows[k, 10] = p[29]


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1])")
def gps_raw_int(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
) -> None:
    """GPS_RAW_INT: a row per new `time_usec` or fix type; without a fix one row a second of board time, values NaN.

    The row's stamp is `time_usec`. Where that is of another clock (UNIX time, zero), or frozen in an outage, it is the
    newest stamp of the board's own clock instead; before there is one, there are no rows.
    """
    usec = read_i64(p, 0)
    now = int(ints[S_T_LAST])
    if now == NONE:
        return
    fix = FIX_TYPES[p[28]] if p[28] < len(FIX_TYPES) else 0
    same_fix = fix == ints[S_GNSS_FIX]
    ints[S_GNSS_FIX] = fix
    if fix < FIX_2D:
        if same_fix and now - ints[S_T_NO_FIX] < NO_FIX_PERIOD_NS:
            ints[S_REPEATED_OTHER] += 1
            return
        ints[S_T_NO_FIX] = now
        k = add_row(ints, heads, rows, KIND_GNSS, now)
        rows[k, 9] = fix
        rows[k, 10] = np.nan if p[29] == 255 else np.float64(p[29])
        return
    if same_fix and usec == ints[S_GNSS_USEC]:
        ints[S_REPEATED_OTHER] += 1
        return
    of_board = 0 < usec < EPOCH_USEC and abs(usec * 1000 - now) < OTHER_CLOCK_NS
    t_ns = usec * 1000 if of_board else now
    ints[S_GNSS_USEC] = usec
    k = add_row(ints, heads, rows, KIND_GNSS, t_ns)
    fill_fix(rows, k, p, fix)


@kernel("void(float64[:,::1], int64, float64, float64, float64, float64)")
def fill_quat(rows: NDArray[np.float64], k: int, w: float, x: float, y: float, z: float) -> None:
    """Write a quaternion body → NED with w ≥ 0."""
    sign = -1.0 if w < 0.0 else 1.0
    rows[k, 0] = sign * w
    rows[k, 1] = sign * x
    rows[k, 2] = sign * y
    rows[k, 3] = sign * z


@kernel("void(int64[::1], int64[:,::1], float64[:,::1], float32[::1], int64)")
def attitude_quaternion(
    ints: NDArray[np.int64], heads: NDArray[np.int64], rows: NDArray[np.float64], f: NDArray[np.float32], t_ns: int
) -> None:
    """ATTITUDE_QUATERNION → the board's own attitude."""
    if take(ints, S_ATT_SOURCE, RANK_QUATERNION, t_ns):
        ints[S_T_ATT] = t_ns
        k = add_row(ints, heads, rows, KIND_ONBOARD, t_ns)
        fill_quat(rows, k, float(f[1]), float(f[2]), float(f[3]), float(f[4]))


@kernel("void(int64[::1], int64[:,::1], float64[:,::1], float32[::1], int64)")
def attitude(
    ints: NDArray[np.int64], heads: NDArray[np.int64], rows: NDArray[np.float64], f: NDArray[np.float32], t_ns: int
) -> None:
    """ATTITUDE (roll, pitch, yaw in ZYX order) → the board's own attitude, where it sends no quaternion."""
    if not take(ints, S_ATT_SOURCE, RANK_EULER, t_ns):
        return
    ints[S_T_ATT] = t_ns
    roll, pitch, yaw = 0.5 * float(f[1]), 0.5 * float(f[2]), 0.5 * float(f[3])
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    k = add_row(ints, heads, rows, KIND_ONBOARD, t_ns)
    fill_quat(
        rows,
        k,
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@kernel("void(int64[::1], int64[:,::1], float64[:,::1], uint8[::1], int64)")
def global_position_int(
    ints: NDArray[np.int64], heads: NDArray[np.int64], rows: NDArray[np.float64], p: NDArray[np.uint8], t_ns: int
) -> None:
    """GLOBAL_POSITION_INT → the board's own position and velocity; 0, 0 means that it has none yet."""
    lat_e7 = read_i32(p, 4)
    lon_e7 = read_i32(p, 8)
    if lat_e7 == 0 and lon_e7 == 0:
        return
    k = add_row(ints, heads, rows, KIND_ONBOARD, t_ns)
    rows[k, 4] = lat_e7 * DEG_PER_E7
    rows[k, 5] = lon_e7 * DEG_PER_E7
    rows[k, 6] = read_i32(p, 12) * MILLI
    for i in range(3):
        rows[k, 7 + i] = read_i16(p, 20 + 2 * i) * CENTI


@kernel("void(int64[::1], int64[:,::1], float64[:,::1], uint8[::1], float32[::1])")
def sim_state(
    ints: NDArray[np.int64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    f: NDArray[np.float32],
) -> None:
    """SIM_STATE → the reference, stamped by the attitude before it; a second one at the same stamp is dropped.

    ArduPilot writes its float latitude and longitude in 1e-7 degrees; the specification says degrees.
    """
    t_ns = ints[S_T_ATT]
    if t_ns == NONE or t_ns == ints[S_T_REFERENCE]:
        return
    ints[S_T_REFERENCE] = t_ns
    k = add_row(ints, heads, rows, KIND_REFERENCE, t_ns)
    fill_quat(rows, k, float(f[0]), float(f[1]), float(f[2]), float(f[3]))
    lat_e7 = read_i32(p, 84)
    lon_e7 = read_i32(p, 88)
    if lat_e7 != 0 or lon_e7 != 0:
        rows[k, 4] = lat_e7 * DEG_PER_E7
        rows[k, 5] = lon_e7 * DEG_PER_E7
    else:
        in_degrees = abs(f[13]) <= 90.0 and abs(f[14]) <= 180.0
        rows[k, 4] = float(f[13]) * (1.0 if in_degrees else DEG_PER_E7)
        rows[k, 5] = float(f[14]) * (1.0 if in_degrees else DEG_PER_E7)
    rows[k, 6] = f[15]
    for i in range(3):
        rows[k, 7 + i] = f[18 + i]


@kernel("float64(int64)")
def decimal_year(unix_usec: int) -> float:
    """Return the year with its elapsed part, in UTC (leap years by the Gregorian rule, years 1970 to 2399)."""
    days = unix_usec / 86_400e6
    year = 1970
    while True:
        leap = year % 4 == 0 and (year % 100 != 0 or year % 400 == 0)
        length = 366 if leap else 365
        if days < length or year >= 2399:
            return float(year + min(days / length, 1.0))
        days -= length
        year += 1


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1], int64)")
def system_time(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    t_ns: int,
) -> None:
    """SYSTEM_TIME → the date, once and again when it has moved by nine hours."""
    usec = read_i64(p, 0)
    if usec < OLDEST_UNIX_USEC:
        return
    year = decimal_year(usec)
    if abs(year - values[V_YEAR]) < YEAR_STEP:
        return
    values[V_YEAR] = year
    rows[add_row(ints, heads, rows, KIND_DATE, t_ns), 0] = year
