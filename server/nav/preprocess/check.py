"""Is a sample believable? Finite, in range, in order, not stuck, in a known unit; the reason is counted."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    FUSED,
    IMU,
    REFUSED_DISTURBED,
    REFUSED_NO_FIX,
    REFUSED_RANGE,
)
from server.nav.constants import (
    EARTH_FIELD_MAX_GAUSS,
    EARTH_FIELD_MIN_GAUSS,
    ISA_EXPONENT,
    ISA_HEIGHT_M,
    ISA_PRESSURE_PA,
)
from server.nav.kernel import kernel
from server.nav.preprocess.calibrate import calibrate_mag
from server.nav.preprocess.chain_layout import (
    B_SIZE,
    B_UNITS,
    K_BLOCKS,
    K_ON,
    MAG,
)
from server.nav.preprocess.clipping import ACCEL_LEAST_M_S2, GYRO_LEAST_RAD_S, clipped
from server.nav.preprocess.memory import (
    N_CLIPPED,
    N_FIELD,
    N_NO_FIX,
    N_ORDER,
    N_RANGE,
    N_REPEATED,
    N_SAMPLES,
    N_STUCK,
    NEVER_NS,
    S_CLIP,
    S_CLIP_NEAR,
    S_LIVELY,
    S_MAG_BAD,
    S_MAG_GOOD,
    S_MAG_SCALE,
    S_SAME,
    S_T_CLIP,
    S_T_LAST,
)
from server.nav.types import Float, Int

GYRO_LIMIT_RAD_S: Final = 80.0  # 4,500 °/s: past every MEMS gyro's full scale
ACCEL_LIMIT_M_S2: Final = 640.0  # 65 g: past every MEMS accelerometer's full scale
STUCK_S: Final = 0.5
PROVEN_SAMPLES: Final = 50.0  # a scale that explained so many is right: what does not fit later is a magnet


@kernel("float64(float64)")
def height_from_pressure(pressure_pa: float) -> float:
    """Return the height in m of a pressure in the standard atmosphere [S0 eq. 3.27]."""
    return float(ISA_HEIGHT_M * (1.0 - (pressure_pa / ISA_PRESSURE_PA) ** ISA_EXPONENT))


@kernel("float64(float64)")
def decade_scale(norm: float) -> float:
    """Return the power of ten that brings a field's norm into [0.15, 1.5) gauss; 0 for a norm of 0.

    The Earth's field spans 0.2 to 0.7 gauss, less than a decade, so a wrong unit (milligauss, microtesla, nanotesla,
    milligauss × 1000) is recognised without knowing the place.
    """
    if norm <= 0.0:
        return 0.0
    return float(10.0 ** -math.floor(math.log10(norm / 0.15)))


@kernel("boolean(float64[::1], int64)")
def _finite(row: Float, n: int) -> bool:
    for i in range(n):
        if not math.isfinite(row[i]):
            return False
    return True


@kernel("void(float64[::1], float64, float64, float64, float64[::1], int64[:, ::1])")
def count_clipped(row: Float, t: float, gyro_scale: float, accel_scale: float, s: Float, n: Int) -> None:
    """Count an IMU sample of which an axis stands at the end of its range; full scales in SI, 0 = unknown."""
    any_axis = False
    near = 0.0
    for i in range(3):
        any_axis |= clipped(row[i], gyro_scale, GYRO_LEAST_RAD_S, s, S_CLIP + 2 * i)
        any_axis |= clipped(row[3 + i], accel_scale, ACCEL_LEAST_M_S2, s, S_CLIP + 6 + 2 * i)
        near += s[S_CLIP + 2 * i + 1] + s[S_CLIP + 7 + 2 * i]
    s[S_CLIP_NEAR] = near
    if any_axis:
        n[IMU, N_CLIPPED] += 1
        s[S_T_CLIP] = t


@kernel("int64(float64[::1], float64, int64, float64, float64, float64[::1], int64[:, ::1])")
def check_imu(row: Float, t: float, last: int, gyro_most: float, accel_most: float, s: Float, n: Int) -> int:
    """Return 0 for a sample that may not be used, its reason counted; 2 when it may be clipped, else 1.

    Args:
        row: the sample in SI. t: its stamp, ns.
        last: where in s the one before it stands: S_GYRO, or S_RAW where what is kept there has been changed.
        gyro_most, accel_most: magnitudes from which on an axis may be clipped.
        s, n: memory and counters.
    """
    counters = n[IMU]
    gyro = max(abs(row[0]), abs(row[1]), abs(row[2]))
    accel = max(abs(row[3]), abs(row[4]), abs(row[5]))
    if not (_finite(row, 6) and gyro < GYRO_LIMIT_RAD_S and accel < ACCEL_LIMIT_M_S2):
        counters[N_RANGE] += 1
        return 0
    if t <= s[S_T_LAST]:
        counters[N_REPEATED if t == s[S_T_LAST] else N_ORDER] += 1
        return 0
    same = s[S_T_LAST] > NEVER_NS
    for i in range(6):
        same = same and row[i] == s[last + i]
    s[S_SAME] = s[S_SAME] + (t - s[S_T_LAST]) * 1e-9 if same else 0.0
    s[S_LIVELY] += 0.0 if same else 1.0
    if s[S_SAME] > STUCK_S and s[S_LIVELY] > 100.0:  # a sensor that never had noise is a simulation, not stuck
        counters[N_STUCK] += 1
        return 0
    counters[N_SAMPLES] += 1
    return 2 if gyro >= gyro_most or accel >= accel_most or s[S_CLIP_NEAR] > 0.0 else 1


@kernel("int64(float64[::1], float64[::1], float64[::1], int64[::1])")
def check_mag(row: Float, c: Float, s: Float, counters: Int) -> int:
    """Scale the field to gauss and calibrate it, in place; return its AidStatus.

    The unit is found from what the board says, the strength is judged of what the calibration makes of it.
    """
    if not _finite(row, 3):
        counters[N_RANGE] += 1
        return REFUSED_RANGE
    norm = math.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2)
    if c[K_BLOCKS + MAG * B_SIZE + B_UNITS] > 1.0:
        s[S_MAG_SCALE] = 1.0  # a person has said what the counts are
    elif s[S_MAG_SCALE] == 0.0 or (s[S_MAG_BAD] >= 20.0 and s[S_MAG_GOOD] < PROVEN_SAMPLES):
        s[S_MAG_SCALE], s[S_MAG_BAD] = decade_scale(norm), 0.0
    for i in range(3):
        row[i] *= s[S_MAG_SCALE]
    norm *= s[S_MAG_SCALE]
    likely = 0.15 <= norm < 1.5
    s[S_MAG_BAD] = 0.0 if likely else s[S_MAG_BAD] + 1.0
    s[S_MAG_GOOD] += 1.0 if likely else 0.0
    if c[K_ON + MAG] > 0.0:
        calibrate_mag(c, row)
        norm = math.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2)
    if EARTH_FIELD_MIN_GAUSS <= norm <= EARTH_FIELD_MAX_GAUSS:
        return FUSED
    counters[N_FIELD] += 1
    return REFUSED_DISTURBED


@kernel("int64(float64[::1], int64[::1])")
def check_gnss(row: Float, counters: Int) -> int:
    """Return the AidStatus of a GNSS row; an unknown fix type counts as three-dimensional."""
    if row[9] < 3.0 or ((math.isnan(row[0]) or math.isnan(row[1])) and (math.isnan(row[3]) or math.isnan(row[4]))):
        counters[N_NO_FIX] += 1
        return REFUSED_NO_FIX
    bad = abs(row[0]) > 90.0 or abs(row[1]) > 360.0 or abs(row[2]) > 1e5 or (row[0] == 0.0 and row[1] == 0.0)
    for i in range(3, 6):
        bad = bad or abs(row[i]) > 1e3 or math.isinf(row[i])
    if bad or math.isinf(row[0]) or math.isinf(row[1]) or math.isinf(row[2]):
        counters[N_RANGE] += 1
        return REFUSED_RANGE
    return FUSED


@kernel("int64(float64[::1], int64[::1])")
def check_baro(row: Float, counters: Int) -> int:
    """Make column 1 the height in m; return the AidStatus."""
    if not math.isfinite(row[1]) and 1e3 < row[0] < 1.2e5:
        row[1] = height_from_pressure(row[0])
    if not math.isfinite(row[1]) or abs(row[1]) > 4e4:
        counters[N_RANGE] += 1
        return REFUSED_RANGE
    return FUSED
