"""Heading without a magnetometer, or against one that lies: from accelerations, or from a car's course."""

import math
from pathlib import Path

import numpy as np
import pytest

from server.nav.types import Kind, VehicleClass

from .ekf_flights import Floats, Sensors, rest, s_turns, stream_of
from .ekf_flown import fly, heading_error
from .ekf_mission import changed, fly_mission, heading_error_deg, mission, truth, without

MOVING_M_S = 1.0
KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}


def first_manoeuvre_s(shared_data: Path) -> float:
    """Return when the flight first moves over ground faster than a walk."""
    _, t_s, velocity = truth(mission(shared_data))
    return float(t_s[np.argmax(np.hypot(velocity[:, 0], velocity[:, 1]) > MOVING_M_S)])


def turned(angle_rad: float):
    """Return a change that turns fields about the body's vertical axis."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)

    def change(rows: Floats) -> None:
        x, y = rows[:, 0].copy(), rows[:, 1].copy()
        rows[:, 0], rows[:, 1] = c * x - s * y, s * x + c * y

    return change


def test_a_multirotor_without_magnetometer_finds_its_heading_from_motion(shared_data: Path) -> None:
    block = mission(shared_data)
    flown = fly_mission(without(block, Kind.MAG))
    assert flown.codes().count("heading-from-motion") == 1
    t_s, error = heading_error_deg(flown, block)
    known_s = first_manoeuvre_s(shared_data) + 20.0
    assert np.abs(error[t_s > known_s]).max() < 5.0
    assert math.sqrt((error[t_s > t_s[-1] - 30.0] ** 2).mean()) < 2.0


def test_before_that_its_heading_is_said_to_be_unknown(shared_data: Path) -> None:
    """A row says what it does not know: π, and attitude only; afterwards the error stays inside 3σ."""
    block = mission(shared_data)
    flown = fly_mission(without(block, Kind.MAG))
    found_s = next(e.t_ns for e in flown.events if e.code == "heading-from-motion") * 1e-9
    aligned_s = next(e.t_ns for e in flown.events if e.code == "aligned") * 1e-9
    before = flown.between(aligned_s + 0.1, found_s - 0.5)
    assert (flown.rows[before, 12] > math.radians(170.0)).all()
    assert (flown.rows[before, 25] == 1).all()
    t_s, error = heading_error_deg(flown, block)
    sigma = np.degrees(np.interp(t_s, flown.t_s, flown.rows[:, 12]))
    settled = t_s > found_s + 1.0
    assert (np.abs(error) < 3.0 * sigma)[settled].mean() > 0.9


@pytest.mark.xfail(
    strict=True,
    reason="seen: overruled 42 s after take-off and refused from then on; wanders by 44° until found again at 113 s",
)
def test_a_magnetometer_mounted_a_quarter_turn_askew_is_overruled(shared_data: Path) -> None:
    block = mission(shared_data)
    flown = fly_mission(changed(block, Kind.MAG, turned(math.pi / 2)))
    assert "heading-from-motion" in flown.codes()
    t_s, error = heading_error_deg(flown, block)
    assert np.abs(error[t_s > first_manoeuvre_s(shared_data) + 30.0]).max() < 10.0


@pytest.mark.parametrize("angle_deg", [90.0, 45.0])
def test_a_magnetometer_that_turns_in_flight_is_not_followed(shared_data: Path, angle_deg: float) -> None:
    block = mission(shared_data)
    flown = fly_mission(changed(block, Kind.MAG, turned(math.radians(angle_deg)), start_s=100.0))
    t_s, error = heading_error_deg(flown, block)
    assert np.abs(error[t_s > 100.0]).max() < 2.0


def test_a_field_that_turns_half_around_in_flight_is_refused(shared_data: Path) -> None:
    block = mission(shared_data)
    flown = fly_mission(changed(block, Kind.MAG, turned(math.pi), start_s=100.0))
    t_s, error = heading_error_deg(flown, block)
    assert np.abs(error[t_s > 100.0]).max() < 2.0


def test_a_car_takes_its_heading_from_the_course() -> None:
    """Within a second of driving faster than the receiver's noise, and then it is learned."""
    drive = s_turns(60.0, banked=False)
    flown = fly(stream_of(drive, Sensors(mag_hz=None)).block(), vehicle=VehicleClass.CAR, **KNOWN)
    assert flown.codes().count("heading-from-course") == 1
    found_s = next(e.t_ns for e in flown.events if e.code == "heading-from-course") * 1e-9
    assert 10.0 < found_s < 14.0
    error = np.degrees(np.abs(heading_error(flown, drive)))
    assert error[flown.t_s > found_s + 0.5].max() < 5.0
    assert math.sqrt((error[flown.t_s > 40.0] ** 2).mean()) < 0.5


def test_a_multirotor_is_not_told_its_heading_by_its_course() -> None:
    drive = s_turns(60.0, banked=False)
    flown = fly(stream_of(drive, Sensors(mag_hz=None)).block(), vehicle=VehicleClass.MULTIROTOR, **KNOWN)
    assert "heading-from-course" not in flown.codes()
    assert np.degrees(np.abs(heading_error(flown, drive)))[flown.t_s > 40.0].max() < 3.0


def test_at_rest_no_heading_is_invented() -> None:
    flown = fly(stream_of(rest(90.0), Sensors(mag_hz=None)).block(), vehicle=VehicleClass.MULTIROTOR, **KNOWN)
    assert flown.codes() == ["aligned"]
    assert flown.rows[-1, 12] > math.radians(170.0)
