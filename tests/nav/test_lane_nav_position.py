"""`nav_position` [S1 §3.4]: late, slow, noisy GNSS made smooth by acceleration and barometer."""

import math

import numpy as np
import pytest

from server.nav.earth import ned_from_lla
from server.nav.ekf import layout as at
from server.nav.types import Kind, LaneStatus

from .heights import calls_of, fly, rms
from .synthetic import LAT_DEG, LON_DEG, METRES_PER_DEG_LAT, METRES_PER_DEG_LON, circle

LANE = "nav_position"
STATUS, DEAD_RECKONING_S = 25, 29
PLACE, SPEED, SIGMA_PLACE = slice(26, 28), slice(4, 6), slice(16, 18)


def errors(t, rows, truth, after_s=20.0, until_s=math.inf):
    """Return horizontal position and velocity errors, shape (n, 2) each, between two times."""
    chosen = (t > after_s) & (t < until_s)
    expected = np.array([truth(s) for s in t[chosen]])
    return rows[chosen, PLACE] - expected[:, :2], rows[chosen, SPEED] - expected[:, 2:4]


def length_rms(vectors):
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def gnss_changed(stream, change):
    """Apply change(t_s, values) to the GNSS rows of a stream; None takes a row out."""
    kept = []
    for row in stream.rows:
        values = change(row[4], list(row[5])) if row[3] == Kind.GNSS else row[5]
        if values is not None:
            kept.append((*row[:5], values))
    stream.rows = kept
    return stream.block()


def north_off(begin_s, end_s, metres):
    """Return a change that moves fixes of an interval north."""

    def change(t, values):
        if begin_s <= t < end_s:
            values[0] += metres / METRES_PER_DEG_LAT
        return values

    return change


def test_a_circle_is_recovered_and_smoother_than_the_fixes():
    stream, truth = circle(gyro_bias=(0.01, -0.013, -0.006))
    rng = np.random.default_rng(5)

    def noisy(t, values):
        values[0] += 0.5 * rng.standard_normal() / METRES_PER_DEG_LAT
        values[1] += 0.5 * rng.standard_normal() / METRES_PER_DEG_LON
        values[6] = 0.5
        return values

    site = {"site_lat_deg": LAT_DEG, "site_lon_deg": LON_DEG, "site_alt_m": 0.0}
    t, rows = fly(LANE, calls_of(gnss_changed(stream, noisy), **site))
    place, speed = errors(t, rows, truth)
    assert length_rms(place) < 0.25  # the fixes err by 0.71 m
    assert rms(speed) < 0.08
    late = t > 20.0
    assert (np.abs(place) < 3.0 * rows[late, SIGMA_PLACE]).all(axis=1).mean() > 0.95
    jumps = np.abs(np.diff(rows[late, PLACE], axis=0) - rows[late, SPEED][1:] / 50.0)
    assert jumps.max() < 0.15


def test_a_late_fix_is_compared_with_the_state_of_its_own_time():
    """Ignoring 0.2 s at 10 m/s costs 2 m; told as a delay it costs nothing."""
    stream, truth = circle(gnss_delay_s=0.2)
    calls = calls_of(stream.block(), gnss_delay_s=0.2)
    assert length_rms(errors(*fly(LANE, calls), truth)[0]) < 0.15
    assert length_rms(errors(*fly(LANE, calls_of(stream.block())), truth)[0]) > 1.5


def test_a_fix_that_arrives_late_corrects_the_present_by_the_past_innovation():
    punctual, truth = circle(duration_s=40.0)
    late, _ = circle(duration_s=40.0, gnss_arrives_s=0.15)
    t, rows = fly(LANE, calls_of(punctual.block()))
    t_late, rows_late = fly(LANE, calls_of(late.block()))
    i, j = np.searchsorted(t, 39.18) - 1, np.searchsorted(t_late, 39.18) - 1  # that of 39.0 has arrived in both
    assert t[i] == t_late[j]
    assert (np.abs(rows[i, PLACE] - rows_late[j, PLACE]) < 0.2 * rows[i, SIGMA_PLACE]).all()
    assert length_rms(errors(t_late, rows_late, truth)[0]) < 0.15


def test_the_cut_of_the_stream_does_not_matter():
    block = circle(duration_s=25.0)[0].block()
    t, rows = fly(LANE, calls_of(block))
    for cut in (1, 7, 1000):
        t_cut, rows_cut = fly(LANE, calls_of(block, cut))
        np.testing.assert_array_equal(t, t_cut)
        np.testing.assert_array_equal(rows, rows_cut)


