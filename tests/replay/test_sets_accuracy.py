"""The promises on recorded sets: outages of a car and of an autopilot's flight, attitudes beside on-board solutions.

Every set is written by its reader as a sensor folder and goes through `replay`; the causal lane is scored.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.replay.run import replay
from server.replay.source import load
from tests.sets import inertialnav_quad, inertialnav_x8, rtk_drive
from tests.sets.laws import attitude

RTK_OUTAGES_S = [(40.0 + 45.0 * k, 55.0 + 45.0 * k) for k in range(11)]
MISSION_OUTAGES_S = [(begin, begin + 25.0) for begin in np.arange(60.0, 141.0, 8.0).tolist()]
METRES_PER_DEG = 111_170.0
Attitude = dict[str, float]


def lane_of(out: Path, log: Path, outages: list[tuple[float, float]]) -> Any:
    """Replay a log with outages; return what the summary says of the main lane."""
    summary = replay(log, out, lanes=["ins_ekf", "reference"], gnss_outages=outages, overwrite=True)
    return summary.lanes["ins_ekf"]


@pytest.fixture(scope="module")
def drive(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The car's eleven outages of 15 s, one every 45 s."""
    place = tmp_path_factory.mktemp("rtk")
    return lane_of(place / "out", rtk_drive.write(shared_data, place / "set"), RTK_OUTAGES_S)


def test_a_cars_fifteen_seconds_without_gnss_end_near_the_truth(drive: Any) -> None:
    """Published forward filter on this drive: median 5.2 m, worst 10.7 m."""
    ends = [outage.end_horizontal_m for outage in drive.outages]
    assert len(ends) == len(RTK_OUTAGES_S)
    assert float(np.median(ends)) <= 4.0
    assert max(ends) <= 10.0


def test_dead_reckoning_is_said_in_every_outage(drive: Any) -> None:
    rows = drive.status_rows["dead_reckoning"]
    assert 11 * 13 * 50 < rows < 11 * 15.5 * 50


@pytest.mark.xfail(
    strict=True,
    reason="seen: 29 % of rows inside 3σ: centimetres are claimed at 15 m/s, where 20 ms of clock are 0.3 m",
)
def test_a_cars_sigma_is_honest(drive: Any) -> None:
    assert drive.settled.cover_3sigma.horizontal >= 0.90


class Rows:
    """A lane's file: stamps, and columns by name; the status word is left out."""

    def __init__(self, out: Path, lane: str = "ins_ekf") -> None:
        table = np.genfromtxt(out / f"{lane}.csv", delimiter=",", skip_header=1, usecols=range(26))
        names = (out / f"{lane}.csv").read_text(encoding="utf-8").split("\n", 1)[0].split(",")
        self.t_s = table[:, 0] * 1e-9
        self.columns = dict(zip(names, table.T, strict=False))

    def stack(self, *names: str) -> np.ndarray:
        """Return columns side by side."""
        return np.stack([self.columns[name] for name in names], axis=1)


def errors_deg(out: Path, written: Path, skip_ns: list[tuple[int, int]] | None = None) -> Attitude:
    """Return RMS total, tilt and heading against the on-board solution from 30 s of navigation on, degrees."""
    lane, on_board = Rows(out), attitude(written)
    t_s, q_nb = lane.t_s, lane.stack("q_w", "q_x", "q_y", "q_z")
    begin_s = t_s[np.argmax(np.isfinite(lane.columns["lat_deg"]))] + 30.0
    chosen = (t_s > begin_s) & (t_s < on_board.times[-1]) & np.isfinite(q_nb[:, 0])
    for start_ns, end_ns in skip_ns or []:
        chosen &= ~((t_s >= start_ns * 1e-9) & (t_s < end_ns * 1e-9))
    estimate = Rotation.from_quat(q_nb[chosen], scalar_first=True)
    error = (estimate * on_board(t_s[chosen]).inv()).as_rotvec(degrees=True)
    squares = (error**2).mean(axis=0)
    return {
        "total": math.sqrt(squares.sum()),
        "tilt": math.sqrt(squares[:2].sum()),
        "heading": math.sqrt(squares[2]),
        "rows": float(len(error)),
    }


