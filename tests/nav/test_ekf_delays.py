"""Delays that nobody told: found from the innovations, on motions that show them, and left alone where nothing does."""

from pathlib import Path

import numpy as np
import pytest

from server.nav.ekf import layout as at
from server.nav.ekf.delays import MAG, POSITION, VELOCITY
from server.nav.types import Kind, VehicleClass
from server.replay.source import load
from tests.sets import rtk_drive

from .ekf_flights import Floats, Sensors, rest, s_turns, stream_of
from .ekf_flown import Flown, fly, position_error
from .ekf_mission import GNSS_DELAY_S, IMU_DELAY_S, MAG_DELAY_S, fly_mission, mission, without

TURNS = s_turns(120.0, banked=False)
KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}


def found_s(flown: Flown) -> Floats:
    """Return delays of position, velocity and field beyond those that were told: in use, and what they still lack."""
    work = flown.lane._work
    return np.asarray(work[at.W_USED : at.W_USED + at.DELAYS] + work[at.W_DELTA : at.W_DELTA + at.DELAYS], np.float64)


def sigma_s(flown: Flown) -> Floats:
    """Return the standard deviations of the three."""
    return np.sqrt([flown.lane._work[at.W_M + (at.DELAYS + 1) * i] for i in range(at.DELAYS)])


def test_the_autopilots_delays_are_found_on_the_imus_clock(shared_data: Path) -> None:
    """The filter's clock is the IMU's stamp, itself 11 ms late: what it finds is that much shorter than the profile."""
    unknown = without(mission(shared_data), Kind.PROFILE)
    flown = fly_mission(unknown, vehicle=VehicleClass.MULTIROTOR)
    expected = np.array([GNSS_DELAY_S, GNSS_DELAY_S, MAG_DELAY_S]) - IMU_DELAY_S
    assert (np.abs(found_s(flown) - expected) < 3.0 * sigma_s(flown) + 0.010).all()
    assert (sigma_s(flown) < 0.006).all()


def test_with_the_imus_delay_told_they_are_the_profiles(shared_data: Path) -> None:
    unknown = without(mission(shared_data), Kind.PROFILE)
    flown = fly_mission(unknown, vehicle=VehicleClass.MULTIROTOR, imu_delay_s=IMU_DELAY_S)
    expected = np.array([GNSS_DELAY_S, GNSS_DELAY_S, MAG_DELAY_S])
    assert (np.abs(found_s(flown) - expected) < 3.0 * sigma_s(flown) + 0.010).all()


def test_what_is_told_is_not_estimated(shared_data: Path) -> None:
    told = fly_mission(mission(shared_data))
    assert told.lane._work[at.W_DELAYS] == 0.0
    assert (found_s(told) == 0.0).all()
    half = fly_mission(without(mission(shared_data), Kind.PROFILE), gnss_delay_s=GNSS_DELAY_S, imu_delay_s=IMU_DELAY_S)
    assert (found_s(half)[:MAG] == 0.0).all()
    assert found_s(half)[MAG] == pytest.approx(MAG_DELAY_S, abs=0.010)


def test_a_receiver_that_smooths_its_velocity_is_seen_through(shared_data: Path, tmp_path: Path) -> None:
    """The RTK receiver's velocity is the mean over the interval before its stamp, 0.125 s old; its position is not."""
    log = load(rtk_drive.write(shared_data, tmp_path))
    flown = fly(log.blocks(10**9), **log.overrides)
    position, velocity, _ = found_s(flown)
    assert velocity - position == pytest.approx(0.11, abs=0.03)
    assert abs(position) < 0.04
    assert sigma_s(flown)[:2].max() < 0.01


@pytest.mark.parametrize(("pos_s", "vel_s", "mag_s"), [(0.0, 0.0, 0.0), (0.1, 0.1, 0.02), (0.2, 0.3, 0.04)])
def test_made_delays_are_found(pos_s: float, vel_s: float, mag_s: float) -> None:
    sensors = Sensors(pos_late_s=pos_s, vel_late_s=vel_s, mag_late_s=mag_s)
    flown = fly(stream_of(TURNS, sensors).block())
    assert (np.abs(found_s(flown) - [pos_s, vel_s, mag_s]) < 3.0 * sigma_s(flown) + 0.002).all()
    late = flown.t_s > 70.0
    assert np.sqrt((position_error(flown, TURNS)[late] ** 2).sum(axis=1).mean()) < 0.05


def test_found_is_as_good_as_told() -> None:
    """Late in the flight the two runs are one: nothing of the search is left in the state."""
    late = Sensors(pos_late_s=0.2, vel_late_s=0.2, mag_late_s=0.02)
    found = fly(stream_of(TURNS, late).block())
    told = fly(stream_of(TURNS, late).block(), **(KNOWN | {"gnss_delay_s": 0.2, "mag_delay_s": 0.02}))
    rms = [np.sqrt((position_error(f, TURNS)[f.t_s > 80.0] ** 2).sum(axis=1).mean()) for f in (found, told)]
    assert rms[0] < rms[1] + 0.02
    assert rms[0] < 0.05


def test_at_rest_nothing_is_known_of_a_delay(shared_data: Path) -> None:
    """No motion, no information: σ stays what it was (0.18 s for a receiver, 0.03 s for a field)."""
    made = sigma_s(fly(stream_of(rest(120.0)).block()))
    recorded = sigma_s(fly_mission(without(mission(shared_data, "static"), Kind.PROFILE)))
    for sigma in (made, recorded):
        assert sigma[POSITION] > 0.1
        assert sigma[MAG] > 0.028
        assert sigma[VELOCITY] > 0.06


@pytest.mark.parametrize("recorded", [False, True])
def test_at_rest_no_delay_is_put_to_use(shared_data: Path, recorded: bool) -> None:
    """What was not seen must not be believed when the vehicle starts to move."""
    if recorded:
        flown = fly_mission(without(mission(shared_data, "static"), Kind.PROFILE))
    else:
        flown = fly(stream_of(rest(120.0)).block())
    assert np.abs(flown.lane._work[at.W_USED : at.W_USED + at.DELAYS]).max() < 0.03
