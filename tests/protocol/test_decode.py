"""Rows against pymavlink's fields on the recorded flight."""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as dialect

from server.nav.types import Kind, SampleBlock, VehicleClass
from server.protocol.mavlink import MavlinkProtocol
from server.protocol.mavlink.position import decimal_year
from tests.protocol.peer import Writer, decoded, feed_all, frame_list, pymavlink_messages, random_cuts, rows_of

NAN = float("nan")


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> bytes:
    """The first fifty seconds or so: standing, first fix of the board's filter, take-off."""
    return b"".join(frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")[:60_000])


@pytest.fixture(scope="module")
def messages(flight: bytes) -> list:
    return [m for m in pymavlink_messages(flight)[0] if m.get_srcSystem() == 1][2:]  # two come before the heartbeat


@pytest.fixture(scope="module")
def blocks(flight: bytes) -> list[SampleBlock]:
    return decoded(flight)


def of(messages: list, name: str) -> list:
    return [m for m in messages if m.get_type() == name]


def columns(blocks: list[SampleBlock], kind: Kind, count: int) -> np.ndarray:
    """t_ns and the first `count` values of every row of a kind."""
    parts = [np.column_stack([b.t_ns[b.kind == kind], b.data[b.kind == kind, :count]]) for b in blocks]
    return np.concatenate(parts)


def test_imu_rows_are_the_floats_of_highres_imu(messages: list, blocks: list[SampleBlock]) -> None:
    expected = [
        (m.time_usec * 1000, m.xgyro, m.ygyro, m.zgyro, m.xacc, m.yacc, m.zacc, m.temperature)
        for m in of(messages, "HIGHRES_IMU")
    ]
    assert len(expected) > 15_000
    np.testing.assert_array_equal(columns(blocks, Kind.IMU, 7), expected)


def test_a_magnetometer_or_baro_row_is_a_new_value_at_the_stamp_where_it_first_shows(
    messages: list, blocks: list[SampleBlock]
) -> None:
    for kind, values in (
        (Kind.MAG, lambda m: (m.xmag, m.ymag, m.zmag)),
        (Kind.BARO, lambda m: (m.abs_pressure * 100.0, NAN, m.temperature)),
    ):
        expected, last = [], None
        for message in of(messages, "HIGHRES_IMU"):
            if values(message)[0] != last:
                expected.append((message.time_usec * 1000, *values(message)))
            last = values(message)[0]
        found = columns(blocks, kind, 3)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        assert 9.0 < (len(found) - 1) / ((found[-1, 0] - found[0, 0]) * 1e-9) < 11.0


def test_gnss_rows_are_the_receivers_five_a_second(messages: list, blocks: list[SampleBlock]) -> None:
    expected, last = [], None
    for m in of(messages, "GPS_RAW_INT"):
        if m.time_usec != last:
            course = math.radians(m.cog / 100)
            north, east = m.vel / 100 * math.cos(course), m.vel / 100 * math.sin(course)
            position = (m.lat / 1e7, m.lon / 1e7, m.alt / 1e3)
            accuracy = (m.h_acc / 1e3, m.v_acc / 1e3, m.vel_acc / 1e3)
            row = (*position, north, east, NAN, *accuracy, m.fix_type, m.satellites_visible)
            expected.append((m.time_usec * 1000, *row))
        last = m.time_usec
    found = columns(blocks, Kind.GNSS, 11)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
    assert set(np.diff(found[:, 0]).round(-7)) == {200e6}


def test_reference_rows_are_sim_state_at_the_attitude_stamp_before_it(
    messages: list, blocks: list[SampleBlock]
) -> None:
    expected, stamp, last = [], None, None
    for m in messages:
        if m.get_type() == "ATTITUDE_QUATERNION":
            stamp = m.time_boot_ms * 1_000_000
        if m.get_type() == "SIM_STATE" and stamp not in (None, last):
            last = stamp
            quat = np.array((m.q1, m.q2, m.q3, m.q4)) * (1 if m.q1 >= 0 else -1)
            expected.append((stamp, *quat, m.lat_int / 1e7, m.lon_int / 1e7, m.alt, m.vn, m.ve, m.vd))
    assert len(expected) > 5_000
    np.testing.assert_allclose(columns(blocks, Kind.REFERENCE, 10), expected, rtol=1e-14)


def test_onboard_rows_are_the_boards_own_attitude_and_position(messages: list, blocks: list[SampleBlock]) -> None:
    found = columns(blocks, Kind.ONBOARD, 10)
    attitude = found[~np.isnan(found[:, 1])]
    expected = [(m.time_boot_ms * 1_000_000, m.q1, m.q2, m.q3, m.q4) for m in of(messages, "ATTITUDE_QUATERNION")]
    np.testing.assert_array_equal(attitude[:, :5], expected)
    assert np.isnan(attitude[:, 5:]).all()
    position = found[np.isnan(found[:, 1])]
    speeds = [(m.vx / 100, m.vy / 100, m.vz / 100) for m in of(messages, "GLOBAL_POSITION_INT")]
    places = [
        (m.time_boot_ms * 1_000_000, m.lat / 1e7, m.lon / 1e7, m.alt / 1e3) for m in of(messages, "GLOBAL_POSITION_INT")
    ]
    np.testing.assert_allclose(position[:, [0, 5, 6, 7]], places, rtol=1e-14)
    np.testing.assert_allclose(position[:, 8:], speeds, rtol=1e-14)


def test_the_profile_is_the_first_row_and_comes_once(blocks: list[SampleBlock]) -> None:
    (profile,) = rows_of(blocks, Kind.PROFILE)
    assert blocks[0].kind[0] == Kind.PROFILE
    assert profile["t_ns"] == blocks[0].t_ns[1]
    delays = [profile[f"{name}_delay_s"] for name in ("imu", "mag", "gnss", "baro")]
    assert delays == [0.011, 0.050, 0.098, 0.0]
    assert profile["vehicle_class"] == VehicleClass.MULTIROTOR


def test_the_date_is_the_recordings(messages: list, blocks: list[SampleBlock]) -> None:
    (date,) = rows_of(blocks, Kind.DATE)
    first = of(messages, "SYSTEM_TIME")[0]
    seconds = datetime.fromtimestamp(first.time_unix_usec / 1e6, UTC)
    year_start = datetime(seconds.year, 1, 1, tzinfo=UTC)
    year = seconds.year + (seconds - year_start) / (datetime(seconds.year + 1, 1, 1, tzinfo=UTC) - year_start)
    assert date["decimal_year"] == pytest.approx(year, abs=1e-9)
    assert date["t_ns"] == first.time_boot_ms * 1_000_000


def test_columns_past_a_kinds_own_are_nan_and_arrays_agree(blocks: list[SampleBlock]) -> None:
    for block in blocks:
        assert len(block.kind) == len(block.t_ns) == len(block.t_rx_ns) == len(block.data)
        assert block.data.flags.c_contiguous
        assert np.isnan(block.data[block.kind == Kind.IMU, 7:]).all()
        assert np.isnan(block.data[block.kind == Kind.DATE, 1:]).all()


@pytest.mark.parametrize("longest", [1, 40, 600, 70_000])
def test_samples_do_not_depend_on_the_cuts(flight: bytes, blocks: list[SampleBlock], longest: int) -> None:
    part = flight[: 60_000 if longest == 1 else 1_500_000]
    whole = decoded(part)
    pieces = feed_all(MavlinkProtocol(talk=False), random_cuts(part, longest, longest))
    for name in ("kind", "t_ns", "data"):
        joined = np.concatenate([getattr(block, name) for block in pieces])
        np.testing.assert_array_equal(joined, np.concatenate([getattr(block, name) for block in whole]))


def test_every_chunk_may_be_one_byte_longer_than_before(flight: bytes) -> None:
    """A block per boot, none without rows."""
    for block in feed_all(MavlinkProtocol(talk=False), random_cuts(flight[:200_000], 1, 100)):
        assert len(block.kind) > 0


def test_differential_pressure_is_airspeed_only_where_the_board_has_the_sensor(shared_data: Path, blocks: list) -> None:
    assert rows_of(blocks, Kind.AIRSPEED) == []
    stream = b"".join(frame_list(shared_data / "ardupilot_sitl" / "static.tlog")[:20_000])
    received = pymavlink_messages(stream)[0]
    start = next(k for k, m in enumerate(received) if m.get_type() == "SYS_STATUS")
    expected, last = [], None
    for m in of(received[start:], "SCALED_PRESSURE"):
        if m.press_diff != last:
            expected.append((m.time_boot_ms * 1_000_000, m.press_diff * 100, NAN, m.temperature_press_diff / 100))
        last = m.press_diff
    assert len(expected) > 100
    np.testing.assert_allclose(columns(decoded(stream), Kind.AIRSPEED, 3), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("when", "year"),
    [
        (datetime(2024, 1, 1, tzinfo=UTC), 2024.0),
        (datetime(2024, 7, 2, tzinfo=UTC), 2024.5),
        (datetime(2025, 12, 31, 12, tzinfo=UTC), 2025 + 364.5 / 365),
        (datetime(2100, 3, 1, tzinfo=UTC), 2100 + 59 / 365),
    ],
)
def test_the_decimal_year_follows_the_calendar(when: datetime, year: float) -> None:
    assert decimal_year(int(when.timestamp() * 1e6)) == pytest.approx(year, abs=1e-9)


@pytest.mark.parametrize("version", [1, 2])
def test_truncated_payloads_are_filled_with_zeros(version: int) -> None:
    writer = Writer(version=version)
    stream = writer("HEARTBEAT", type=2, autopilot=3)
    stream += writer("ATTITUDE_QUATERNION", time_boot_ms=1000, q1=1.0)
    stream += writer("SIM_STATE", q1=1.0, lat=48.5, lon=9.5, alt=3.0)  # no lat_int, and nothing behind alt
    (row,) = rows_of(decoded(stream), Kind.REFERENCE)
    assert row["vel_d_m_s"] == 0.0
    assert (row["lat_deg"], row["lon_deg"], row["alt_m"]) == (48.5, 9.5, 3.0)
    assert row["t_ns"] == 1_000_000_000


def test_every_message_decoded_here_has_the_layout_pymavlink_knows() -> None:
    """Offsets are written down in the decoders; the definitions must not move under them."""
    layouts = {
        "HIGHRES_IMU": "<QfffffffffffffHB",
        "RAW_IMU": "<QhhhhhhhhhBh",
        "SCALED_IMU": "<Ihhhhhhhhhh",
        "SCALED_IMU2": "<Ihhhhhhhhhh",
        "SCALED_IMU3": "<Ihhhhhhhhhh",
        "GPS_RAW_INT": "<QiiiHHHHBBiIIIIH",
        "GLOBAL_POSITION_INT": "<IiiiihhhH",
        "ATTITUDE": "<Iffffff",
        "ATTITUDE_QUATERNION": "<Ifffffff4f",
        "SCALED_PRESSURE": "<Iffhh",
        "SIM_STATE": "<fffffffffffffffffffffii",
        "SYSTEM_TIME": "<QI",
        "HEARTBEAT": "<IBBBBB",
    }
    for name, layout in layouts.items():
        assert getattr(dialect, f"MAVLink_{name.lower()}_message").unpacker.format == layout
