"""The RTK drive as a sensor folder: clock, mounting and the receiver's own lag, proven by the motion of a car."""

from pathlib import Path

import numpy as np
import pytest

from tests.sets import laws, rtk_drive
from tests.sets.folder import Floats

G_M_S2 = 9.796  # at 40° and 1600 m


@pytest.fixture(scope="module")
def drive(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rtk_drive.write(shared_data, tmp_path_factory.mktemp("rtk_drive"))


def imu_delay_s(imu: laws.Table, column: str, steps: tuple[Floats, Floats], chosen: np.ndarray) -> tuple[float, float]:
    """Return how late an IMU column is against its `steps` (stamps, change between them), and the best correlation."""
    felt, (t_s, wanted) = laws.running_integral(imu.t_s, imu.columns[column]), steps

    def unlike(delay_s: float) -> float:
        change = np.diff(np.interp(t_s + delay_s, imu.t_s, felt))
        return -float(np.corrcoef(change[chosen], wanted[chosen])[0, 1])

    grid = np.arange(-0.16, 0.161, 0.02)
    return laws.lowest(unlike, grid), -min(unlike(float(x)) for x in grid)


def car_motion(folder: Path) -> tuple[Floats, dict[str, Floats], np.ndarray]:
    """Return stamps of the velocities, what each IMU column should gain between them, and where that is sure."""
    t_s, velocity = laws.velocity_n_m_s(laws.Table(folder, "reference"))
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    course = np.diff(np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])))
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    climb = -0.5 * (velocity[1:, 2] + velocity[:-1, 2]) / np.maximum(mean_speed, 1.0)
    gains = {"gyro_z_rad_s": course, "accel_y_m_s2": mean_speed * course}
    gains["accel_x_m_s2"] = np.diff(speed) + G_M_S2 * climb * np.diff(t_s)
    imu = laws.Table(folder, "imu").t_s
    return t_s, gains, (mean_speed > 3.0) & (t_s[:-1] > imu[0] + 1) & (t_s[1:] < imu[-1] - 1)


def test_a_standing_car_is_level_and_feels_gravity_from_below(drive: Path) -> None:
    imu = laws.Table(drive, "imu")
    first = imu.vectors("accel", "m_s2")[imu.t_s < imu.t_s[0] + 8.0].mean(axis=0)
    assert np.linalg.norm(first) == pytest.approx(G_M_S2, abs=0.2)
    assert first[2] < 0
    assert abs(np.degrees(np.arctan2(first[:2], -first[2]))).max() < 2.0


def test_accelerometer_forward_and_right_fit_the_receiver_without_delay(drive: Path) -> None:
    t_s, gains, chosen = car_motion(drive)
    for column in ("accel_x_m_s2", "accel_y_m_s2"):
        delay_s, correlation = imu_delay_s(laws.Table(drive, "imu"), column, (t_s, gains[column]), chosen)
        assert correlation > 0.95
        assert abs(delay_s) < 0.02


def test_the_yaw_rate_is_the_rate_of_the_course(drive: Path) -> None:
    t_s, gains, chosen = car_motion(drive)
    imu = laws.Table(drive, "imu")
    delay_s, correlation = imu_delay_s(imu, "gyro_z_rad_s", (t_s, gains["gyro_z_rad_s"]), chosen)
    assert correlation > 0.97
    assert abs(delay_s) < 0.08  # the course of a point ahead of the rear axle leads the yaw
    change = np.diff(np.interp(t_s, imu.t_s, laws.running_integral(imu.t_s, imu.columns["gyro_z_rad_s"])))
    assert np.polyfit(gains["gyro_z_rad_s"][chosen], change[chosen], 1)[0] == pytest.approx(1.0, abs=0.05)


def test_the_published_clock_drifts_where_the_tags_do_not(shared_data: Path) -> None:
    apart = rtk_drive.imu_seconds(shared_data, "published") - rtk_drive.imu_seconds(shared_data, "tags")
    assert apart[0] == 0.0
    assert apart[-1] == pytest.approx(0.14, abs=0.02)
    assert rtk_drive.counter_rate(*rate_arguments(shared_data)) == pytest.approx(1.0 + 13e-6, abs=3e-6)


def rate_arguments(shared_data: Path) -> tuple[Floats, np.ndarray, np.ndarray]:
    rows, ends = rtk_drive.load_imu(shared_data)
    return rows[:, 6], ends, rtk_drive.load_tags(shared_data)[1]


def test_the_receivers_velocities_are_half_an_interval_old(drive: Path) -> None:
    assert laws.velocity_age_s(laws.Table(drive, "gnss")) == pytest.approx(rtk_drive.VELOCITY_AGE_S, abs=0.01)


def test_velocities_in_rows_of_their_own_are_of_their_stamps(shared_data: Path, drive: Path, tmp_path: Path) -> None:
    parted = rtk_drive.write(shared_data, tmp_path, velocity_age_s=rtk_drive.VELOCITY_AGE_S)
    assert abs(laws.velocity_age_s(laws.Table(parted, "gnss"))) < 0.01
    assert abs(laws.velocity_age_s(laws.Table(drive, "reference"))) < 0.01


def test_heights_and_vertical_velocities_agree(drive: Path) -> None:
    gnss = laws.Table(drive, "gnss")
    climbed = laws.running_integral(gnss.t_s, -gnss.columns["vel_d_m_s"])
    height = gnss.columns["alt_m"] - gnss.columns["alt_m"][0]
    assert np.ptp(height) > 5.0
    assert np.std(height - climbed) < 0.1 * np.std(height)


def test_fixed_and_float_solutions_are_told_apart(drive: Path) -> None:
    fix_type = laws.Table(drive, "gnss").columns["fix_type"]
    assert dict(zip(*np.unique(fix_type, return_counts=True), strict=True)) == {5.0: 8, 6.0: 2189}
