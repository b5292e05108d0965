"""One sample through the chain of its sensor: limit, Butterworth, low-pass, window; states start anew after a hole.

What arrives here is finite, in order and new: nothing else may enter a filter's state.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.calibration.applied import C_BARO, C_DIFF_PRESSURE
from server.nav.kernel import kernel
from server.nav.preprocess.airspeed import air_density, airspeed_from_pressure
from server.nav.preprocess.butterworth import butterworth, design, group_delay, settle
from server.nav.preprocess.calibrate import calibrate_imu
from server.nav.preprocess.chain_layout import (
    ACCEL,
    AIRSPEED,
    B_COEFFICIENTS,
    B_CUTOFF,
    B_DELAY,
    B_DESIGNED,
    B_FILLED,
    B_HEAD,
    B_INTERVAL,
    B_INTERVALS,
    B_LAG,
    B_LIMIT,
    B_LIMIT_COUNT,
    B_LOWPASS,
    B_ORDER,
    B_QUANTITY,
    B_SECTIONS,
    B_SIZE,
    B_STATES,
    B_T_LAST,
    B_UNITS,
    B_WINDOW,
    BARO,
    G_FIRST,
    G_SECOND,
    GYRO,
    K_BLOCKS,
    K_CAL,
    K_CHANGED,
    K_PRESSURE,
    K_ROW,
    MAG,
    SECTIONS,
    WINDOW_MAX,
    Z_LIMIT,
    Z_LOWPASS,
    Z_REJECTED,
    Z_SIZE,
)
from server.nav.preprocess.limit import limit
from server.nav.preprocess.lowpass import lowpass, lowpass_delay, weight
from server.nav.preprocess.units import convert
from server.nav.preprocess.window import window, window_delay
from server.nav.types import ROW_WIDTH, Float

GAP_S: Final = 0.1
GAP_INTERVALS: Final = 4.0
"""A hole longer than both ends what the filters remember."""
FIRST_S: Final = 10.0
"""A first interval longer than this is a hole too."""
MEAN_INTERVALS: Final = 256.0
REDESIGN: Final = 0.02
"""The coefficients follow the measured rate when it has moved by this share."""


@kernel("void(float64[::1], int64)")
def retime(c: Float, sensor: int) -> None:
    """Design a sensor's filters for the measured interval and write their delay; states keep their steady part."""
    b = K_BLOCKS + sensor * B_SIZE
    k = b + B_COEFFICIENTS
    channels = 3 if sensor <= MAG else 1
    known = 1.0 if c[b + B_FILLED] > 0.0 else 0.0
    for j in range(channels):
        z = b + B_STATES + j * Z_SIZE
        settle(c, k, z, c[z + Z_LIMIT], -known)
    for i in range(5 * SECTIONS):
        c[k + i] = 1.0 if i % 5 == 0 else 0.0
    sections = design(int(c[b + B_ORDER]), c[b + B_CUTOFF], c[b + B_INTERVAL], c[k : k + 5 * SECTIONS])
    for j in range(channels):
        z = b + B_STATES + j * Z_SIZE
        settle(c, k, z, c[z + Z_LIMIT], known)
    c[b + B_SECTIONS], c[b + B_DESIGNED] = sections, c[b + B_INTERVAL]
    delay = group_delay(c[k : k + 5 * SECTIONS], sections, c[b + B_INTERVAL]) + lowpass_delay(c[b + B_LOWPASS])
    c[b + B_LAG] = 0.0
    c[b + B_DELAY] = delay + window_delay(int(c[b + B_WINDOW]), 0, c[b + B_INTERVAL])


@kernel("void(float64[::1])")
def align_imu(c: Float) -> None:
    """Let the quicker of gyro and accelerometer wait for the slower, in whole samples: one instant, one sample."""
    g, a = K_BLOCKS + GYRO * B_SIZE, K_BLOCKS + ACCEL * B_SIZE
    interval = c[g + B_INTERVAL]
    if interval <= 0.0:
        return
    apart = c[a + B_DELAY] - c[g + B_DELAY]
    quick = g if apart > 0.0 else a
    lag = min(math.floor(abs(apart) / interval + 0.5), WINDOW_MAX - c[quick + B_WINDOW])
    c[quick + B_LAG] = lag
    c[quick + B_DELAY] += lag * interval


