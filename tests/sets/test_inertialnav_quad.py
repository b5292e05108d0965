"""The two quadcopter flights as sensor folders: frames, signs, units, and how late the receiver is."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from server.magnetic import wmm_field
from tests.sets import inertialnav_quad, laws

LAT_DEG, LON_DEG, YEAR = -37.86, 144.72, 2014.6
AGREEMENT = {106: 0.95, 123: 0.6}  # 123 hovers: its steps are near the 0.9 m the longitude was written to
Written = Callable[[int], Path]
flights = pytest.mark.parametrize("flight", inertialnav_quad.FLIGHTS)


@pytest.fixture(scope="module")
def written(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Written:
    out = {f: inertialnav_quad.write(shared_data, tmp_path_factory.mktemp("quad"), f) for f in inertialnav_quad.FLIGHTS}
    return out.__getitem__


@flights
def test_the_gyro_turns_as_the_autopilot_said(written: Written, flight: int) -> None:
    assert np.median(laws.gyro_against_reference_deg(written(flight))) < 0.4


@flights
def test_unaccelerated_the_specific_force_points_up(written: Written, flight: int) -> None:
    assert laws.rest_accel_n_m_s2(written(flight)).mean(axis=0) == pytest.approx([0.0, 0.0, -9.8], abs=0.15)


@flights
def test_the_field_is_melbournes_which_points_up(written: Written, flight: int) -> None:
    field = laws.field_n_gauss(written(flight))
    model = np.array(wmm_field(LAT_DEG, LON_DEG, 50.0, YEAR)[0])
    assert field.std(axis=0).max() < 0.03
    assert field.mean(axis=0) == pytest.approx(model, abs=0.06)
    assert field.mean(axis=0)[2] < -0.5


@flights
def test_positions_move_with_the_velocities(written: Written, flight: int) -> None:
    gnss = laws.Table(written(flight), "gnss")
    t_s, position = laws.position_n_m(gnss)
    travelled = laws.running_integral(t_s, laws.velocity_n_m_s(gnss)[1])
    moved, summed = position[50:] - position[:-50], travelled[50:] - travelled[:-50]
    for axis in range(2):
        assert np.corrcoef(moved[:, axis], summed[:, axis])[0, 1] > AGREEMENT[flight]


@flights
def test_baro_gnss_height_and_vertical_velocity_rise_together(written: Written, flight: int) -> None:
    gnss, baro = laws.Table(written(flight), "gnss"), laws.Table(written(flight), "baro")
    height = np.interp(gnss.t_s, baro.t_s, baro.columns["altitude_m"])
    assert np.corrcoef(height, gnss.columns["alt_m"])[0, 1] > 0.9
    assert np.corrcoef(height[10:] - height[:-10], gnss.columns["vel_d_m_s"][5:-5])[0, 1] < -0.4


@flights
def test_the_receivers_velocity_is_late_by_a_quarter_of_a_second(written: Written, flight: int) -> None:
    assert laws.velocity_delay_s(written(flight)) == pytest.approx(0.26, abs=0.08)
