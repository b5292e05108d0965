"""Errors against a reference: known offsets come out as themselves, nothing is fitted away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.nav.types import LANE_COLUMNS, ROW_WIDTH
from server.replay.interpolate import MAX_GAP_NS
from server.replay.score import compare, errors, outage, rotation_between

MS = 1_000_000
SECOND_NS = 1_000_000_000
LAT_DEG, LON_DEG, ALT_M = 47.4, 8.5, 500.0
# Length of a degree by the series of the geodetic tables, plus the arc at the height: a second method.
PHI, ARC_M = math.radians(LAT_DEG), ALT_M * math.pi / 180
DEG_PER_M_NORTH = 1 / (111132.92 - 559.82 * math.cos(2 * PHI) + 1.175 * math.cos(4 * PHI) + ARC_M)
DEG_PER_M_EAST = 1 / (
    111412.84 * math.cos(PHI) - 93.5 * math.cos(3 * PHI) + 0.118 * math.cos(5 * PHI) + ARC_M * math.cos(PHI)
)
SIGMA = LANE_COLUMNS.index("sigma_att_x_rad")


def quat(yaw_rad: np.ndarray, pitch_rad: float = 0.0) -> np.ndarray:
    """Yaw after pitch, the textbook product."""
    cy, sy, cp, sp = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2), math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    return np.stack([cy * cp, -sy * sp, cy * sp, sy * cp], axis=1)


def truth(t_ns: np.ndarray, yaw_rad_s: float = 0.7, speed_m_s: float = 10.0) -> np.ndarray:
    """A vehicle that goes north at constant speed and spins."""
    t_s = t_ns / 1e9
    rows = np.full((len(t_ns), ROW_WIDTH), np.nan)
    rows[:, :4] = quat(yaw_rad_s * t_s)
    rows[:, 4] = LAT_DEG + speed_m_s * t_s * DEG_PER_M_NORTH
    rows[:, 5:10] = [LON_DEG, ALT_M, speed_m_s, 0.0, 0.0]
    return rows


def lane(t_ns: np.ndarray, rows: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    data = np.full((len(t_ns), len(LANE_COLUMNS)), np.nan)
    data[:, :4], data[:, 7:10], data[:, 4:7] = rows[:, :4], rows[:, 4:7], rows[:, 7:10]
    data[:, SIGMA : SIGMA + 9] = sigma
    return data


def stamps(step_ms: int, count: int, start_ns: int = 0) -> np.ndarray:
    return start_ns + np.arange(count, dtype=np.int64) * step_ms * MS


def test_a_lane_between_the_stamps_of_the_reference_is_not_charged_for_it() -> None:
    reference_ns, lane_ns = stamps(10, 1001), stamps(20, 499, start_ns=3 * MS)
    found = errors(compare(lane_ns, lane(lane_ns, truth(lane_ns)), reference_ns, truth(reference_ns)))
    assert found is not None
    assert found.rows == 499
    assert found.attitude_rad.max < 1e-8
    assert found.horizontal_m.max < 1e-6
    assert found.vel_n_m_s.max < 1e-12


def test_known_offsets_come_out_as_themselves() -> None:
    t_ns = stamps(20, 500)
    wrong = truth(t_ns)
    wrong[:, :4] = quat(0.7 * t_ns / 1e9 + 0.01)
    wrong[:, 4] += 3.0 * DEG_PER_M_NORTH
    wrong[:, 5] += 4.0 * DEG_PER_M_EAST
    wrong[:, 6] += 2.0
    wrong[:, 7:10] += [0.1, -0.2, 0.3]
    found = errors(compare(t_ns, lane(t_ns, wrong), t_ns, truth(t_ns)))
    assert found is not None
    assert found.attitude_rad.rms == pytest.approx(0.01, rel=1e-9)
    assert found.heading_rad.rms == pytest.approx(0.01, rel=1e-9)
    assert found.tilt_rad.max < 1e-9
    assert found.horizontal_m.rms == pytest.approx(5.0, rel=2e-5)
    assert found.vertical_m.rms == pytest.approx(2.0)
    assert found.vertical_median_m == pytest.approx(2.0)
    assert found.vertical_less_median_m.max < 1e-9
    assert [found.vel_n_m_s.rms, found.vel_e_m_s.rms, found.vel_d_m_s.rms] == pytest.approx([0.1, 0.2, 0.3])


def test_tilt_and_heading_are_told_apart_in_the_navigation_frame() -> None:
    pitched = rotation_between(quat(np.array([1.0]), 0.02), quat(np.array([1.0])))
    np.testing.assert_allclose(pitched, [[-0.02 * math.sin(1.0), 0.02 * math.cos(1.0), 0.0]], atol=1e-12)


def test_a_quaternion_and_its_negative_are_the_same_attitude_also_while_interpolating() -> None:
    reference_ns, lane_ns = stamps(10, 200), stamps(10, 198, start_ns=5 * MS)
    flipped = truth(reference_ns)
    flipped[::3, :4] *= -1
    found = errors(compare(lane_ns, lane(lane_ns, truth(lane_ns)), reference_ns, flipped))
    assert found is not None
    assert found.attitude_rad.max < 1e-8


def test_cover_asks_north_and_east_both_and_sigma_ratio_is_median_over_rms() -> None:
    t_ns = stamps(20, 400)
    wrong = truth(t_ns)
    wrong[:, 4] += np.where(np.arange(400) % 4 == 0, 4.0, 2.0) * DEG_PER_M_NORTH
    found = errors(compare(t_ns, lane(t_ns, wrong, sigma=1.0), t_ns, truth(t_ns)))
    assert found is not None
    assert found.cover_3sigma.horizontal == pytest.approx(0.75)
    assert found.cover_3sigma.vertical == 1.0
    assert found.sigma_ratio_horizontal == pytest.approx(math.sqrt(2) / math.sqrt((3 * 4 + 16) / 4), rel=2e-6)


def test_percentiles_are_of_the_absolute_error() -> None:
    t_ns = stamps(20, 101)
    wrong = truth(t_ns)
    wrong[:, 6] -= np.arange(101)
    found = errors(compare(t_ns, lane(t_ns, wrong), t_ns, truth(t_ns)))
    assert found is not None
    assert (found.vertical_m.p50, found.vertical_m.p95, found.vertical_m.max) == pytest.approx((50, 95, 100))


def test_a_gap_in_the_reference_is_not_bridged() -> None:
    reference_ns = np.concatenate([stamps(10, 100), stamps(10, 100, start_ns=2 * SECOND_NS)])
    lane_ns = stamps(7, 400)
    compared = compare(lane_ns, lane(lane_ns, truth(lane_ns)), reference_ns, truth(reference_ns))
    inside = (lane_ns <= 990 * MS) | ((lane_ns >= 2 * SECOND_NS) & (lane_ns <= 2990 * MS))
    np.testing.assert_array_equal(np.isfinite(compared.position_m[:, 0]), inside)


def test_a_slow_reference_keeps_its_own_stamps_and_the_lane_is_interpolated() -> None:
    reference_ns, lane_ns = stamps(250, 40, start_ns=3 * MS), stamps(20, 520)
    compared = compare(lane_ns, lane(lane_ns, truth(lane_ns)), reference_ns, truth(reference_ns))
    assert compared.stamps == "reference stamps"
    assert 250 * MS > MAX_GAP_NS
    found = errors(compared)
    assert found is not None
    assert found.rows == 40
    assert found.horizontal_m.max < 1e-6
    assert found.cover_3sigma.horizontal == 1.0


def test_a_reference_that_knows_only_the_attitude_scores_only_the_attitude() -> None:
    t_ns = stamps(20, 50)
    reference = truth(t_ns)
    reference[:, 4:10] = np.nan
    found = errors(compare(t_ns, lane(t_ns, truth(t_ns)), t_ns, reference))
    assert found is not None
    assert found.attitude_rad.rows == 50
    assert found.horizontal_m is found.vertical_m is found.vel_n_m_s is found.sigma_ratio_horizontal is None


def test_rows_before_the_lane_knows_anything_are_not_errors() -> None:
    t_ns = stamps(20, 100)
    data = lane(t_ns, truth(t_ns))
    data[:40] = np.nan
    found = errors(compare(t_ns, data, t_ns, truth(t_ns)))
    assert found is not None
    assert (found.rows, found.t_from_ns) == (60, 800 * MS)
    data[:] = np.nan
    assert errors(compare(t_ns, data, t_ns, truth(t_ns))) is None


def test_the_date_line_is_no_distance() -> None:
    t_ns = stamps(20, 3)
    reference, here = truth(t_ns), truth(t_ns)
    reference[:, 5], here[:, 5] = [179.9999999, 180.0, -179.9999999], [179.9999999, -180.0, 180.0000001]
    found = errors(compare(t_ns, lane(t_ns, here), t_ns, reference))
    assert found is not None
    assert found.horizontal_m.max < 1e-6


def test_an_outage_reports_peak_end_and_sigmas_of_its_own_stretch() -> None:
    t_ns = stamps(20, 1000, start_ns=7 * SECOND_NS)
    wrong = truth(t_ns)
    t_s = (t_ns - 7 * SECOND_NS) / 1e9
    wrong[:, 4] += np.where((t_s >= 5) & (t_s < 10), (t_s - 5) * 2, 0.0) * DEG_PER_M_NORTH
    wrong[t_s > 12, 4] += 99 * DEG_PER_M_NORTH
    found = outage(compare(t_ns, lane(t_ns, wrong, sigma=2.0), t_ns, truth(t_ns)), 7 * SECOND_NS, (5.0, 10.0))
    assert found.rows == 250
    assert found.peak_horizontal_m == found.end_horizontal_m == pytest.approx(9.96, rel=2e-6)
    assert found.peak_horizontal_sigmas == pytest.approx(4.98, rel=2e-6)


@pytest.mark.parametrize("step_ms", [10, 100])  # the reference at the lane's stamps, and the lane at the reference's
def test_a_lane_that_knows_altitude_alone_is_scored_on_that_alone(step_ms: int) -> None:
    reference_ns, lane_ns = stamps(step_ms, 200), stamps(20, 999)
    rows = np.full((len(lane_ns), len(LANE_COLUMNS)), np.nan)
    rows[:, LANE_COLUMNS.index("alt_m")] = ALT_M + 2.0
    rows[:, LANE_COLUMNS.index("vel_d_m_s")] = 0.5
    rows[:, LANE_COLUMNS.index("sigma_pos_d_m")] = 1.0
    found = errors(compare(lane_ns, rows, reference_ns, truth(reference_ns)))
    assert found is not None
    assert found.vertical_m.rms == pytest.approx(2.0)
    assert found.vel_d_m_s.rms == pytest.approx(0.5)
    assert found.cover_3sigma.vertical == 1.0
    for name in ("attitude_rad", "heading_rad", "tilt_rad", "horizontal_m", "vel_n_m_s", "vel_e_m_s"):
        assert getattr(found, name) is None, name
    cover = found.cover_3sigma
    assert cover.horizontal is cover.velocity is cover.attitude is found.sigma_ratio_horizontal is None
    lost = outage(compare(lane_ns, rows, reference_ns, truth(reference_ns)), 0, (1.0, 2.0))
    assert (lost.rows, lost.peak_horizontal_m, lost.end_horizontal_m, lost.end_attitude_rad) == (0, None, None, None)


@pytest.mark.parametrize("step_ms", [10, 100])
def test_a_lane_that_knows_attitude_alone_and_no_sigma_is_scored_on_that_alone(step_ms: int) -> None:
    reference_ns, lane_ns = stamps(step_ms, 200), stamps(20, 999)
    rows = lane(lane_ns, truth(lane_ns), sigma=math.nan)
    rows[:, 4:10] = np.nan
    rows[:, :4] = quat(0.7 * lane_ns / 1e9 + 0.01)
    found = errors(compare(lane_ns, rows, reference_ns, truth(reference_ns)))
    assert found is not None
    assert found.heading_rad.rms == pytest.approx(0.01, rel=1e-4)
    assert found.horizontal_m is found.vertical_m is found.vel_d_m_s is found.vertical_median_m is None
    assert found.cover_3sigma.attitude is found.cover_3sigma.horizontal is None