@kernel("boolean(float64[::1], int64, float64)")
def clock(c: Float, sensor: int, t: float) -> bool:
    """Take a sample's stamp, ns: measure the interval, forget after a hole; return whether the rate has changed."""
    b = K_BLOCKS + sensor * B_SIZE
    dt = (t - c[b + B_T_LAST]) * 1e-9
    mean = c[b + B_INTERVAL]
    if c[b + B_FILLED] > 0.0 and dt > (max(GAP_S, GAP_INTERVALS * mean) if mean > 0.0 else FIRST_S):
        c[b + B_FILLED] = 0.0
    elif c[b + B_FILLED] > 0.0:
        n = min(MEAN_INTERVALS, c[b + B_INTERVALS] + 1.0)
        share = min(2.0, max(0.5, dt / mean)) if mean > 0.0 else 1.0
        c[b + B_INTERVAL] = mean + mean * (share - 1.0) / n if mean > 0.0 else dt
        c[b + B_INTERVALS] = n
    c[b + B_T_LAST] = t
    return bool(abs(c[b + B_INTERVAL] - c[b + B_DESIGNED]) > REDESIGN * c[b + B_DESIGNED])


@kernel("void(float64[::1], int64, int64, float64)")
def _start(c: Float, b: int, z: int, value: float) -> None:
    """Set one channel's states as if the value had always been there."""
    for i in range(2 * SECTIONS):
        c[z + i] = 0.0
    settle(c, b + B_COEFFICIENTS, z, value, 1.0)
    c[z + Z_LOWPASS] = c[z + Z_LIMIT] = value
    c[z + Z_REJECTED] = 0.0


@kernel("void(float64[::1], int64, float64, float64[::1], int64, float64[::1], int64)")
def filter_sensor(c: Float, sensor: int, dt: float, row: Float, first: int, stage: Float, g: int) -> None:
    """Filter a sensor's numbers in place and write its three stages.

    Args:
        c: the chain's array.
        sensor: its number. dt: since its previous sample, s.
        row: the sample; its numbers begin at row[first].
        stage: shape (G_SIZE,) or (0,): then none are written. g: where this sensor's begin in it.
    """
    b = K_BLOCKS + sensor * B_SIZE
    fresh = c[b + B_FILLED] == 0.0
    head, filled = int(c[b + B_HEAD]), int(c[b + B_FILLED])
    a = weight(dt, c[b + B_LOWPASS]) if c[b + B_LOWPASS] > 0.0 else 1.0
    channels = 3 if sensor <= MAG else 1
    keep = stage.shape[0] > 0
    for j in range(channels):
        z = b + B_STATES + j * Z_SIZE
        value = row[first + j]
        if keep:
            stage[g + j] = value
        if fresh:
            _start(c, b, z, value)
        if c[b + B_LIMIT] > 0.0:
            value = limit(c, z, value, c[b + B_LIMIT], c[b + B_LIMIT_COUNT])
        else:
            c[z + Z_LIMIT] = value
        if keep:
            stage[g + 3 + j] = value
        value = butterworth(c, b + B_COEFFICIENTS, int(c[b + B_SECTIONS]), z, value)
        if c[b + B_LOWPASS] > 0.0:
            value = lowpass(c, z, value, a)
        if c[b + B_WINDOW] > 1.0 or c[b + B_LAG] > 0.0:
            value = window(c, z, head, value, int(c[b + B_WINDOW]), int(c[b + B_LAG]), filled)
        if keep:
            stage[g + 6 + j] = value
        row[first + j] = value
    c[b + B_HEAD] = (head + 1) % WINDOW_MAX
    c[b + B_FILLED] = min(WINDOW_MAX, filled + 1)


