"""What the demo board's messages say: units, delays, outages, errors; from the bytes alone."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from server.magnetic import wmm_field
from server.nav.types import Float
from server.sim import SimSettings, SimStream
from tests.sim.sim_frames import GPS_RAW_INT, by_type, column, decoded, sent


@pytest.fixture(scope="module")
def flight() -> dict[str, list[Any]]:
    """80 s of the default board with an outage, everything it can send."""
    return by_type(sent(SimStream(SimSettings(outages_s=((50.0, 62.0),))), 80.0))


def test_units_are_those_of_the_specification(flight: dict[str, list[Any]]) -> None:
    rest = [m for m in flight["HIGHRES_IMU"] if m.time_usec < 10e6]
    accel = column(rest, "xacc", "yacc", "zacc").mean(axis=0)
    assert np.linalg.norm(accel) == pytest.approx(9.807, abs=0.1)
    assert accel[2] < -9.7
    year = flight["SYSTEM_TIME"][-1].time_unix_usec * 1e-6 / 31_556_952.0 + 1970.0
    field, _ = wmm_field(47.3977, 8.5456, 488.0, year)
    mag = np.linalg.norm(column(flight["HIGHRES_IMU"], "xmag", "ymag", "zmag"), axis=1)
    assert mag.mean() == pytest.approx(float(np.linalg.norm(field)), abs=0.003)
    hpa = column(flight["SCALED_PRESSURE"], "press_abs")
    assert hpa[:100].mean() == pytest.approx(956.0, abs=8.0)
    assert hpa[:100].mean() - hpa[300:500].mean() == pytest.approx(20.0 * 0.114, rel=0.1)
    gps = flight["GPS_RAW_INT"][-1]
    assert gps.alt * 1e-3 == pytest.approx(508.0, abs=4.0)
    assert (gps.alt_ellipsoid - gps.alt) * 1e-3 == pytest.approx(47.3)


def truth(flight: dict[str, list[Any]]) -> tuple[Float, Float]:
    """Times (s) and rows vn, ve, q1..q4, lat, lon of SIM_STATE, stamped by ATTITUDE_QUATERNION."""
    stamp_s = column(flight["ATTITUDE_QUATERNION"], "time_boot_ms")[:, 0] * 1e-3
    return stamp_s, column(flight["SIM_STATE"], "vn", "ve", "q1", "q2", "q3", "q4", "lat_int", "lon_int")


def body_from_ned(q: Float, vector_n: Float) -> Float:
    w, v = q[:, :1], -q[:, 1:]
    return vector_n + 2.0 * np.cross(v, np.cross(v, np.broadcast_to(vector_n, v.shape)) + w * vector_n)


def fresh_fixes(flight: dict[str, list[Any]]) -> list[Any]:
    seen, out = set(), []
    for message in flight["GPS_RAW_INT"]:
        if message.fix_type >= 3 and message.time_usec not in seen:
            seen.add(message.time_usec)
            out.append(message)
    return out


def test_gnss_is_as_late_as_the_ardupilot_profile_declares(flight: dict[str, list[Any]]) -> None:
    t_s, rows = truth(flight)
    fixes = fresh_fixes(flight)
    stamp_s, speed, course = (column(fixes, n)[:, 0] for n in ("time_usec", "vel", "cog"))
    vel = 0.01 * speed * np.stack([np.cos(np.radians(course / 100)), np.sin(np.radians(course / 100))])
    delays_ms = np.arange(60, 140)
    error = [
        sum(np.var(vel[i] - np.interp(stamp_s * 1e-6 - d * 1e-3, t_s, rows[:, i])) for i in range(2)) for d in delays_ms
    ]
    assert abs(delays_ms[int(np.argmin(error))] - 98) <= 5
    assert (len(fixes) - 1) / (80.0 - 2.0 - 12.0) == pytest.approx(5.0, rel=0.03)


def test_a_fix_arrives_about_60_ms_after_its_stamp_and_none_in_the_first_seconds() -> None:
    arrivals: list[tuple[int, int]] = []
    for t_ns, data in SimStream(rates_hz={GPS_RAW_INT: 10.0}).run(8.0):
        (message,) = decoded(data)
        if message.fix_type == 3 and (not arrivals or message.time_usec != arrivals[-1][1]):
            arrivals.append((t_ns, message.time_usec))
        elif t_ns < 2e9:
            assert (message.fix_type, message.time_usec) == (1, 0)
    late_ms = [t_ns * 1e-6 - usec * 1e-3 for t_ns, usec in arrivals]
    assert len(late_ms) == 30
    assert 58.0 <= min(late_ms) <= max(late_ms) <= 68.0


def test_the_magnetometer_is_as_late_as_the_profile_declares_and_changes_ten_times_a_second(
    flight: dict[str, list[Any]],
) -> None:
    t_s, rows = truth(flight)
    mag = column(flight["HIGHRES_IMU"], "xmag", "ymag", "zmag")
    fresh = np.concatenate([[True], np.any(np.diff(mag, axis=0) != 0.0, axis=1)])
    stamp_s = column(flight["HIGHRES_IMU"], "time_usec")[fresh, 0] * 1e-6
    assert fresh.sum() == pytest.approx(800, abs=2)
    field, _ = wmm_field(47.3977, 8.5456, 488.0, 2026.41)
    delays_ms = np.arange(20, 90, 2)
    error = []
    for d in delays_ms:
        q = np.stack([np.interp(stamp_s - d * 1e-3, t_s, rows[:, 2 + i]) for i in range(4)], axis=1)
        error.append(np.var(mag[fresh] - body_from_ned(q, field), axis=0).sum())
    assert abs(delays_ms[int(np.argmin(error))] - 51) <= 5
    assert math.sqrt(min(error) / 3) < 2.5e-3


def test_the_imu_is_as_late_as_the_profile_declares(flight: dict[str, list[Any]]) -> None:
    stamp_s = column(flight["HIGHRES_IMU"], "time_usec")[:, 0] * 1e-6
    yaw_rate = column(flight["HIGHRES_IMU"], "zgyro")[:, 0]
    t_s = truth(flight)[0]
    true = column(flight["SIM_STATE"], "zgyro")[:, 0]
    delays_ms = np.arange(2, 22)
    error = [np.var(yaw_rate - np.interp(stamp_s - d * 1e-3, t_s - 5e-4, true)) for d in delays_ms]
    assert abs(delays_ms[int(np.argmin(error))] - 11) <= 1


def test_in_an_outage_the_fix_is_gone_and_everything_else_goes_stale(flight: dict[str, list[Any]]) -> None:
    """As ArduPilot does it: fix_type 1, the stamp frozen, the last position, velocity and accuracies for ever."""
    lost = [m for m in flight["GPS_RAW_INT"] if m.fix_type == 1 and m.time_usec > 0]
    assert len(lost) == 120
    names = ("time_usec", "lat", "lon", "alt", "vel", "cog", "h_acc", "v_acc", "vel_acc")
    assert len({tuple(getattr(m, n) for n in names) for m in lost}) == 1
    assert lost[0].time_usec == 49_800_000 + 98_000, "the last solution valid before 50 s"
    assert lost[0].h_acc > 0
    back = [m for m in fresh_fixes(flight) if m.time_usec > lost[0].time_usec]
    assert back[0].time_usec == 62_000_000 + 98_000
    gps = dialect.MAV_SYS_STATUS_SENSOR_GPS
    health = [bool(m.onboard_control_sensors_health & gps) for m in flight["SYS_STATUS"]]
    assert not any(health[103:123])
    assert all(health[10:98])


@pytest.mark.parametrize(("rtk", "fix_type"), [(False, 3), (True, 6)])
def test_position_errors_are_those_a_receiver_reports(rtk: bool, fix_type: int) -> None:
    flight = by_type(sent(SimStream(SimSettings(rtk=rtk)), 60.0))
    t_s, rows = truth(flight)
    fixes = fresh_fixes(flight)
    assert {m.fix_type for m in fixes} == {fix_type}
    valid_s = column(fixes, "time_usec")[:, 0] * 1e-6 - 0.098
    error_m = [
        (column(fixes, n)[:, 0] - np.interp(valid_s, t_s, rows[:, 6 + i])) * 1e-7 * math.radians(1.0) * 6.38e6 * c
        for i, (n, c) in enumerate((("lat", 1.0), ("lon", math.cos(math.radians(47.4)))))
    ]
    horizontal_m = float(np.sqrt(np.mean(np.square(error_m[0]) + np.square(error_m[1]))))
    said_m = fixes[0].h_acc * 1e-3
    assert 0.1 * said_m < horizontal_m < 2.0 * said_m


def test_the_onboard_estimate_is_near_the_truth_drifts_blind_and_recovers(flight: dict[str, list[Any]]) -> None:
    t_s, rows = truth(flight)
    onboard = flight["GLOBAL_POSITION_INT"]
    at_s = column(onboard, "time_boot_ms")[:, 0] * 1e-3
    north_m = (column(onboard, "lat")[:, 0] - np.interp(at_s, t_s, rows[:, 6])) * 0.01113
    east_m = (column(onboard, "lon")[:, 0] - np.interp(at_s, t_s, rows[:, 7])) * 0.01113 * 0.677
    error_m = np.hypot(north_m, east_m)
    assert error_m[at_s < 50.0].max() < 1.2
    assert 1.0 < error_m[np.searchsorted(at_s, 61.9)] < 4.0
    assert error_m[at_s > 70.0].max() < 1.2
    q = column(flight["ATTITUDE_QUATERNION"], "q1", "q2", "q3", "q4")
    angle = np.degrees(2 * np.arccos(np.minimum(1.0, np.abs(np.sum(q * rows[:, 2:6], axis=1)))))
    assert 0.05 < angle.mean() < 1.5


def test_an_ideal_boards_messages_integrate_to_its_truth() -> None:
    """Gyro at 333 Hz, through filter and wire, for 60 s: only the Earth's turn and the delay are taken out."""
    found = by_type(sent(SimStream(SimSettings(noise=0.0)), 72.0))
    stamp_s = column(found["HIGHRES_IMU"], "time_usec")[:, 0] * 1e-6
    rate = column(found["HIGHRES_IMU"], "xgyro", "ygyro", "zgyro")
    t_s, rows = truth(found)
    lat = math.radians(47.3977)
    earth_n = 7.292115e-5 * np.array([math.cos(lat), 0.0, -math.sin(lat)])
    start = int(np.searchsorted(stamp_s, 11.0))
    q = np.array([np.interp(stamp_s[start] - 0.011, t_s, rows[:, 2 + i]) for i in range(4)])
    for k in range(start + 1, len(stamp_s)):
        dt_s = stamp_s[k] - stamp_s[k - 1]
        turn = (0.5 * (rate[k] + rate[k - 1]) - body_from_ned(q[None], earth_n)[0]) * dt_s
        (w, x, y, z), (a, b, c) = q.tolist(), 0.5 * turn
        q += np.array([-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a])
        q /= np.linalg.norm(q)
    truth_q = np.array([np.interp(stamp_s[-1] - 0.011, t_s, rows[:, 2 + i]) for i in range(4)])
    apart = 2.0 * math.acos(min(1.0, abs(float(q @ truth_q)) / float(np.linalg.norm(truth_q))))
    assert math.degrees(apart) < 0.03
