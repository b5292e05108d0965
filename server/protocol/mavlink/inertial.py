"""Compiled decoding of what the inertial unit, magnetometer, barometer and pressure tube say.

`p` is always the payload, zero-padded to the full length, and `f` the same bytes as float32: fields of the base
definition are aligned to their size.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.nav.types import Kind
from server.protocol.mavlink.layout import (
    AUTOPILOT_ARDUPILOT,
    NONE,
    RANK_HIGHRES,
    RANK_PRESSURE,
    S_AUTOPILOT,
    S_BARO_SOURCE,
    S_HAS_AIRSPEED,
    S_IMU_SOURCE,
    S_MAG_SOURCE,
    S_REPEATED_IMU,
    S_REPEATED_OTHER,
    S_T_IMU,
    V_AIRSPEED,
    V_BARO,
    V_MAG,
)
from server.protocol.mavlink.rows import add_row, read_i16, take

KIND_IMU: Final = int(Kind.IMU)
KIND_MAG: Final = int(Kind.MAG)
KIND_BARO: Final = int(Kind.BARO)
KIND_AIRSPEED: Final = int(Kind.AIRSPEED)

MILLI_G_M_S2: Final = 9.80665e-3
MILLI: Final = 1e-3
PA_PER_HPA: Final = 100.0
CENTI: Final = 0.01


@kernel(
    "void(int64[::1], int64[:,::1], float64[:,::1], int64, "
    "float64, float64, float64, float64, float64, float64, float64)",
)
def imu_row(
    ints: NDArray[np.int64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    t_ns: int,
    gyro_x: float,
    gyro_y: float,
    gyro_z: float,
    accel_x: float,
    accel_y: float,
    accel_z: float,
    temperature_degc: float,
) -> None:
    """Emit gyro (rad/s) and accelerometer (m/s², body FRD) unless the stamp is not new or nothing is measured."""
    if t_ns <= ints[S_T_IMU]:
        ints[S_REPEATED_IMU] += 1
        return
    if gyro_x == gyro_y == gyro_z == accel_x == accel_y == accel_z == 0.0:
        return
    ints[S_T_IMU] = t_ns
    k = add_row(ints, heads, rows, KIND_IMU, t_ns)
    rows[k, 0] = gyro_x
    rows[k, 1] = gyro_y
    rows[k, 2] = gyro_z
    rows[k, 3] = accel_x
    rows[k, 4] = accel_y
    rows[k, 5] = accel_z
    rows[k, 6] = temperature_degc


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], int64, float64, float64, float64)")
def mag_row(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    t_ns: int,
    x: float,
    y: float,
    z: float,
) -> None:
    """Emit the field (body FRD, gauss if the board keeps to the specification) when it differs from the last."""
    if x == 0.0 and y == 0.0 and z == 0.0:
        return
    if x == values[V_MAG] and y == values[V_MAG + 1] and z == values[V_MAG + 2]:
        ints[S_REPEATED_OTHER] += 1
        return
    values[V_MAG] = x
    values[V_MAG + 1] = y
    values[V_MAG + 2] = z
    k = add_row(ints, heads, rows, KIND_MAG, t_ns)
    rows[k, 0] = x
    rows[k, 1] = y
    rows[k, 2] = z


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], int64, float64, float64)")
def baro_row(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    t_ns: int,
    pressure_pa: float,
    temperature_degc: float,
) -> None:
    """Emit the static pressure when it differs from the last."""
    if pressure_pa == 0.0:
        return
    if pressure_pa == values[V_BARO]:
        ints[S_REPEATED_OTHER] += 1
        return
    values[V_BARO] = pressure_pa
    k = add_row(ints, heads, rows, KIND_BARO, t_ns)
    rows[k, 0] = pressure_pa
    rows[k, 2] = temperature_degc


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1], float32[::1], int64)")
def highres_imu(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    f: NDArray[np.float32],
    t_ns: int,
) -> None:
    """HIGHRES_IMU of the first IMU: floats, pressure in hPa. `diff_pressure` is not airspeed on real boards: unused."""
    if p[62] != 0:
        return
    temperature_degc = float(f[14])
    if take(ints, S_IMU_SOURCE, RANK_HIGHRES, t_ns):
        imu_row(ints, heads, rows, t_ns, f[5], f[6], f[7], f[2], f[3], f[4], temperature_degc)
    if take(ints, S_MAG_SOURCE, RANK_HIGHRES, t_ns):
        mag_row(ints, values, heads, rows, t_ns, f[8], f[9], f[10])
    if take(ints, S_BARO_SOURCE, RANK_HIGHRES, t_ns):
        baro_row(ints, values, heads, rows, t_ns, float(f[11]) * PA_PER_HPA, temperature_degc)


@kernel(
    "void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1], int64, int64, int64, int64)",
)
def integer_imu(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    t_ns: int,
    rank: int,
    at: int,
    temperature_at: int,
) -> None:
    """SCALED_IMU, 2, 3 and ArduPilot's RAW_IMU: nine int16 at `at`, in mG, mrad/s, mgauss, truncated toward zero."""
    centi_degc = read_i16(p, temperature_at)
    if take(ints, S_IMU_SOURCE, rank, t_ns):
        imu_row(
            ints,
            heads,
            rows,
            t_ns,
            read_i16(p, at + 6) * MILLI,
            read_i16(p, at + 8) * MILLI,
            read_i16(p, at + 10) * MILLI,
            read_i16(p, at) * MILLI_G_M_S2,
            read_i16(p, at + 2) * MILLI_G_M_S2,
            read_i16(p, at + 4) * MILLI_G_M_S2,
            centi_degc * CENTI if centi_degc != 0 else np.nan,
        )
    if take(ints, S_MAG_SOURCE, rank, t_ns):
        x = read_i16(p, at + 12) * MILLI
        y = read_i16(p, at + 14) * MILLI
        z = read_i16(p, at + 16) * MILLI
        mag_row(ints, values, heads, rows, t_ns, x, y, z)


