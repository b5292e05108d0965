"""UMN's flight as a sensor folder: airspeed, fixes and the autopilot's estimates, each against another of them."""

from pathlib import Path

import numpy as np
import pytest

from tests.sets import laws, umn

RHO_KG_M3 = 1.225


@pytest.fixture(scope="module")
def flight(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return umn.write(shared_data, tmp_path_factory.mktemp("umn"))


def test_there_is_no_inertial_file_because_there_is_no_inertial_sensor(flight: Path) -> None:
    names = sorted(path.name for path in flight.iterdir())
    assert names == ["airspeed.csv", "gnss.csv", "meta.toml", "reference.csv"]


def test_true_airspeed_is_the_pressures_but_for_the_airs_density(flight: Path) -> None:
    air = laws.Table(flight, "airspeed")
    pressure, speed = air.known("diff_pressure_pa"), air.known("tas_m_s") & (air.columns["tas_m_s"] > 12.0)
    pascals = np.interp(air.t_s[speed], air.t_s[pressure], air.columns["diff_pressure_pa"][pressure])
    ratio = np.median(air.columns["tas_m_s"][speed] / np.sqrt(2.0 * np.maximum(pascals, 1.0) / RHO_KG_M3))
    assert 1.0 < ratio < 1.05


def test_fixes_and_the_autopilots_position_and_velocity_agree(flight: Path) -> None:
    gnss, reference = laws.Table(flight, "gnss"), laws.Table(flight, "reference")
    known = reference.known("lat_deg")
    for column, limit in (
        ("lat_deg", 2e-4),
        ("lon_deg", 2e-4),
        ("vel_n_m_s", 3.0),
        ("vel_e_m_s", 3.0),
        ("vel_d_m_s", 2.0),
    ):
        there = np.interp(gnss.t_s, reference.t_s[known], reference.columns[column][known])
        assert np.sqrt(np.mean((gnss.columns[column] - there) ** 2)) < limit


def test_positions_move_with_the_velocities(flight: Path) -> None:
    assert abs(laws.velocity_age_s(laws.Table(flight, "gnss"))) < 0.05


def test_the_nose_points_along_the_flight(flight: Path) -> None:
    t_s, velocity = laws.velocity_n_m_s(laws.Table(flight, "reference"))
    flying = np.hypot(velocity[:, 0], velocity[:, 1]) > 12.0
    R_nb = laws.attitude(flight)
    chosen = flying & laws.within(R_nb, t_s)
    along = np.sum(R_nb(t_s[chosen]).apply([1.0, 0.0, 0.0]) * velocity[chosen], axis=1)
    assert np.median(along / np.linalg.norm(velocity[chosen], axis=1)) > 0.95