def test_the_rate_of_the_steps_does_not_matter():
    block = circle(rate_hz=333.0)[0].block()
    t, rows = fly(LANE, calls_of(block))
    t_fast, fast = fly(LANE, calls_of(block, nav_rate_hz=333.0))
    late = t > 20.0
    for column, limit in ((26, 0.003), (27, 0.003), (4, 0.005), (5, 0.005)):
        assert rms(np.interp(t[late], t_fast, fast[:, column]) - rows[late, column]) < limit


def test_a_glitch_of_the_receiver_is_refused_and_one_that_stays_is_accepted():
    stream, truth = circle()
    t, rows = fly(LANE, calls_of(gnss_changed(stream, north_off(40.0, 43.0, 80.0))))
    assert length_rms(errors(t, rows, truth)[0]) < 0.5
    stream, _ = circle()
    t, rows = fly(LANE, calls_of(gnss_changed(stream, north_off(40.0, 99.0, 80.0))))
    assert length_rms(errors(t, rows, truth, 40.2, 44.8)[0]) < 1.5
    np.testing.assert_allclose(errors(t, rows, truth, 46.0)[0].mean(axis=0), (80.0, 0.0), atol=0.3)


def test_without_gnss_it_is_dead_reckoning_with_a_growing_sigma():
    stream, truth = circle()
    t, rows = fly(LANE, calls_of(gnss_changed(stream, lambda s, v: v if not 30.0 < s < 40.0 else None)))
    gone, back = (t > 31.1) & (t < 39.9), t > 40.5
    assert (rows[gone, STATUS] == LaneStatus.DEAD_RECKONING).all()
    assert (rows[back, STATUS] == LaneStatus.NAVIGATING).all()
    np.testing.assert_allclose(rows[gone, DEAD_RECKONING_S], t[gone] - 30.0, atol=0.03)
    assert (np.diff(rows[gone, 16]) > 0.0).all()
    place = errors(t, rows, truth, 31.1, 39.9)[0]
    assert np.abs(place).max() < 25.0  # tilt from gravity alone, in a turn
    assert (np.abs(place) < 3.0 * rows[gone, SIGMA_PLACE]).mean() > 0.95
    assert length_rms(errors(t, rows, truth, 42.0)[0]) < 0.15


def test_the_antennas_place_is_not_the_imus():
    arm_m = 2.0
    stream, truth = circle()

    def antenna(t, values):
        _, _, a, b, psi = truth(t)
        rate = math.hypot(a, b) / 40.0
        values[0] += arm_m * math.cos(psi) / METRES_PER_DEG_LAT
        values[1] += arm_m * math.sin(psi) / METRES_PER_DEG_LON
        values[3] -= arm_m * rate * math.sin(psi)
        values[4] += arm_m * rate * math.cos(psi)
        return values

    block = gnss_changed(stream, antenna)
    site = {"site_lat_deg": LAT_DEG, "site_lon_deg": LON_DEG, "site_alt_m": 0.0}
    told = errors(*fly(LANE, calls_of(block, lever_arm_b_m=(arm_m, 0.0, 0.0), **site)), truth)[0]
    untold = errors(*fly(LANE, calls_of(block, **site)), truth)[0]
    assert length_rms(told) < 0.15
    assert length_rms(untold) > 1.5


def test_latitude_and_longitude_are_those_of_the_metres():
    stream, _ = circle(duration_s=20.0)

    def far(t, values):
        values[0] += 0.5
        values[1] -= 0.7
        return values

    site = {"site_lat_deg": LAT_DEG, "site_lon_deg": LON_DEG, "site_alt_m": 30.0}
    _, rows = fly(LANE, calls_of(gnss_changed(stream, far), **site))
    row = rows[-1]
    place = math.radians(LAT_DEG), math.radians(LON_DEG), 30.0
    ned = ned_from_lla(math.radians(row[7]), math.radians(row[8]), row[9], *place)
    np.testing.assert_allclose(ned, row[26:29], atol=1e-4)
    assert math.hypot(row[26], row[27]) > 70_000.0


def test_the_barometer_carries_the_height_between_bad_gnss_heights():
    stream, _ = circle()

    def bad(t, values):
        values[2] = 1.5 * math.sin(2.0 * math.pi * t / 15.0)
        values[7] = 1.5
        return values

    block = gnss_changed(stream, bad)
    t, rows = fly(LANE, calls_of(block))
    late = t > 30.0
    assert rms(rows[late, 28]) < 0.35  # of 1.06 m
    assert rms(rows[late, 6]) < 0.15