@kernel("boolean(int64[::1])")
def raw_imu_has_units(ints: NDArray[np.int64]) -> bool:
    """RAW_IMU is in the converter's own counts by the specification; only ArduPilot is known to send units."""
    return bool(ints[S_AUTOPILOT] in (NONE, AUTOPILOT_ARDUPILOT))


@kernel("void(int64[::1], float64[::1], int64[:,::1], float64[:,::1], uint8[::1], float32[::1], int64)")
def scaled_pressure(
    ints: NDArray[np.int64],
    values: NDArray[np.float64],
    heads: NDArray[np.int64],
    rows: NDArray[np.float64],
    p: NDArray[np.uint8],
    f: NDArray[np.float32],
    t_ns: int,
) -> None:
    """SCALED_PRESSURE (hPa): static pressure when HIGHRES_IMU gives none, differential where the board has a sensor."""
    if take(ints, S_BARO_SOURCE, RANK_PRESSURE, t_ns):
        baro_row(ints, values, heads, rows, t_ns, float(f[1]) * PA_PER_HPA, read_i16(p, 12) * CENTI)
    diff_pressure_pa = float(f[2]) * PA_PER_HPA
    if ints[S_HAS_AIRSPEED] != 1 or math.isnan(diff_pressure_pa):
        return
    if diff_pressure_pa == values[V_AIRSPEED]:
        ints[S_REPEATED_OTHER] += 1
        return
    values[V_AIRSPEED] = diff_pressure_pa
    centi_degc = read_i16(p, 14)
    k = add_row(ints, heads, rows, KIND_AIRSPEED, t_ns)
    rows[k, 0] = diff_pressure_pa
    rows[k, 2] = centi_degc * CENTI if centi_degc != 0 else np.nan
