"""What holds for every attitude lane: truth, invariances, refusals, and what the lanes' contract says of rows."""

import math

import numpy as np
import pytest

from server.nav.engine import NavEngine
from server.nav.lanes.base import LaneContext
from server.nav.lanes.registry import defaults_of, make
from server.nav.types import LANE_COLUMNS, EngineSettings, Kind, LaneStatus, Site
from tests.nav.attitude_laws import LANES, NINE_AXIS, SIX_AXIS, errors_deg, rms, run, tumbling
from tests.nav.synthetic import Stream, field_model

STATUS = LANE_COLUMNS.index("status")
DMP_HZ = {"dmp": 50.0}
TILT_DEG = {"complementary_1": 0.3, "kalman_angle_bias": 0.3, "vqf": 0.3, "dmp": 0.1}
"""A noiseless motion about one point leaves a filter nothing to be wrong about but its gyro noise."""


def stream_of(lane, **options):
    return tumbling(dmp_hz=DMP_HZ.get(lane, 0.0), **options)


@pytest.fixture(scope="module")
def block():
    return tumbling(dmp_hz=50.0).block()


@pytest.mark.parametrize("lane", LANES)
def test_a_tilting_and_turning_board_is_followed(block, lane):
    t, rows, _ = run(block, lane)
    tilt, heading = errors_deg(t, rows, after_s=1.0)
    assert rms(tilt) < TILT_DEG.get(lane, 0.3)
    assert rms(heading) < (1.5 if lane in SIX_AXIS else 0.5)


@pytest.mark.parametrize("lane", LANES)
def test_rows_do_not_depend_on_where_the_stream_is_cut(block, lane):
    whole, cut = run(block, lane)[1], run(block, lane, cut=37)[1]
    np.testing.assert_array_equal(whole, cut)


@pytest.mark.parametrize("lane", LANES)
def test_the_navigation_rate_changes_nothing_but_the_spacing(lane):
    block = stream_of(lane, noise=0.0).block()
    slow_t, slow, _ = run(block, lane, nav_rate_hz=50.0)
    fast_t, fast, _ = run(block, lane, nav_rate_hz=200.0)
    same = np.searchsorted(fast_t, slow_t[100:] - 1e-6)
    inner = np.abs(np.sum(slow[100:, :4] * fast[same, :4], axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(1.0, inner))).max() < 0.15


@pytest.mark.parametrize("lane", NINE_AXIS)
def test_turning_the_scene_turns_the_heading_and_nothing_else(lane):
    turned = run(tumbling(yaw_rad=2.0, noise=0.0, duration_s=25.0).block(), lane)
    tilt, heading = errors_deg(turned[0], turned[1], yaw_rad=2.0, after_s=1.0)
    assert rms(tilt) < 0.1
    assert rms(heading) < 0.2


@pytest.mark.parametrize("lane", LANES)
def test_rows_are_unit_quaternions_with_w_not_negative_and_a_status(block, lane):
    rows = run(block, lane)[1]
    known = np.isfinite(rows[:, 0])
    assert known.mean() > 0.99
    np.testing.assert_allclose(np.linalg.norm(rows[known, :4], axis=1), 1.0, atol=1e-9)
    assert (rows[known, 0] >= 0.0).all()
    assert (rows[known, STATUS] == LaneStatus.ATTITUDE).all()
    assert (rows[~known, STATUS] == LaneStatus.ALIGNING).all()


@pytest.mark.parametrize("lane", LANES)
def test_after_a_hole_the_lane_starts_again_and_finds_the_tilt(lane):
    stream, kept = stream_of(lane), Stream()
    kept.rows = [row for row in stream.rows if not 20.0 < row[4] < 23.0]
    t, rows, _ = run(kept.block(), lane)
    hole = np.flatnonzero(np.diff(t) > 2.0)[0] + 1
    if lane != "dmp":  # which is told its attitude anew in that very step
        assert rows[hole, STATUS] == LaneStatus.ALIGNING
        assert np.isnan(rows[hole, :4]).all()
    assert rms(errors_deg(t, rows, after_s=26.0)[0]) < 2.0


