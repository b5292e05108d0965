"""Every attitude lane on a real autopilot's stream, scored against the simulator's truth from 30 s after the fix."""

import math
from pathlib import Path
from typing import Any

import pytest

from server.replay.contract import SummaryOut
from server.replay.run import replay

BOUNDS_DEG = {
    # lane: heading, tilt. Measured at 50 Hz, then a third more. A multirotor's specific force stays along its own axis,
    # so gravity alone takes its accelerations for level (tilt of the first four); six-axis headings drift by what is
    # left of 0.05 °/s a minute of gyro bias.
    "complementary_1": (13.5, 3.7),
    "kalman_angle_bias": (13.0, 1.7),
    "complementary": (2.2, 2.3),
    "vqf": (3.4, 5.8),
    "ahrs_fixed_gain": (1.9, 0.65),
}


@pytest.fixture(scope="module")
def summary(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> SummaryOut:
    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    return replay(log, tmp_path_factory.mktemp("mission") / "out", lanes=[*BOUNDS_DEG, "dmp", "reference"])


def settled(summary: SummaryOut, lane: str) -> Any:
    return summary.lanes[lane].settled


@pytest.mark.parametrize("lane", BOUNDS_DEG)
def test_attitude_is_within_what_was_measured(summary: SummaryOut, lane: str) -> None:
    heading_deg, tilt_deg = BOUNDS_DEG[lane]
    errors = settled(summary, lane)
    assert math.degrees(errors.heading_rad.rms) < heading_deg
    assert math.degrees(errors.tilt_rad.rms) < tilt_deg
    assert summary.lanes[lane].status_rows["failed"] == 0


def test_gnss_in_the_tilt_beats_gravity_alone(summary: SummaryOut) -> None:
    tilt = {lane: settled(summary, lane).tilt_rad.rms for lane in BOUNDS_DEG}
    assert tilt.pop("ahrs_fixed_gain") < 0.5 * min(tilt.values())


def test_the_receivers_position_is_within_its_noise_and_age(summary: SummaryOut) -> None:
    errors = settled(summary, "complementary")
    assert errors.horizontal_m.rms < 0.15
    assert max(errors.vel_n_m_s.rms, errors.vel_e_m_s.rms) < 0.5  # a receiver's velocity is 0.1 to 0.3 s old


def test_a_board_without_a_motion_processor_has_no_dmp_attitude(summary: SummaryOut) -> None:
    assert summary.lanes["dmp"].status_rows["attitude"] == 0
