"""Airspeed and sideslip: the wind they find in a circle, and what a pitot tube must not be believed."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from server.nav.ekf.aiding.airspeed import LEAST_M_S, true_airspeed
from server.nav.ekf.states import MAG_BIAS, WIND, X_WIND
from server.nav.types import Aid, AidStatus, Kind, VehicleClass

from .ekf_flights import Motion, Sensors, loiter, ramp, stream_of
from .ekf_flown import Flown, attitude_error, fly, position_error
from .synthetic import Stream

KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
WIND_M_S = (6.0, -4.0)
CIRCLE = loiter(wind_m_s=WIND_M_S)
LONGER = loiter(110.0, wind_m_s=WIND_M_S)
SEA_LEVEL_KG_M3 = 1.225
Tube = Callable[[Stream, Motion, np.random.Generator], None]


def tube(reported: bool, hz: float = 5.0) -> Tube:
    """A pitot tube of 0.3 m/s noise that gives true airspeed, or its pressure at sea level."""

    def add(stream: Stream, motion: Motion, rng: np.random.Generator) -> None:
        t = np.arange(round(motion.duration_s * hz)) / hz
        air = motion.at(t, motion.vel_n)[:, :2] - ramp(t, 10.0, 6.0)[:, None] * np.array(WIND_M_S)
        speed = np.abs(np.linalg.norm(air, axis=1) + 0.3 * rng.standard_normal(len(t)))
        for time, v in zip(t.tolist(), speed.tolist(), strict=True):
            pressure = math.nan if reported else 0.5 * SEA_LEVEL_KG_M3 * v * v
            stream.add(Kind.AIRSPEED, time, [pressure, v if reported else math.nan])

    return add


def circle(extra: Tube | None, vehicle: VehicleClass = VehicleClass.FIXED_WING) -> Flown:
    return fly(stream_of(CIRCLE, Sensors(extra=extra)).block(), vehicle=vehicle, **KNOWN)


@pytest.mark.parametrize("reported", [True, False])
@pytest.mark.parametrize("vehicle", [VehicleClass.FIXED_WING, VehicleClass.MULTIROTOR])
def test_wind_is_found_in_a_circle(reported: bool, vehicle: VehicleClass) -> None:
    """Reported, or from pressure and density alone; with the sideslip of a wing or without."""
    flown = circle(tube(reported), vehicle)
    error = np.abs(flown.states(X_WIND, 2) - WIND_M_S)
    assert (error < 3.0 * flown.sigmas(WIND, 2)).all()
    assert error.max() < 0.5
    assert flown.sigmas(WIND, 2).max() < 1.0
    assert flown.has(WIND)
    late = flown.t_s > 50.0
    assert np.degrees(np.sqrt((attitude_error(flown, CIRCLE)[late] ** 2).mean())) < 0.1


def test_pressure_and_reported_airspeed_say_the_same() -> None:
    np.testing.assert_allclose(circle(tube(True)).states(X_WIND, 2), circle(tube(False)).states(X_WIND, 2), atol=0.05)


def test_density_falls_with_height() -> None:
    """ISA [ICAO Doc 7488]: 1.00655 kg/m³ at 2,000 m, 1.225 at sea level."""
    for height_m, density in ((0.0, 1.225), (2000.0, 1.00655)):
        speed = true_airspeed(0.5 * density * 20.0**2, math.nan, height_m)
        assert speed == pytest.approx(20.0, rel=1e-4)


def test_a_negative_pressure_is_no_speed_and_no_nan() -> None:
    """A tube at rest reads a little under zero: that is zero, and too slow to be believed."""
    assert true_airspeed(-30.0, math.nan, 0.0) == 0.0

    def negative(stream: Stream, motion: Motion, rng: np.random.Generator) -> None:
        for k in range(round(motion.duration_s * 5)):
            stream.add(Kind.AIRSPEED, k / 5, [-30.0, math.nan])

    flown = circle(negative)
    seen = flown.statuses(Aid.AIRSPEED, 12.0)
    assert len(seen) > 300
    assert set(seen) == {AidStatus.REFUSED_NOT_READY}
    observed = flown.aids[(flown.aids[:, 0] == Aid.AIRSPEED) & (flown.aids[:, 15] > 15e9), 2]
    assert (observed == 0.0).all()
    without = circle(None)
    np.testing.assert_array_equal(flown.rows, without.rows)


def test_what_a_slow_tube_says_is_refused() -> None:
    """Exactly those under the least speed, from the moment there is a position on."""
    flown = circle(tube(True))
    mine = (flown.aids[:, 0] == Aid.AIRSPEED) & (flown.aids[:, 15] > 5e9)
    speed, status = flown.aids[mine, 2], flown.aids[mine, 1]
    assert (status[speed < LEAST_M_S] == AidStatus.REFUSED_NOT_READY).all()
    assert (status[speed >= LEAST_M_S] == AidStatus.FUSED).all()
    assert (speed < LEAST_M_S).sum() > 10


def one_sample(pressure_pa: float, tas_m_s: float) -> Flown:
    """The circle with one sample at 40 s."""
    return circle(lambda stream, motion, rng: stream.add(Kind.AIRSPEED, 40.0, [pressure_pa, tas_m_s]))


def test_a_speed_that_no_aircraft_has_is_refused_as_out_of_range() -> None:
    flown = one_sample(math.nan, 1e4)
    assert [int(s) for s in flown.statuses(Aid.AIRSPEED)] == [AidStatus.REFUSED_RANGE]
    np.testing.assert_array_equal(flown.rows, circle(None).rows)


@pytest.mark.parametrize(("pressure_pa", "tas_m_s"), [(math.nan, math.nan), (math.nan, math.inf)])
def test_a_sample_without_a_number_is_no_observation(pressure_pa: float, tas_m_s: float) -> None:
    flown = one_sample(pressure_pa, tas_m_s)
    assert [int(s) for s in flown.statuses(Aid.AIRSPEED)] == [AidStatus.REFUSED_RANGE]


@pytest.mark.parametrize("vehicle", [v for v in VehicleClass if v != VehicleClass.FIXED_WING])
def test_only_a_fixed_wing_flies_where_it_points(vehicle: VehicleClass) -> None:
    flown = circle(None, vehicle)
    assert not len(flown.statuses(Aid.SIDESLIP))
    assert flown.has(WIND) == (vehicle == VehicleClass.MULTIROTOR)  # by its drag


def test_a_fixed_wing_finds_the_wind_from_sideslip_alone_and_only_in_the_air() -> None:
    flown = circle(None)
    error = np.abs(flown.states(X_WIND, 2) - WIND_M_S)
    assert (error < 3.0 * flown.sigmas(WIND, 2)).all()
    assert not len(flown.statuses(Aid.SIDESLIP, end_s=11.0))
    assert (flown.statuses(Aid.SIDESLIP, 20.0) == AidStatus.FUSED).mean() > 0.98


def test_without_airspeed_sideslip_and_drag_the_wind_does_not_exist() -> None:
    off = {"ins_ekf": {"drag_sigma_m_s2": 0.0}}
    stream = stream_of(CIRCLE, Sensors(mag_hz=None))
    flown = fly(stream.block(), vehicle=VehicleClass.MULTIROTOR, lane_parameters=off, **KNOWN)
    assert not flown.has(WIND)
    assert not flown.has(MAG_BIAS)


def test_known_wind_and_airspeed_shorten_the_way_of_an_outage() -> None:
    cheap = {"accel_bias": (0.1, -0.1, 0.1), "gyro_bias": (0.003, -0.002, 0.002), "mag_noise": 3e-3}
    peaks = []
    for use in (True, False):
        flown = fly(
            stream_of(LONGER, Sensors(extra=tube(True), **cheap)).block(),  # type: ignore[arg-type]
            vehicle=VehicleClass.FIXED_WING, use_airspeed=use, gnss_withheld_s=((60.0, 90.0),), t_origin_ns=0, **KNOWN,
        )  # fmt: skip
        during = flown.between(60.0, 90.0)
        error = position_error(flown, LONGER)[during]
        assert (np.abs(error) < 3.0 * flown.rows[during, 16:18]).all()
        peaks.append(np.linalg.norm(error, axis=1).max())
    assert peaks[0] < peaks[1]
