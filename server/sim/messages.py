"""Which messages the demo board can send and what stands in them: sensor blocks → payloads."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from server.nav.types import Float, Int
from server.sim import earth, gnss, wire
from server.sim.onboard import Onboard
from server.sim.path import PERIOD_S, REST_S, STAND_S
from server.sim.sensors import SLOW, SensorBlock

START_UNIX_S: Final = 1_780_228_800
"""2026-05-31 12:00 UTC: when the board was powered up. Fixed, so that equal settings give equal bytes."""
ALL_FIELDS: Final = 0x1FFF
UNKNOWN_U16: Final = 0xFFFF
SENSORS: Final = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
    | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | dialect.MAV_SYS_STATUS_SENSOR_GPS
)
ARMED_FROM_S: Final = STAND_S - 3.0
ARMED_UNTIL_S: Final = PERIOD_S - REST_S + 2.0
FLIGHT_TEXTS: Final[dict[int, str]] = {
    round(ARMED_FROM_S * 1000): "Arming motors",
    round(STAND_S * 1000): "Demo flight: take-off",
    round((PERIOD_S - REST_S) * 1000): "Demo flight: landed",
    round(ARMED_UNTIL_S * 1000): "Disarming motors",
}
"""What the board says, by milliseconds into each flight."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What the messages are written from."""

    block: SensorBlock
    onboard: Onboard

    def rows(self, tick: Int) -> Int:
        """Return the rows of `block.state` at the given ticks."""
        return tick - self.block.first_tick


def heartbeat(scene: Scene, tick: Int) -> list[bytes]:
    """HEARTBEAT of an ArduPilot quadrotor in its automatic mode."""
    out = []
    for t_ms in tick.tolist():
        armed = _armed(t_ms, scene.block.flight_from_ms)
        mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
        mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        status = dialect.MAV_STATE_ACTIVE if armed else dialect.MAV_STATE_STANDBY
        kind, pilot = dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        out.append(wire.HEARTBEAT.payload(dialect.COPTER_MODE_AUTO, kind, pilot, mode, status, 3))
    return out


def _armed(t_ms: int, flight_from_ms: int | None) -> bool:
    if flight_from_ms is None:
        return False
    phase_s = ((t_ms - flight_from_ms) * 1e-3) % PERIOD_S
    return ARMED_FROM_S <= phase_s < ARMED_UNTIL_S


def highres_imu(scene: Scene, tick: Int) -> list[bytes]:
    """HIGHRES_IMU in its specified units: m/s², rad/s, gauss, hPa, °C."""
    block = scene.block
    part = scene.rows(tick) // SLOW
    imu = block.imu[scene.rows(tick) - 1]
    hpa = block.baro_pa * 1e-2
    air = np.stack([hpa, np.zeros(3), 44330.8 * (1.0 - (hpa / 1013.25) ** 0.190263)], axis=1)
    table = np.concatenate([imu[:, 3:], imu[:, :3], block.mag_gauss[part], air[part]], axis=1).tolist()
    warm = block.temperature_degc
    pack = wire.HIGHRES_IMU.payload
    return [pack(t_ms * 1000, *row, warm, ALL_FIELDS, 0) for t_ms, row in zip(tick.tolist(), table, strict=True)]


def attitude_quaternion(scene: Scene, tick: Int) -> list[bytes]:
    """ATTITUDE_QUATERNION: the emulated on-board estimate."""
    q_nb, _, _ = scene.onboard.rows(scene.block, scene.rows(tick))
    rate = scene.block.imu[scene.rows(tick) - 1, :3] - scene.block.gyro_bias_rad_s
    table = np.concatenate([q_nb, rate], axis=1).tolist()
    pack = wire.ATTITUDE_QUATERNION.payload
    return [pack(t_ms, *row, 0.0, 0.0, 0.0, 0.0) for t_ms, row in zip(tick.tolist(), table, strict=True)]


def sim_state(scene: Scene, tick: Int) -> list[bytes]:
    """SIM_STATE: truth, at the time of the ATTITUDE_QUATERNION before it."""
    state, row = scene.block.state, scene.rows(tick)
    q_nb = state.q_nb[row] * np.where(state.q_nb[row, :1] < 0.0, -1.0, 1.0)
    imu = scene.block.imu_true[row - 1]
    place = earth.geodetic_from_ned(state.pos_n_m[row])
    table = np.concatenate([q_nb, _euler(q_nb), imu[:, 3:], imu[:, :3], place], axis=1).tolist()
    speed, whole = state.vel_n_m_s[row].tolist(), np.rint(place[:, :2] * 1e7).astype(int).tolist()
    pack = wire.SIM_STATE.payload
    return [pack(*a, 0.0, 0.0, *v, *p) for a, v, p in zip(table, speed, whole, strict=True)]


def global_position_int(scene: Scene, tick: Int) -> list[bytes]:
    """GLOBAL_POSITION_INT: the emulated on-board estimate."""
    q_nb, vel, pos = scene.onboard.rows(scene.block, scene.rows(tick))
    place = np.rint(earth.geodetic_from_ned(pos) * [1e7, 1e7, 1e3]).astype(int)
    height = np.rint(-pos[:, 2:] * 1e3).astype(int)
    heading = np.rint(np.degrees(_euler(q_nb)[:, 2:]) * 100.0).astype(int) % 36000
    table = np.concatenate([place, height, np.rint(vel * 100.0).astype(int), heading], axis=1).tolist()
    return [wire.GLOBAL_POSITION_INT.payload(t, *row) for t, row in zip(tick.tolist(), table, strict=True)]


