"""A car neither slides nor jumps: what that is worth in an outage, and that no other vehicle is told so."""

import numpy as np
import pytest

from server.nav.types import Aid, AidStatus, VehicleClass

from .ekf_flights import Sensors, s_turns, stream_of
from .ekf_flown import Flown, body_velocity, fly, position_error

KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
DRIVE = s_turns(100.0, banked=False)
CHEAP = Sensors(
    accel_bias=(0.1, -0.1, 0.1), gyro_bias=(0.003, -0.002, 0.002), accel_noise=0.1, gyro_noise=3e-3, baro_hz=None
)
OUTAGE = (60.0, 90.0)
OTHERS = [vehicle for vehicle in VehicleClass if vehicle != VehicleClass.CAR]


def drive(vehicle: VehicleClass) -> Flown:
    """S-turns at 15 m/s without GNSS for the last half minute but ten seconds."""
    return fly(stream_of(DRIVE, CHEAP).block(), vehicle=vehicle, gnss_withheld_s=(OUTAGE,), t_origin_ns=0, **KNOWN)


def peak_m(flown: Flown) -> float:
    """Return the largest horizontal error in the outage."""
    return float(np.linalg.norm(position_error(flown, DRIVE)[flown.between(*OUTAGE)], axis=1).max())


def test_a_car_does_not_slide_in_an_outage() -> None:
    flown = drive(VehicleClass.CAR)
    across = body_velocity(flown)[flown.between(*OUTAGE), 1:]
    assert np.sqrt((across**2).mean(axis=0)).max() < 0.1
    assert np.abs(across).max() < 0.2
    assert (flown.statuses(Aid.WHEELS) == AidStatus.FUSED).mean() > 0.98
    inside = np.abs(position_error(flown, DRIVE)) < 3.0 * flown.rows[:, 16:18]
    assert inside[flown.between(*OUTAGE)].all()


def test_it_is_worth_half_the_drift_at_least() -> None:
    assert peak_m(drive(VehicleClass.CAR)) < 0.5 * peak_m(drive(VehicleClass.UNKNOWN))


@pytest.mark.parametrize("vehicle", OTHERS)
def test_other_vehicles_may_move_sideways(vehicle: VehicleClass) -> None:
    assert not len(drive(vehicle).statuses(Aid.WHEELS))
