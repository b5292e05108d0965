"""The flying wing's folder: frames, signs, units, airspeed against the ground speed, and what counts as aerobatics."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from server.magnetic import wmm_field
from tests.sets import inertialnav_x8, laws

LAT_DEG, LON_DEG, YEAR = -37.96, 144.76, 2013.9


@pytest.fixture(scope="module")
def flight(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return inertialnav_x8.write(shared_data, tmp_path_factory.mktemp("x8"))


def test_the_gyro_turns_as_the_autopilot_said(flight: Path) -> None:
    assert np.median(laws.gyro_against_reference_deg(flight)) < 0.6


def test_unaccelerated_the_specific_force_points_up(flight: Path) -> None:
    assert laws.rest_accel_n_m_s2(flight).mean(axis=0) == pytest.approx([0.0, 0.0, -9.8], abs=0.1)


def test_the_field_with_the_autopilots_offsets_is_melbournes(flight: Path) -> None:
    field = laws.field_n_gauss(flight)
    assert field.std(axis=0).max() < 0.035
    assert field.mean(axis=0) == pytest.approx(np.array(wmm_field(LAT_DEG, LON_DEG, 50.0, YEAR)[0]), abs=0.06)


def test_without_the_autopilots_offsets_the_field_turns_with_the_body(
    shared_data: Path, tmp_path: Path, flight: Path
) -> None:
    raw = laws.field_n_gauss(inertialnav_x8.write(shared_data, tmp_path, raw_mag=True))
    assert raw.std(axis=0).sum() > 3 * laws.field_n_gauss(flight).std(axis=0).sum()


def test_positions_move_with_the_velocities(flight: Path) -> None:
    assert abs(laws.velocity_age_s(laws.Table(flight, "gnss"))) < 0.05


def test_the_receivers_velocity_is_late_by_a_third_of_a_second(flight: Path) -> None:
    assert laws.velocity_delay_s(flight) == pytest.approx(0.32, abs=0.04)


def test_baro_rises_where_the_receiver_does(flight: Path) -> None:
    gnss, baro = laws.Table(flight, "gnss"), laws.Table(flight, "baro")
    height = np.interp(gnss.t_s, baro.t_s, baro.columns["altitude_m"])
    assert np.corrcoef(height, gnss.columns["alt_m"])[0, 1] > 0.95
    assert np.corrcoef(height[10:] - height[:-10], gnss.columns["vel_d_m_s"][5:-5])[0, 1] < -0.6


def test_airspeed_along_the_nose_and_one_constant_wind_make_the_ground_speed(shared_data: Path, flight: Path) -> None:
    gnss, air, R_nb = laws.Table(flight, "gnss"), laws.Table(flight, "airspeed"), laws.attitude(flight)
    t_s, velocity = laws.velocity_n_m_s(gnss)
    t_s = t_s - 0.32
    airspeed = np.interp(t_s, air.t_s, air.columns["tas_m_s"])
    calm = laws.within(R_nb, t_s) & (airspeed > 10.0)
    for start_ns, end_ns in inertialnav_x8.aerobatics_ns(shared_data):
        calm &= ~((t_s * 1e9 >= start_ns) & (t_s * 1e9 < end_ns))
    nose = R_nb(t_s[calm]).apply([1.0, 0.0, 0.0]) * airspeed[calm][:, None]
    wind = (velocity[calm] - nose)[:, :2]
    assert np.linalg.norm(np.std(wind, axis=0)) < 0.25 * np.sqrt(np.mean(np.sum(velocity[calm, :2] ** 2, axis=1)))


def test_outside_the_left_out_intervals_no_attitude_is_steep(shared_data: Path) -> None:
    columns = inertialnav_x8.load(shared_data)
    t_ns = inertialnav_x8.stamps_ns(columns["ATT.TimeMS"])
    intervals = inertialnav_x8.aerobatics_ns(shared_data)
    outside = np.ones(len(t_ns), bool)
    for start_ns, end_ns in intervals:
        outside &= ~((t_ns >= start_ns) & (t_ns < end_ns))
    assert abs(columns["ATT.Roll"][outside]).max() <= 60.0
    assert abs(columns["ATT.Pitch"][outside]).max() <= 45.0
    assert 0.5 < outside.mean() < 0.95
    assert all(before[1] < after[0] for before, after in pairwise(intervals))