def gps_raw_int(scene: Scene, tick: Int) -> list[bytes]:
    """GPS_RAW_INT: the newest solution the board has."""
    before, fresh = scene.block.fixes
    arrives = scene.block.first_tick + gnss.ARRIVAL_LATE_MS
    return [_gps_raw_int(fresh if t_ms >= arrives else before) for t_ms in tick.tolist()]


def _gps_raw_int(fix: gnss.Fix) -> bytes:
    speed = math.hypot(fix.vel_n_m_s, fix.vel_e_m_s)
    course = math.degrees(math.atan2(fix.vel_e_m_s, fix.vel_n_m_s)) % 360.0
    alt_mm = round(fix.alt_m * 1e3)
    known = fix.stamp_ms > 0
    return wire.GPS_RAW_INT.payload(
        fix.stamp_ms * 1000,
        round(fix.lat_deg * 1e7),
        round(fix.lon_deg * 1e7),
        alt_mm,
        round(fix.hdop * 100.0),
        round(fix.hdop * 140.0) if known else UNKNOWN_U16,
        round(speed * 100.0),
        round(course * 100.0) % 36000,
        fix.fix_type,
        fix.satellites,
        alt_mm + round(earth.GEOID_M * 1e3) if known else 0,
        round(fix.h_acc_m * 1e3),
        round(fix.v_acc_m * 1e3),
        round(fix.s_acc_m_s * 1e3),
        0,
        0,
    )


def scaled_pressure(scene: Scene, tick: Int) -> list[bytes]:
    """SCALED_PRESSURE: hPa and hundredths of °C; zeros for the pressure tube that is not there."""
    row = scene.rows(tick) // SLOW
    hpa = (scene.block.baro_pa[row] * 1e-2).tolist()
    warm = round(scene.block.temperature_degc * 100.0)
    diff_pa = scene.block.diff_pa
    diff_hpa = [0.0] * len(hpa) if diff_pa is None else (diff_pa[row] * 1e-2).tolist()
    tube = 0 if diff_pa is None else warm
    table = zip(tick.tolist(), hpa, diff_hpa, strict=True)
    return [wire.SCALED_PRESSURE.payload(t, p, d, warm, tube) for t, p, d in table]


def system_time(scene: Scene, tick: Int) -> list[bytes]:
    """SYSTEM_TIME: the date is unknown until the first fix."""
    known = scene.block.fixes[0].stamp_ms > 0
    unix_us = [START_UNIX_S * 1_000_000 + t * 1000 if known else 0 for t in tick.tolist()]
    return [wire.SYSTEM_TIME.payload(us, t) for us, t in zip(unix_us, tick.tolist(), strict=True)]


def sys_status(scene: Scene, tick: Int) -> list[bytes]:
    """SYS_STATUS: the GPS bit of the health falls without a fix; the battery lasts 20 minutes, then is full again."""
    lost = 0 if scene.block.fixes[0].fix_type >= 3 else dialect.MAV_SYS_STATUS_SENSOR_GPS
    has = SENSORS if scene.block.diff_pa is None else SENSORS | dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
    out = []
    for t_ms in tick.tolist():
        left = 1.0 - 0.8 * ((t_ms * 1e-3) % 1200.0) / 1200.0
        battery = (round(14000 + 2800 * left), 1800)
        out.append(wire.SYS_STATUS.payload(has, has, has & ~lost, 250, *battery, *[0] * 6, round(100 * left), 0, 0, 0))
    return out


def _euler(q_nb: Float) -> Float:
    """Return roll, pitch, yaw in rad, shape (n, 3)."""
    w, x, y, z = q_nb.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))], axis=1)


@dataclass(frozen=True, slots=True)
class Stream:
    """One message the board can send: at ticks whose remainder by the interval is `phase_ms`, the interval's own."""

    message: wire.Message
    write: Callable[[Scene, Int], list[bytes]]
    default_hz: float
    phase_ms: int = 0


STREAMS: Final[dict[int, Stream]] = {
    stream.message.id: stream
    for stream in (
        Stream(wire.HEARTBEAT, heartbeat, 1.0, 50),
        Stream(wire.HIGHRES_IMU, highres_imu, 333.0),
        Stream(wire.ATTITUDE_QUATERNION, attitude_quaternion, 100.0),
        Stream(wire.SIM_STATE, sim_state, 100.0),  # after ATTITUDE_QUATERNION, whose stamp it goes by
        Stream(wire.GLOBAL_POSITION_INT, global_position_int, 50.0),
        Stream(wire.GPS_RAW_INT, gps_raw_int, 10.0, gnss.ARRIVAL_LATE_MS + 2),
        Stream(wire.SCALED_PRESSURE, scaled_pressure, 10.0),
        Stream(wire.SYSTEM_TIME, system_time, 1.0),
        Stream(wire.SYS_STATUS, sys_status, 2.0),
    )
}
"""By message id, in the order in which they leave within one tick; `default_hz` is what `SimStream` sends unasked."""