# The on-board solution of these flights is a DCM filter that takes its heading from the raw magnetometer, with its
# soft iron and currents: the promise of 1.5° holds for the tilt. Of the total a little more than was measured
# (2.0°, 5.2°) is asserted, so that a heading that gets worse shows.
QUAD_TOTAL_DEG = {106: 2.3, 123: 5.6}


@pytest.mark.parametrize("flight", inertialnav_quad.FLIGHTS)
def test_a_quadrotors_tilt_is_the_on_board_one(shared_data: Path, tmp_path: Path, flight: int) -> None:
    written = inertialnav_quad.write(shared_data, tmp_path / "set", flight)
    lane_of(tmp_path / "out", written, [])
    errors = errors_deg(tmp_path / "out", written)
    assert errors["rows"] > 100 * 50
    assert errors["tilt"] <= 1.5
    assert errors["total"] <= QUAD_TOTAL_DEG[flight]


def test_a_flying_wings_attitude_is_near_the_on_board_one_outside_aerobatics(shared_data: Path, tmp_path: Path) -> None:
    """Both are estimates: a DCM filter of 2013, between loops and rolls. Measured 3.4°, tilt 1.7°."""
    written = inertialnav_x8.write(shared_data, tmp_path / "set")
    lane_of(tmp_path / "out", written, [])
    errors = errors_deg(tmp_path / "out", written, inertialnav_x8.aerobatics_ns(shared_data))
    assert errors["rows"] > 200 * 50
    assert errors["total"] <= 3.8
    assert errors["tilt"] <= 2.0


@pytest.fixture(scope="module")
def flights(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """Of each 25 s outage of the recorded flight: peak m, 3σ at the peak m, worst |error| / 3σ, m from 5 s after on."""
    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    out = tmp_path_factory.mktemp("mission") / "out"
    found = []
    for begin_s, end_s in MISSION_OUTAGES_S:
        (outage,) = lane_of(out, log, [(begin_s, end_s)]).outages
        t_s, error, sigma = horizontal(out)
        t_s = t_s - begin_of(log)
        during, after = (t_s >= begin_s) & (t_s < end_s), (t_s >= end_s + 5.0) & (t_s < end_s + 8.0)
        size = np.linalg.norm(error, axis=1)
        peak = np.flatnonzero(during)[np.argmax(size[during])]
        back_m = size[after].max() if after.any() else math.nan
        three_sigma_m = 3.0 * np.linalg.norm(sigma[peak])
        found.append((outage.peak_horizontal_m, three_sigma_m, outage.peak_horizontal_sigmas / 3.0, back_m))
    return np.array(found)


def begin_of(log: Path) -> float:
    """Return the stamp that outages count from, seconds."""
    return load(log).t_origin_ns * 1e-9


def horizontal(out: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps of the lane, and (N, 2) errors and σ, m; NaN outside the reference."""
    lane, true = Rows(out), Rows(out, "reference")
    place = true.stack("lat_deg", "lon_deg")
    known = np.isfinite(place[:, 0])
    t_s, place = true.t_s[known], place[known]
    scale = METRES_PER_DEG * np.array([1.0, math.cos(math.radians(float(place[0, 0])))])
    at = [np.interp(lane.t_s, t_s, place[:, i], left=math.nan, right=math.nan) for i in (0, 1)]
    error = (lane.stack("lat_deg", "lon_deg") - np.stack(at, axis=1)) * scale
    return lane.t_s, error, lane.stack("sigma_pos_n_m", "sigma_pos_e_m")


def test_wherever_25_s_without_gnss_begin_nine_in_ten_peaks_stay_under_15_m(flights: np.ndarray) -> None:
    """EKF3's own peak in its flight was 48 m, and it gave up after 15 s."""
    assert np.percentile(flights[:, 0], 90) <= 15.0


def test_the_peaks_lie_inside_their_own_three_sigma(flights: np.ndarray) -> None:
    assert np.percentile(flights[:, 0] / flights[:, 1], 90) <= 1.0


def test_every_axis_stays_inside_three_sigma_all_the_way(flights: np.ndarray) -> None:
    assert np.percentile(flights[:, 2], 90) <= 1.0


def test_five_seconds_after_an_outage_the_position_is_back(flights: np.ndarray) -> None:
    back_m = flights[:, 3]
    assert np.isfinite(back_m).all()
    assert back_m.max() <= 0.5
