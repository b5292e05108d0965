"""Which message a quantity is taken from, and that an old value repeated is not a sample."""

import math

import pytest

from server.nav.types import Kind
from server.protocol.mavlink import MavlinkProtocol
from tests.protocol.peer import Row, Writer, decoded, rows_of

GAUSS_HERE = {"xmag": 0.2, "ymag": 0.01, "zmag": 0.43}


class Board(Writer):
    """An ArduPilot copter that has said so."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.stream = self("HEARTBEAT", type=2, autopilot=3)

    def say(self, name: str, **fields: float) -> None:
        self.stream += self(name, **fields)

    def highres(self, t_ms: float, **fields: float) -> None:
        values = {"zacc": -9.8, "abs_pressure": 1000.0, **GAUSS_HERE, **fields}
        self.say("HIGHRES_IMU", time_usec=round(t_ms * 1000), **values)

    def raw(self, t_ms: float, **fields: float) -> None:
        self.say("RAW_IMU", time_usec=round(t_ms * 1000), **{"zacc": -1000, "xmag": 200, **fields})

    def rows(self, kind: Kind) -> list[Row]:
        return rows_of(decoded(self.stream), kind)


def test_raw_imu_waits_half_a_second_for_highres_imu_and_then_steps_in_with_its_units() -> None:
    board = Board()
    for t_ms in range(1000, 2000, 100):
        board.raw(t_ms, xgyro=17, yacc=-250, temperature=2678)
    rows = board.rows(Kind.IMU)
    assert [row["t_ns"] for row in rows] == [t * 1_000_000 for t in range(1500, 2000, 100)]
    assert rows[0]["gyro_x_rad_s"] == pytest.approx(0.017)
    assert rows[0]["accel_y_m_s2"] == pytest.approx(-0.25 * 9.80665)
    assert rows[0]["accel_z_m_s2"] == pytest.approx(-9.80665)
    assert rows[0]["temperature_degc"] == pytest.approx(26.78)
    (mag,) = board.rows(Kind.MAG)
    assert mag["mag_x_gauss"] == pytest.approx(0.2)


def test_once_highres_imu_comes_the_truncated_integers_are_ignored() -> None:
    board = Board()
    for k in range(30):
        board.raw(1000 + 100 * k)
        if k >= 10:
            board.highres(1000 + 100 * k + 3, xacc=0.001)
    stamps = [row["t_ns"] // 1_000_000 for row in board.rows(Kind.IMU)]
    assert stamps == [*range(1500, 2100, 100), *range(2003, 4003, 100)]


def test_without_highres_imu_for_two_seconds_of_board_time_the_integers_come_back() -> None:
    board = Board()
    board.highres(1000)
    for t_ms in range(1100, 4000, 100):
        board.raw(t_ms)
    stamps = [row["t_ns"] // 1_000_000 for row in board.rows(Kind.IMU)]
    assert stamps == [1000, *range(3100, 4000, 100)]


def test_scaled_imu_steps_in_where_raw_imu_has_no_units() -> None:
    board = Board()
    board.stream = board("HEARTBEAT", type=1, autopilot=12)  # PX4
    for t_ms in range(1000, 2000, 100):
        board.raw(t_ms, xacc=30_000)
        board.say("SCALED_IMU", time_boot_ms=t_ms, zacc=-1000, xgyro=-5, zmag=430, temperature=4100)
    rows = board.rows(Kind.IMU)
    assert len(rows) == 5
    assert (rows[0]["gyro_x_rad_s"], rows[0]["accel_x_m_s2"]) == (-0.005, 0.0)
    assert rows[0]["temperature_degc"] == pytest.approx(41.0)
    assert board.rows(Kind.MAG)[0]["mag_z_gauss"] == pytest.approx(0.43)


@pytest.mark.parametrize("name", ["SCALED_IMU2", "SCALED_IMU3"])
def test_a_second_imu_serves_where_there_is_nothing_else(name: str) -> None:
    board = Board()
    for t_ms in range(1000, 2000, 100):
        board.say(name, time_boot_ms=t_ms, zacc=-1000)
    assert len(board.rows(Kind.IMU)) == 5


def test_the_second_imu_in_highres_imu_is_not_mixed_into_the_first() -> None:
    board = Board()
    for k in range(10):
        board.highres(1000 + 10 * k)
        board.highres(1001 + 10 * k, xacc=5.0, id=1)
    assert {row["accel_x_m_s2"] for row in board.rows(Kind.IMU)} == {0.0}


def test_a_repeated_stamp_is_dropped_and_counted() -> None:
    board = Board()
    for t_ms in (1000, 1003, 1003, 1006):
        board.highres(t_ms)
    protocol = MavlinkProtocol(talk=False)
    (block,) = protocol.feed(board.stream, 0).blocks
    assert len(rows_of([block], Kind.IMU)) == 3
    assert protocol.stats.repeated_samples == 1 + 3 + 3  # and three magnetometer and three baro values


def test_repeated_values_of_magnetometer_and_baro_are_one_sample() -> None:
    board = Board()
    for k in range(40):
        board.highres(1000 + 3 * k, xmag=0.2 + 0.001 * (k // 10), abs_pressure=1000.0 + k // 20)
    assert [row["t_ns"] // 1_000_000 for row in board.rows(Kind.MAG)] == [1000, 1030, 1060, 1090]
    assert [row["pressure_pa"] for row in board.rows(Kind.BARO)] == [100_000.0, 100_100.0]
    assert len(board.rows(Kind.IMU)) == 40


def test_the_field_is_passed_on_as_reported_whatever_its_scale() -> None:
    board = Board()
    board.highres(1000, xmag=194530.0)
    assert board.rows(Kind.MAG)[0]["mag_x_gauss"] == 194530.0


def test_a_board_without_magnetometer_or_baro_gives_none() -> None:
    board = Board()
    board.highres(1000, xmag=0.0, ymag=0.0, zmag=0.0, abs_pressure=0.0)
    assert board.rows(Kind.MAG) == board.rows(Kind.BARO) == []
    assert len(board.rows(Kind.IMU)) == 1


def test_scaled_pressure_serves_as_baro_only_without_highres_imu() -> None:
    alone, both = Board(), Board()
    for k in range(20):
        alone.say("SCALED_PRESSURE", time_boot_ms=1000 + 50 * k, press_abs=900.0 + k, temperature=2931)
        both.highres(1000 + 50 * k, abs_pressure=1000.0 + k)
        both.say("SCALED_PRESSURE", time_boot_ms=1000 + 50 * k, press_abs=900.0 + k)
    rows = alone.rows(Kind.BARO)
    assert [row["pressure_pa"] for row in rows] == [90_000.0 + 100 * k for k in range(10, 20)]
    assert rows[0]["temperature_degc"] == pytest.approx(29.31)
    assert [row["pressure_pa"] for row in both.rows(Kind.BARO)] == [100_000.0 + 100 * k for k in range(20)]


def test_attitude_in_angles_serves_where_no_quaternion_comes() -> None:
    board = Board()
    roll, pitch, yaw = 0.3, -0.2, 2.5
    for t_ms in range(1000, 1700, 100):
        board.say("ATTITUDE", time_boot_ms=t_ms, roll=roll, pitch=pitch, yaw=yaw)
    row = board.rows(Kind.ONBOARD)[0]
    w, x, y, z = (row[f"q_{axis}"] for axis in "wxyz")
    assert row["t_ns"] == 1_500_000_000
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(roll, abs=1e-6)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(pitch, abs=1e-6)
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(yaw, abs=1e-6)
    board.say("ATTITUDE_QUATERNION", time_boot_ms=1700, q1=-1.0)
    board.say("ATTITUDE", time_boot_ms=1710, yaw=1.0)
    rows = board.rows(Kind.ONBOARD)
    assert (rows[-1]["t_ns"], rows[-1]["q_w"]) == (1_700_000_000, 1.0)


def test_sim_state_has_no_stamp_of_its_own() -> None:
    board = Board()
    board.say("SIM_STATE", q1=1.0, lat=0.1, alt=1.0)  # before any attitude: no stamp to take
    board.say("ATTITUDE_QUATERNION", time_boot_ms=1000, q1=1.0)
    board.say("SIM_STATE", q1=-0.5, q4=0.5, lat=473977408.0, lon=85455936.0, alt=488.1, vd=-1.5)
    board.say("SIM_STATE", q1=1.0, lat=1.0)  # the same stamp again
    board.say("ATTITUDE_QUATERNION", time_boot_ms=1010, q1=1.0)
    board.say("SIM_STATE", q1=1.0, lat=473977408.0, lon=85455936.0, lat_int=473977420, lon_int=85455940)
    first, second = board.rows(Kind.REFERENCE)
    assert (first["t_ns"], second["t_ns"]) == (1_000_000_000, 1_010_000_000)
    assert (first["q_w"], first["q_z"], first["vel_d_m_s"]) == (0.5, -0.5, -1.5)
    assert (first["lat_deg"], first["lon_deg"]) == pytest.approx((47.3977408, 8.5455936), abs=1e-12)
    assert (second["lat_deg"], second["lon_deg"]) == pytest.approx((47.3977420, 8.5455940), abs=1e-12)


def test_airspeed_needs_the_sensor_bit_and_a_new_value() -> None:
    board = Board()
    board.say("SCALED_PRESSURE", time_boot_ms=1000, press_diff=0.5)
    board.say("SYS_STATUS", onboard_control_sensors_present=16 | 1)
    for t_ms, hpa in ((1050, 0.5), (1100, 0.5), (1150, 0.75)):
        board.say("SCALED_PRESSURE", time_boot_ms=t_ms, press_diff=hpa)
    board.say("SYS_STATUS", onboard_control_sensors_present=1)
    board.say("SCALED_PRESSURE", time_boot_ms=1200, press_diff=1.0)
    rows = board.rows(Kind.AIRSPEED)
    assert [(row["t_ns"] // 1_000_000, row["diff_pressure_pa"]) for row in rows] == [(1050, 50.0), (1150, 75.0)]
    assert math.isnan(rows[0]["temperature_degc"])


def test_a_clock_that_was_never_set_gives_no_date_and_nine_hours_give_a_second_one() -> None:
    board = Board()
    for k, unix_s in enumerate((0, 3600, 1_700_000_000, 1_700_000_001, 1_700_040_000)):
        board.say("SYSTEM_TIME", time_unix_usec=unix_s * 1_000_000, time_boot_ms=1000 + 1000 * k)
    assert [row["t_ns"] // 1_000_000_000 for row in board.rows(Kind.DATE)] == [3, 5]


def test_imu_stamps_in_unix_time_are_moved_onto_the_boards_clock() -> None:
    board = Board()
    board.say("ATTITUDE_QUATERNION", time_boot_ms=7000, q1=1.0)
    for k in range(5):
        board.highres(1.7e12 + 4 * k)
    assert [row["t_ns"] for row in board.rows(Kind.IMU)] == [7_000_000_000 + 4_000_000 * k for k in range(5)]
