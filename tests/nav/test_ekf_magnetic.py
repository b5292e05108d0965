"""The magnetic block of the main lane: what a turn shows of the hard iron and the declination, and what it must not."""

import math

import numpy as np
import pytest

from server.nav.ekf.states import FIELD, MAG_BIAS, X_FIELD, X_MAG_BIAS
from server.nav.types import Aid, AidStatus, Kind

from .ekf_flights import Sensors, rest, s_turns, stream_of
from .ekf_flown import fly, heading_error

KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
TURNS, REST = s_turns(), rest()
IRONS = [(0.010, 0.0, 0.0), (0.0, -0.010, 0.0), (0.0, 0.0, 0.010), (0.006, -0.006, 0.006)]


@pytest.mark.parametrize("iron", IRONS)
def test_hard_iron_is_learned_in_turning_flight(iron: tuple[float, float, float]) -> None:
    """Ten milligauss, two and a half σ of what a calibration leaves: an error of 2° until the vehicle turns."""
    flown = fly(stream_of(TURNS, Sensors(hard_iron_gauss=iron)).block(), **KNOWN)
    error = np.abs(flown.states(X_MAG_BIAS, 3) - iron)
    sigma = flown.sigmas(MAG_BIAS, 3)
    assert (error < 3.0 * sigma).all()
    assert error.max() < 1e-3
    assert sigma.max() < 1.5e-3
    late = flown.t_s > 40.0
    assert np.degrees(np.abs(heading_error(flown, TURNS)[late])).max() < 0.5


@pytest.mark.parametrize("iron", IRONS[:2])
def test_at_rest_nothing_tells_iron_from_heading(iron: tuple[float, float, float]) -> None:
    """The sensor sees their sum: the bias keeps its σ and the heading says that it may be wrong."""
    short = fly(stream_of(rest(8.0), Sensors(hard_iron_gauss=iron)).block(), **KNOWN)
    flown = fly(stream_of(REST, Sensors(hard_iron_gauss=iron)).block(), **KNOWN)
    assert np.abs(flown.states(X_MAG_BIAS, 3)).max() < 5e-4
    assert (flown.sigmas(MAG_BIAS, 3) > 0.97 * short.sigmas(MAG_BIAS, 3)).all()
    assert abs(heading_error(flown, REST)[-1]) < 3.0 * flown.rows[-1, 12]


@pytest.mark.parametrize("declination_deg", [-0.5, 0.5, 1.0])
def test_the_models_declination_error_is_learned_in_the_field_state(declination_deg: float) -> None:
    angle = math.radians(declination_deg)
    field = (0.25 * math.cos(angle), 0.25 * math.sin(angle), 0.433)
    flown = fly(stream_of(TURNS, Sensors(field_n_gauss=field)).block(), **KNOWN)
    north, east = flown.states(X_FIELD, 2)
    sigma = flown.sigmas(FIELD + 1, 1)[0] / 0.25
    assert math.atan2(east, north) == pytest.approx(angle, abs=max(3.0 * sigma, 1e-3))
    assert math.degrees(sigma) < 0.15
    late = flown.t_s > 40.0
    assert np.degrees(np.abs(heading_error(flown, TURNS)[late])).max() < 0.25


def test_a_declination_that_is_not_to_be_learned_stays_the_models() -> None:
    angle = math.radians(0.5)
    field = (0.25 * math.cos(angle), 0.25 * math.sin(angle), 0.433)
    given = {"ins_ekf": {"declination_sigma_rad": 0.0}}
    flown = fly(stream_of(TURNS, Sensors(field_n_gauss=field)).block(), lane_parameters=given, **KNOWN)
    free = fly(stream_of(TURNS, Sensors(field_n_gauss=field)).block(), **KNOWN)
    assert abs(flown.states(X_FIELD + 1, 1)[0]) < abs(free.states(X_FIELD + 1, 1)[0])
    early = flown.t_s < 12.0  # before the first motion both hold what they were told
    np.testing.assert_allclose(flown.rows[early, 6], free.rows[early, 6], atol=1e-3, equal_nan=True)


def test_without_a_magnetometer_the_block_does_not_exist() -> None:
    absent = fly(stream_of(TURNS, Sensors(mag_hz=None)).block(), **KNOWN)
    assert not absent.has(MAG_BIAS)
    assert not fly(stream_of(TURNS).block(), use_mag=False, **KNOWN).has(MAG_BIAS)
    assert fly(stream_of(TURNS).block(), **KNOWN).has(MAG_BIAS)


def test_a_field_of_another_strength_is_refused_and_moves_nothing() -> None:
    """Five seconds beside something of steel: 30 % stronger is no crustal anomaly."""
    clean = fly(stream_of(TURNS).block(), **KNOWN)
    stream = stream_of(TURNS)
    for row in stream.rows:
        if row[3] == Kind.MAG and 50.0 <= row[4] < 55.0:
            row[5][:] = [1.3 * value for value in row[5]]
    flown = fly(stream.block(), **KNOWN)
    assert set(flown.statuses(Aid.MAG_FIELD, 50.0, 54.9)) == {AidStatus.REFUSED_DISTURBED}
    assert AidStatus.REFUSED_DISTURBED not in flown.statuses(Aid.MAG_FIELD, 55.1)
    moved = np.degrees(np.abs(heading_error(flown, TURNS) - heading_error(clean, TURNS))[flown.t_s > 50.0])
    assert moved.max() < 0.2


@pytest.mark.parametrize(("angle_deg", "status"), [(40.0, AidStatus.REFUSED_DISTURBED), (17.0, AidStatus.REFUSED_GATE)])
def test_a_field_of_the_right_strength_and_wrong_direction_is_refused(angle_deg: float, status: AidStatus) -> None:
    """A turn about the vertical keeps strength and dip: far off it contradicts the heading, less far the gate."""
    stream = stream_of(TURNS)
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    for row in stream.rows:
        if row[3] == Kind.MAG and 50.0 <= row[4] < 51.0:
            x, y = row[5][0], row[5][1]
            row[5][:2] = [c * x - s * y, s * x + c * y]
    flown = fly(stream.block(), **KNOWN)
    assert set(flown.statuses(Aid.MAG_FIELD, 50.0, 50.9)) == {status}
    late = flown.t_s > 50.0
    assert np.degrees(np.abs(heading_error(flown, TURNS)[late])).max() < 0.5