def test_a_spike_of_the_barometer_is_refused_and_a_level_that_stays_is_learned_as_offset():
    stream, _ = circle()
    for change in (lambda t: 5.0 if 40.0 <= t < 42.0 else 0.0, lambda t: 5.0 if t >= 40.0 else 0.0):
        jumped = [(*r[:5], [r[5][0], r[5][1] + change(r[4])] if r[3] == Kind.BARO else r[5]) for r in stream.rows]
        kept, stream.rows = stream.rows, jumped
        t, rows = fly(LANE, calls_of(stream.block()))
        stream.rows = kept
        assert np.abs(rows[t > 30.0, 28]).max() < 0.5


def test_a_hole_in_the_imus_data_starts_it_again_from_the_next_fix():
    stream, truth = circle()
    stream.rows = [row for row in stream.rows if not (row[3] == Kind.IMU and 40.0 < row[4] < 41.5)]
    t, rows = fly(LANE, calls_of(stream.block()))
    step = np.flatnonzero(t > 41.4)[0]
    assert rows[step, STATUS] == LaneStatus.ALIGNING
    assert np.isnan(rows[step, 4:10]).all()
    assert (rows[t > 42.5, STATUS] == LaneStatus.NAVIGATING).all()
    assert length_rms(errors(t, rows, truth, 50.0)[0]) < 0.3


def test_a_nan_is_a_failure_of_one_step():
    stream, truth = circle()

    def spoil(steps, meas):
        steps[np.abs(steps[:, at.U_T] - 40e9) < 11e6, at.U_DVEL] = math.nan
        return steps, meas

    t, rows = fly(LANE, calls_of(stream.block(), cut=500), spoil=spoil)
    broken = rows[:, STATUS] == LaneStatus.FAILED
    assert 1 <= broken.sum() <= 2
    told = np.isin(rows[:, STATUS], (LaneStatus.NAVIGATING, LaneStatus.DEAD_RECKONING))
    assert np.isfinite(rows[told][:, [*range(10), *range(13, 19), 26, 27, 28]]).all()
    assert length_rms(errors(t, rows, truth, 50.0)[0]) < 0.5


@pytest.mark.parametrize(("column", "value"), [(0, math.nan), (2, math.nan), (3, math.nan)])
def test_a_fix_with_a_part_missing_is_used_for_the_rest(column, value):
    stream, truth = circle()

    def without(t, values):
        if t >= 10.0:
            values[column] = value
        return values

    t, rows = fly(LANE, calls_of(gnss_changed(stream, without)))
    place, speed = errors(t, rows, truth)
    assert np.isfinite(rows[t > 20.0][:, 4:7]).all()
    assert length_rms(place) < (5.0 if column == 0 else 0.6)
    assert rms(speed) < 0.5


def test_a_parameter_changes_while_it_runs():
    calls = calls_of(circle()[0].block(), cut=500)
    t, kept = fly(LANE, calls)
    changed = fly(LANE, calls, lambda now: {"gnss_velocity_m_s": 0.5} if now >= 30.0 else {})[1]
    before, after = t < 29.0, t > 31.0
    np.testing.assert_array_equal(kept[before], changed[before])
    assert not np.array_equal(kept[after], changed[after])
    jumps = np.diff(changed[(t > 28.0) & (t < 34.0)][:, PLACE], axis=0)
    assert np.abs(jumps).max() < 0.3  # 10 m/s and 50 steps a second are 0.2


def test_before_the_first_fix_it_has_the_attitude_only():
    stream, _ = circle(duration_s=20.0)
    t, rows = fly(LANE, calls_of(gnss_changed(stream, lambda s, v: v if s >= 12.0 else None)))
    early, late = (t > 4.0) & (t < 11.9), t > 12.3
    assert (rows[early, STATUS] == LaneStatus.ATTITUDE).all()
    assert np.isfinite(rows[early, :4]).all()
    assert np.isnan(rows[early][:, [4, 7, 9, 13, 16, 26]]).all()
    assert (rows[late, STATUS] == LaneStatus.NAVIGATING).all()


def test_the_recorded_flight_is_navigated_better_than_the_autopilot_does(shared_data, tmp_path):
    """EKF3's own errors on this flight: 0.104 m, 0.091 m, 0.027 to 0.04 m/s."""
    from server.replay.run import replay

    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    settled = replay(log, tmp_path / "out", lanes=[LANE, "reference"]).lanes[LANE].settled
    assert settled.horizontal_m.rms < 0.10
    assert settled.vertical_less_median_m.rms < 0.05
    assert max(settled.vel_n_m_s.rms, settled.vel_e_m_s.rms) < 0.06
    assert settled.vel_d_m_s.rms < 0.045
    assert settled.cover_3sigma.horizontal is not None
    assert settled.cover_3sigma.horizontal > 0.95
