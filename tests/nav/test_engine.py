"""The engine on motions whose truth is a law: recovery, invariance, refusal."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.nav.engine import NavEngine
from server.nav.types import Aid, AidStatus, EngineSettings, Kind, LaneStatus, SampleBlock

from .synthetic import Stream, circle, field_model, heading_of, navigate


def errors(t_ns, rows, truth, after_s=30.0):
    """Return horizontal position, velocity and heading errors after the given time."""
    chosen = t_ns * 1e-9 > after_s
    expected = np.array([truth(t) for t in t_ns[chosen] * 1e-9])
    horizontal = rows[chosen][:, 26:28] - expected[:, :2]
    heading = (heading_of(rows[chosen]) - expected[:, 4] + math.pi) % (2 * math.pi) - math.pi
    return horizontal, rows[chosen][:, 4:6] - expected[:, 2:4], heading, rows[chosen]


def test_a_circle_is_recovered_inside_its_own_three_sigma():
    stream, truth = circle(gyro_bias=(0.01, -0.013, -0.006))
    t_ns, rows, _, _ = navigate(stream.block())
    position, velocity, heading, late = errors(t_ns, rows, truth)
    assert np.sqrt((position**2).sum(1).mean()) < 0.05
    assert np.sqrt((velocity**2).mean()) < 0.05
    assert np.sqrt((heading**2).mean()) < math.radians(0.5)
    inside = (np.abs(position) < 3 * late[:, 16:18]).all(1)
    assert inside.mean() > 0.95
    np.testing.assert_allclose(rows[-1, 19:22], (0.01, -0.013, -0.006), atol=1e-3)


def test_late_gnss_is_fused_at_its_own_time():
    """Ignoring 0.2 s at 10 m/s would cost 2 m; declared as a delay it costs nothing."""
    stream, truth = circle(gnss_delay_s=0.2)
    t_ns, rows, _, _ = navigate(stream.block(), gnss_delay_s=0.2)
    position, *_ = errors(t_ns, rows, truth)
    assert np.sqrt((position**2).sum(1).mean()) < 0.05


def test_a_measurement_that_arrives_late_changes_nothing_once_it_has_arrived():
    """The history law: punctual and late arrival give the same present, far inside its own σ.

    Not bit for bit: before the first fix has arrived, gravity was an aid a little longer.
    """
    punctual, _ = circle(duration_s=30.0, mag=True, baro=False)
    late, _ = circle(duration_s=30.0, mag=True, baro=False, gnss_arrives_s=0.15)
    t_a, rows_a, _, _ = navigate(punctual.block())
    t_b, rows_b, _, _ = navigate(late.block())
    t_check = 29.18  # after the fix of 29.0 has arrived late, before the fix of 29.2 is punctual
    i, j = np.searchsorted(t_a, t_check * 1e9) - 1, np.searchsorted(t_b, t_check * 1e9) - 1
    assert t_a[i] == t_b[j]
    apart = np.abs(rows_b[j] - rows_a[i])
    assert (apart[4:7] < 0.02 * rows_a[i, 13:16]).all()
    assert (apart[26:28] < 0.02 * rows_a[i, 16:18]).all()
    assert (apart[:4] < 0.02 * rows_a[i, 10:13].min()).all()
    np.testing.assert_allclose(rows_b[j, 10:19], rows_a[i, 10:19], rtol=0.01)


CIRCLE_BLOCK = circle(duration_s=25.0)[0].block()
CIRCLE_WHOLE = navigate(CIRCLE_BLOCK)


@given(st.lists(st.integers(1, len(CIRCLE_BLOCK.kind) - 1), max_size=30))
@settings(max_examples=25, deadline=None)
def test_the_result_does_not_depend_on_the_cuts(cuts):
    t_ns, rows, results, _ = navigate(CIRCLE_BLOCK, sorted(set(cuts)))
    assert np.array_equal(t_ns, CIRCLE_WHOLE[0])
    assert np.array_equal(rows, CIRCLE_WHOLE[1], equal_nan=True)
    aids = np.concatenate([r.aids.data for r in results])
    assert np.array_equal(aids, CIRCLE_WHOLE[2][0].aids.data, equal_nan=True)
    assert [e for r in results for e in r.events] == list(CIRCLE_WHOLE[2][0].events)


@pytest.mark.parametrize("nav_rate_hz", [20.0, 100.0, 200.0])
def test_the_navigation_rate_changes_the_rows_not_the_answer(nav_rate_hz):
    stream, truth = circle()
    t_ns, rows, _, _ = navigate(stream.block(), nav_rate_hz=nav_rate_hz)
    position, _, heading, _ = errors(t_ns, rows, truth)
    assert 1e9 / np.median(np.diff(t_ns)) == pytest.approx(nav_rate_hz, rel=0.01)
    assert np.sqrt((position**2).sum(1).mean()) < 0.06
    assert np.sqrt((heading**2).mean()) < math.radians(0.6)


def test_what_the_board_or_a_reference_says_never_reaches_the_estimate():
    stream, _ = circle(duration_s=20.0)
    _, alone, _, _ = navigate(stream.block())
    for k in range(100):
        lie = [0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0, 40.0, 50.0, 60.0]
        stream.add(Kind.REFERENCE, k * 0.2, lie)
        stream.add(Kind.ONBOARD, k * 0.2, lie)
    _, beside, results, _ = navigate(stream.block())
    assert np.array_equal(alone, beside, equal_nan=True)
    assert {lane.lane for r in results for lane in r.lanes} == {"ins_ekf", "onboard", "reference"}


def test_a_gnss_spike_is_refused_with_its_reason_and_moves_nothing():
    stream, truth = circle()
    spike = [45.001, 10.0, 0.0, 0.0, 0.0, math.nan, 0.1, 0.2, 0.05, 3.0]
    stream.add(Kind.GNSS, 40.11, spike)
    t_ns, rows, results, engine = navigate(stream.block())
    position, *_ = errors(t_ns, rows, truth)
    assert np.abs(position).max() < 0.3
    gnss = next(a for a in engine.snapshot().aids if a.aid == Aid.GNSS_POSITION)
    assert dict(gnss.refused)[AidStatus.REFUSED_GATE] == 1
    assert results[0].aids.data[results[0].aids.data[:, 1] == AidStatus.REFUSED_GATE][:, 14].max() > 1.0


def test_an_outage_is_said_its_covariance_grows_and_the_return_is_smooth():
    stream, truth = circle(duration_s=70.0)
    t_ns, rows, results, _ = navigate(stream.block(), gnss_withheld_s=((40.0, 55.0),), t_origin_ns=0)
    t = t_ns * 1e-9
    during = (t > 42.0) & (t < 55.0)
    assert (rows[during, 25] == LaneStatus.DEAD_RECKONING).all()
    sigma = np.hypot(rows[:, 16], rows[:, 17])
    assert (np.diff(sigma[during]) > -1e-3).all()
    assert sigma[during][-1] > 5 * sigma[during][0]
    position = rows[:, 26:28] - np.array([truth(x)[:2] for x in t])
    worst = np.linalg.norm(position[during], axis=1)
    assert (worst < 3 * sigma[during] + 0.1).all()
    after = t > 60.0
    assert (rows[after, 25] == LaneStatus.NAVIGATING).all()
    assert np.sqrt((position[after] ** 2).sum(1).mean()) < 0.06
    codes = [e.code for r in results for e in r.events]
    assert codes.count("gnss-lost") == 1
    assert codes.count("gnss-back") == 1
    assert {int(s) for s in results[0].aids.data[:, 1]} >= {AidStatus.FUSED, AidStatus.REFUSED_WITHHELD}


def test_a_hole_in_the_imu_data_is_reported_and_aligned_again():
    stream, _ = circle(duration_s=20.0, speed_m_s=0.0)
    stream.rows = [r for r in stream.rows if not (r[3] == Kind.IMU and 10.0 < r[4] < 12.5)]
    t_ns, rows, results, _ = navigate(stream.block())
    assert "imu-gap" in [e.code for r in results for e in r.events]
    assert rows[np.searchsorted(t_ns, 12.6e9), 25] == LaneStatus.ATTITUDE  # a first one, position to follow
    assert np.degrees(rows[np.searchsorted(t_ns, 12.6e9), 10]) > 3.0
    assert rows[-1, 25] == LaneStatus.NAVIGATING


def test_a_board_without_magnetometer_and_gnss_still_gives_tilt():
    stream = Stream()
    roll, pitch = 0.2, -0.1
    for k in range(2000):
        up = 9.80665 * np.array([math.sin(pitch), -math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch)])
        stream.add(Kind.IMU, k / 100, [0.0, 0.0, 0.0, *up])
    _, rows, _, engine = navigate(stream.block())
    assert rows[-1, 25] == LaneStatus.ATTITUDE
    assert np.isnan(rows[-1, 4:10]).all()
    w, x, y, z = rows[-1, :4]
    assert math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) == pytest.approx(roll, abs=1e-6)
    assert math.asin(2 * (w * y - z * x)) == pytest.approx(pitch, abs=1e-6)
    assert engine.snapshot().site is None


def test_a_reboot_starts_afresh_and_is_marked():
    stream, _ = circle(duration_s=15.0)
    engine = NavEngine(EngineSettings(), field_model)
    engine.step(stream.block(boot_id=0, offset_s=500.0))
    result = engine.step(stream.block(boot_id=1))
    fresh = NavEngine(EngineSettings(), field_model).step(stream.block())
    assert result.boot_id == 1
    own = next(lane for lane in result.lanes if lane.lane == "ins_ekf")
    new = next(lane for lane in fresh.lanes if lane.lane == "ins_ekf")
    assert np.array_equal(own.data, new.data, equal_nan=True)


def test_the_stamp_may_start_anywhere():
    """A board whose clock counts from 1970 navigates like one that counts from power-up."""
    stream, _ = circle(duration_s=20.0)
    _, rows, _, _ = navigate(stream.block())
    _, shifted, _, _ = navigate(stream.block(offset_s=1.7e9))
    np.testing.assert_allclose(shifted, rows, rtol=1e-6, atol=1e-6)


def test_settings_that_make_no_sense_are_refused_with_the_remedy():
    with pytest.raises(ValueError, match="no lane called nope; there are: ins_ekf"):
        NavEngine(EngineSettings(lanes=("nope",)), field_model)
    with pytest.raises(ValueError, match="between 1 and 2000"):
        NavEngine(EngineSettings(nav_rate_hz=0.0), field_model)


def test_an_empty_block_is_nothing():
    empty = SampleBlock(
        kind=np.empty(0, np.uint8), t_ns=np.empty(0, np.int64), t_rx_ns=np.empty(0, np.int64), data=np.empty((0, 14))
    )
    result = NavEngine(EngineSettings(), field_model).step(empty)
    assert result.lanes == ()
    assert len(result.aids.t_ns) == 0


def test_a_magnetometer_that_comes_late_gives_the_heading_when_it_comes():
    stream, truth = circle(duration_s=60.0)
    stream.rows = [r for r in stream.rows if r[3] != Kind.MAG or r[4] > 9.0]
    t_ns, rows, results, _ = navigate(stream.block())
    assert [e.code for r in results for e in r.events].count("heading-found") == 1
    before, after = rows[np.searchsorted(t_ns, 8.9e9)], rows[np.searchsorted(t_ns, 9.5e9)]
    assert before[12] == pytest.approx(math.pi, rel=0.01)
    assert after[12] < math.radians(6.0)
    _, _, heading, _ = errors(t_ns, rows, truth)
    assert np.sqrt((heading**2).mean()) < math.radians(0.5)


def test_a_car_without_a_magnetometer_takes_its_heading_from_the_course():
    stream, truth = circle(duration_s=60.0, mag=False)
    t_ns, rows, results, _ = navigate(stream.block())
    assert [e.code for r in results for e in r.events].count("heading-from-course") == 1
    assert rows[np.searchsorted(t_ns, 9e9), 25] == LaneStatus.ATTITUDE
    position, _, heading, _ = errors(t_ns, rows, truth)
    assert np.sqrt((position**2).sum(1).mean()) < 0.06
    assert np.sqrt((heading**2).mean()) < math.radians(1.0)


def test_a_board_that_is_never_still_is_aligned_in_motion():
    """In the air from the first sample: tilt from the running mean, and GNSS makes it good."""
    stream, truth = circle(duration_s=60.0, rest_s=0.0)
    rng = np.random.default_rng(9)
    for row in stream.rows:
        if row[3] == Kind.IMU:
            row[5][3:6] = np.array(row[5][3:6]) + 3.0 * rng.standard_normal(3)
    t_ns, rows, results, _ = navigate(stream.block(), accel_noise_m_s2_rthz=0.25)  # 3 m/s² white at 200 Hz
    aligned = next(e for r in results for e in r.events if e.code == "aligned")
    assert 4.9 < aligned.t_ns * 1e-9 < 5.2
    assert dict(aligned.values)["sigma_tilt_rad"] > math.radians(9.0)
    position, _, heading, late = errors(t_ns, rows, truth, after_s=40.0)
    assert np.sqrt((heading**2).mean()) < math.radians(6.0)
    assert (np.abs(position) < 3 * late[:, 16:18]).all(1).mean() > 0.9


@pytest.mark.parametrize("column", range(10))
def test_an_unknown_cell_of_a_gnss_row_harms_nothing(column):
    stream, truth = circle(duration_s=40.0)
    for row in stream.rows:
        if row[3] == Kind.GNSS and 20.0 < row[4] < 20.3:
            row[5][column] = math.nan
    t_ns, rows, results, _ = navigate(stream.block())
    position, *_ = errors(t_ns, rows, truth)
    assert np.abs(position).max() < 0.5
    assert "filter-failed" not in [e.code for r in results for e in r.events]


def test_stamps_before_zero_are_stamps_like_any_other():
    stream, _ = circle(duration_s=20.0)
    _, whole, _, _ = navigate(stream.block(offset_s=-10.0))
    t_ns, cut, _, _ = navigate(stream.block(offset_s=-10.0), 700)
    assert np.array_equal(whole, cut, equal_nan=True)
    assert (np.diff(t_ns) > 0).all()


def test_a_baro_that_jumps_loses_the_height_to_gnss_and_comes_back_with_a_new_datum():
    stream, _ = circle(duration_s=120.0)
    for row in stream.rows:
        if row[3] == Kind.BARO and row[4] > 40.0:
            row[5][1] += 80.0
    _, rows, _, engine = navigate(stream.block())
    assert abs(rows[-1, 9]) < 3 * rows[-1, 18]
    assert rows[-1, 18] < 2.0
    baro = next(a for a in engine.snapshot().aids if a.aid == Aid.BARO_HEIGHT)
    assert engine.snapshot().t_ns - baro.t_fused_ns < 1e9


def test_a_vertical_field_gives_no_heading_and_no_error():
    stream, _ = circle(duration_s=15.0, speed_m_s=0.0)  # in motion the heading is found without a field
    for row in stream.rows:
        if row[3] == Kind.MAG:
            row[5][:] = [0.0, 0.0, 0.5]
    _, rows, _, _ = navigate(stream.block())
    assert rows[-1, 25] == LaneStatus.ATTITUDE


def test_withheld_fixes_do_not_settle_the_site():
    stream, _ = circle(duration_s=15.0)
    *_, engine = navigate(stream.block(), gnss_withheld_s=((0.0, 100.0),))
    assert engine.snapshot().site is None


def test_an_aid_from_another_clock_is_refused():
    stream, truth = circle(duration_s=40.0)
    fix = [45.0, 10.01, 0.0, 0.0, 0.0, math.nan, 0.1, 0.2, 0.05, 3.0]
    stream.add(Kind.GNSS, 1e6, fix, arrives_s=20.0)
    t_ns, rows, _, _ = navigate(stream.block())
    position, *_ = errors(t_ns, rows, truth)
    assert np.abs(position).max() < 0.5


def test_slow_receivers_are_no_outage():
    stream, _ = circle(duration_s=60.0, gnss_hz=0.5)
    _, rows, results, _ = navigate(stream.block())
    assert "gnss-lost" not in [e.code for r in results for e in r.events]
    assert rows[-1, 25] == LaneStatus.NAVIGATING