@pytest.mark.parametrize("lane", LANES)
def test_nan_and_wild_samples_leave_no_trace(lane):
    stream = stream_of(lane)
    clean = run(stream.block(), lane)[1]
    for t, values in (
        (12.0023, [math.nan] * 6),
        (13.0023, [900.0] * 6),
        (14.0023, [0.0, 0.0, 0.0, math.inf, 0.0, 0.0]),
    ):
        stream.add(Kind.IMU, t, values)
    stream.add(Kind.MAG, 15.0023, [math.nan, 0.2, 0.4])
    stream.add(Kind.MAG, 16.0023, [30.0, 0.2, 0.4])
    stream.add(Kind.DMP, 17.0023, [math.nan, 0.0, 0.0, 0.0])
    stream.add(Kind.DMP, 18.0023, [3.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(run(stream.block(), lane)[1], clean, atol=1e-12)


def made(lane):
    settings = EngineSettings(lanes=(lane,))
    return make(
        lane, LaneContext(settings=settings, t0_ns=0, delays_s=(math.nan,) * 4, vehicle=0, values=defaults_of(lane))
    )


@pytest.mark.parametrize("lane", LANES)
def test_a_step_that_is_not_a_number_fails_for_that_step_only(block, lane):
    seen = []

    class Tap(NavEngine):
        def _run_some(self, steps, meas, begin, end, part):
            seen.append((steps.copy(), meas.copy(), part.t_ns.copy()))

    Tap(EngineSettings(lanes=(lane,)), field_model).step(block)
    (steps, meas, t_ns) = seen[0]
    steps[700, 2:8] = math.nan
    rows = made(lane).step(steps, meas, t_ns).rows.data
    assert rows[700, STATUS] == LaneStatus.FAILED
    assert np.isnan(rows[700, :4]).all()
    assert np.flatnonzero(rows[:, STATUS] == LaneStatus.FAILED).tolist() == [700]
    assert np.isfinite(rows[720:, :4]).all()


@pytest.mark.parametrize("lane", [*SIX_AXIS, *NINE_AXIS])
def test_a_magnetic_heading_turns_by_the_declination_when_the_site_is_known(block, lane):
    declination_rad = 0.2
    site = Site(
        lat_deg=45.0, lon_deg=10.0, alt_m=0.0, gravity_m_s2=9.8, declination_rad=declination_rad,
        field_n_gauss=(0.25, 0.05, 0.43), decimal_year=2025.0, date_source="settings",
    )  # fmt: skip
    _, _, engine = run(block, lane)
    before = engine.snapshot().lanes[0].row[:4]
    engine._bank.set_site(site)
    last = Stream()
    for k in range(5):
        last.rows.append((0.0, True, k, Kind.IMU, 40.0 + 0.005 * (k + 1), [0.0, 0.0, 0.0, 0.0, 0.0, -9.8]))
    after = engine.step(last.block()).lanes[0].data[0, :4]
    turned = 2 * math.acos(min(1.0, abs(float(before @ after))))
    assert turned == pytest.approx(declination_rad, abs=0.02)


@pytest.mark.parametrize("lane", [*SIX_AXIS, *NINE_AXIS])
def test_rows_are_carried_on_over_the_delay_of_the_imu(lane):
    """A stream whose IMU and field are 60 ms late gives the same attitude as the punctual one, once that is said."""
    late = Stream()
    late.rows = [(t + 0.06, imu, k, kind, stamp + 0.06, v) for t, imu, k, kind, stamp, v in tumbling(noise=0.0).rows]
    t, rows, _ = run(late.block(), lane, imu_delay_s=0.06, mag_delay_s=0.06)
    tilt, heading = errors_deg(t, rows, after_s=2.0)
    ignored = errors_deg(t, run(late.block(), lane)[1], after_s=2.0)
    assert rms(tilt) < 0.5 * rms(ignored[0])
    assert rms(heading) < 1.0
