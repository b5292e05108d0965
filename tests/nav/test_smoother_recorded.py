"""The smoother on recorded bytes: a flight and a drive with GNSS withheld."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.replay.run import replay
from tests.sets import rtk_drive

OUTAGES = [(40.0 + 45.0 * k, 55.0 + 45.0 * k) for k in range(11)]


@pytest.fixture(scope="module")
def mission(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    return replay(log, tmp_path_factory.mktemp("out"), lanes=["ins_ekf", "smoother"], gnss_outages=[(60.0, 85.0)])


@pytest.fixture(scope="module")
def drive(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = rtk_drive.write(shared_data, tmp_path_factory.mktemp("drive"))
    return replay(folder, tmp_path_factory.mktemp("out"), lanes=["ins_ekf", "smoother"], gnss_outages=OUTAGES)


def test_a_flight_is_known_three_times_better_inside_an_outage(mission: Any) -> None:
    ours, theirs = mission.lanes["smoother"].outages[0], mission.lanes["ins_ekf"].outages[0]
    assert ours.peak_horizontal_m < theirs.peak_horizontal_m / 3.0
    assert ours.peak_horizontal_m < 0.5
    assert ours.peak_horizontal_sigmas < 3.0


def test_a_flight_is_known_better_throughout(mission: Any) -> None:
    ours, theirs = mission.lanes["smoother"].settled, mission.lanes["ins_ekf"].settled
    for name in ("attitude_rad", "horizontal_m", "vertical_m", "vel_n_m_s", "vel_e_m_s", "vel_d_m_s"):
        assert getattr(ours, name).rms < getattr(theirs, name).rms
    assert ours.attitude_rad.rms < math.radians(0.1)
    assert ours.cover_3sigma.attitude > 0.99
    assert ours.cover_3sigma.velocity > 0.95


def test_the_whole_flight_is_one_stretch_and_no_row_reckons(mission: Any) -> None:
    words = mission.lanes["smoother"].status_rows
    assert words["dead_reckoning"] == words["failed"] == 0
    assert words["aligning"] == mission.lanes["ins_ekf"].status_rows["aligning"]
    assert mission.lanes["smoother"].rows == mission.lanes["ins_ekf"].rows
    event = next(event for event in mission.events if event.code == "smoothed")
    assert event.values["stretches"] == 1.0
    assert mission.timing.finish_s > 0.0


def test_a_drive_through_eleven_tunnels_is_known_three_times_better(drive: Any) -> None:
    ours = np.array([one.peak_horizontal_m for one in drive.lanes["smoother"].outages])
    theirs = np.array([one.peak_horizontal_m for one in drive.lanes["ins_ekf"].outages])
    assert len(ours) == 11
    assert np.median(ours) < np.median(theirs) / 3.0
    assert ours.max() < theirs.max() / 3.0
    assert np.median(ours) < 0.5