@kernel("void(float64[::1], float64[::1])")
def own_copy(raw: Float, c: Float) -> None:
    """Put an IMU row where the chain may change it, in SI and body axes."""
    g, a = K_BLOCKS + GYRO * B_SIZE, K_BLOCKS + ACCEL * B_SIZE
    row = c[K_ROW : K_ROW + ROW_WIDTH]
    for i in range(ROW_WIDTH):
        row[i] = raw[i]
    if c[g + B_UNITS] > 0.0:
        convert(c, g, row, 0)
    if c[a + B_UNITS] > 0.0:
        convert(c, a, row, 3)


@kernel("void(float64[::1], float64, float64[::1], float64[::1])")
def chain_imu(c: Float, t: float, row: Float, stage: Float) -> None:
    """Calibrate and filter one IMU sample in place; row: shape (ROW_WIDTH,), checked; t in ns."""
    dt = (t - c[K_BLOCKS + B_T_LAST]) * 1e-9
    changed = clock(c, GYRO, t)
    if clock(c, ACCEL, t) or changed:
        before = c[K_BLOCKS + B_DELAY] + c[K_BLOCKS + B_SIZE + B_DELAY]
        retime(c, GYRO)
        retime(c, ACCEL)
        align_imu(c)
        if c[K_BLOCKS + B_DELAY] + c[K_BLOCKS + B_SIZE + B_DELAY] != before:
            c[K_CHANGED] = 1.0
    calibrate_imu(c, row)
    filter_sensor(c, GYRO, dt, row, 0, stage, G_FIRST)
    filter_sensor(c, ACCEL, dt, row, 3, stage, G_SECOND)


@kernel("float64(float64[::1], int64, float64, float64[::1], int64, float64[::1])")
def chain_aid(c: Float, sensor: int, t: float, row: Float, first: int, stage: Float) -> float:
    """Filter one aid's sample in place; return the delay of its filters, s."""
    b = K_BLOCKS + sensor * B_SIZE
    dt = (t - c[b + B_T_LAST]) * 1e-9
    if clock(c, sensor, t):
        retime(c, sensor)
    filter_sensor(c, sensor, dt, row, first, stage, G_FIRST)
    return float(c[b + B_DELAY])


@kernel("float64(float64[::1], float64, float64[::1], float64[::1])")
def chain_baro(c: Float, t: float, row: Float, stage: Float) -> float:
    """Calibrate and filter one baro height (row[1], m) in place; return its delay, s."""
    row[1] -= c[K_CAL + C_BARO]
    return float(chain_aid(c, BARO, t, row, 1, stage))


@kernel("float64(float64[::1], float64, float64[::1], float64[::1])")
def chain_airspeed(c: Float, t: float, row: Float, stage: Float) -> float:
    """Calibrate and filter one airspeed sample in place, convert it to true airspeed; return its delay, s.

    Filtered is the differential pressure, in which the sensor is linear; a board that sends only a speed has that
    filtered. A board's own speed does not know of our calibration and gives way to the pressure.
    """
    b = K_BLOCKS + AIRSPEED * B_SIZE
    quantity = 0.0 if math.isfinite(row[0]) else 1.0
    if quantity != c[b + B_QUANTITY]:
        c[b + B_QUANTITY], c[b + B_FILLED] = quantity, 0.0
    if quantity == 1.0:
        delay = chain_aid(c, AIRSPEED, t, row, 1, stage)
        if stage.shape[0] > 0:
            stage[G_FIRST] = stage[G_FIRST + 3] = stage[G_FIRST + 6] = math.nan
            stage[G_FIRST + 1] = row[1]
        return float(delay)
    row[0] -= c[K_CAL + C_DIFF_PRESSURE]
    delay = chain_aid(c, AIRSPEED, t, row, 0, stage)
    row[1] = airspeed_from_pressure(row[0], air_density(c[K_PRESSURE], row[2]))
    if stage.shape[0] > 0:
        stage[G_FIRST + 1] = row[1]
    return float(delay)
