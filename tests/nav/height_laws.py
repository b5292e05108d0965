"""What every lane that knows only the height must do; each test file calls these with its lane's name."""

import math

import numpy as np

from server.nav.ekf import layout as at
from server.nav.types import LaneStatus

from .heights import ALT, POS_D, STATUS, VEL_D, airflow, calls_of, climb, errors, fly, rms, stream_of

DEAD_RECKONING_S = 29
ACCEL_BIAS = slice(22, 25)


def recovers_a_climb(name, height_m, speed_m_s, bias_m_s2):
    """A constant bias is found and a climb is followed within the given RMS errors."""
    t, rows = fly(name, calls_of(stream_of(accel_bias=(0.0, 0.0, 0.2))))
    height, speed = errors(t, rows, after_s=20.0)
    assert height < height_m
    assert speed < speed_m_s
    np.testing.assert_allclose(rows[-1, ACCEL_BIAS], (0.0, 0.0, 0.2), atol=bias_m_s2)
    assert np.isnan(rows[:, [0, 1, 2, 3, 4, 5, 7, 8, 10, 19, 26, 27]]).all()  # no attitude, nothing horizontal


def does_not_depend_on_the_cut(name):
    """Any cut of the stream gives the same bits."""
    block = stream_of(duration_s=25.0)
    whole = fly(name, calls_of(block))
    for cut in (1, 7, 1000):
        parts = fly(name, calls_of(block, cut))
        np.testing.assert_array_equal(whole[0], parts[0])
        np.testing.assert_array_equal(whole[1], parts[1])


def does_not_depend_on_the_rate(name, height_m, speed_m_s):
    """50 and 333 navigation steps a second end at the same height and speed, within the given RMS."""
    block = stream_of(rate_hz=333.0)
    t, rows = fly(name, calls_of(block))
    t_fast, fast = fly(name, calls_of(block, nav_rate_hz=333.0))
    late = t > 20.0
    for column, limit in ((POS_D, height_m), (VEL_D, speed_m_s)):
        assert rms(np.interp(t[late], t_fast, fast[:, column]) - rows[late, column]) < limit


def starts_with_the_mean_of_its_zero(name):
    """No height before the zero is found: 200 samples or 4 s; with fewer samples asked for, sooner."""
    calls = calls_of(stream_of(baro_hz=25.0, duration_s=12.0))
    t, rows = fly(name, calls)
    aligning = rows[:, STATUS] == LaneStatus.ALIGNING
    assert t[~aligning][0] == np.float64(4.02) or abs(t[~aligning][0] - 4.0) < 0.05
    assert np.isnan(rows[aligning][:, [VEL_D, POS_D, ALT]]).all()
    assert np.isfinite(rows[~aligning][:, [VEL_D, POS_D]]).all()
    t, rows = fly(name, calls, {"baro_zero_samples": 10.0})
    assert abs(t[rows[:, STATUS] == LaneStatus.NAVIGATING][0] - 0.36) < 0.05


def tells_the_height_above_the_sea_once_the_site_is_known(name):
    """alt_m is NaN before, then the site's height plus the one above the zero."""
    t, rows = fly(name, calls_of(stream_of(duration_s=20.0)))
    assert np.isnan(rows[:, ALT]).all()
    t, rows = fly(name, calls_of(stream_of(duration_s=20.0), site_lat_deg=45.0, site_lon_deg=10.0, site_alt_m=321.0))
    late = t > 5.0
    np.testing.assert_allclose(rows[late, ALT], 321.0 - rows[late, POS_D], atol=1e-9)


def never_uses_gnss(name):
    """A receiver that jumps about and climbs at 9 m/s changes neither height nor speed, to the last bit."""
    site = {"site_lat_deg": 45.0, "site_lon_deg": 10.0, "site_alt_m": 100.0}
    with_gnss = fly(name, calls_of(stream_of(duration_s=25.0, gnss_height_m=400.0), **site))[1]
    without = fly(name, calls_of(stream_of(duration_s=25.0), **site))[1]
    np.testing.assert_array_equal(with_gnss, without)


def says_when_the_barometer_is_gone(name, drift_m):
    """Two seconds after the last baro height it is dead reckoning, with its age; then it navigates again."""
    t, rows = fly(name, calls_of(stream_of(lambda _: (0.0, 0.0, 0.0), duration_s=50.0, baro_off=(30.0, 40.0))))
    before, gone, back = (t > 10) & (t < 31.9), (t > 32.1) & (t < 39.9), t > 40.2
    assert (rows[before | back, STATUS] == LaneStatus.NAVIGATING).all()
    assert (rows[gone, STATUS] == LaneStatus.DEAD_RECKONING).all()
    np.testing.assert_allclose(rows[gone, DEAD_RECKONING_S], t[gone] - 30.0, atol=0.06)
    assert (rows[before | back, DEAD_RECKONING_S] == 0.0).all()
    assert np.abs(rows[gone, POS_D]).max() < drift_m


def starts_again_after_a_hole_against_the_same_zero(name):
    """1.5 s without IMU while 20 m up: no height in the hole's step, then 20 m again, not zero."""
    t, rows = fly(name, calls_of(stream_of(duration_s=36.0, imu_off=(26.0, 27.5))))
    after = np.flatnonzero(t > 27.4)[0]
    assert rows[after, STATUS] == LaneStatus.ALIGNING
    assert np.isnan(rows[after, [POS_D, VEL_D]]).all()
    late = t > 32.0
    assert (rows[late, STATUS] == LaneStatus.NAVIGATING).all()
    assert np.abs(-rows[late, POS_D] - [climb(s)[0] for s in t[late]]).max() < 0.6


def never_lets_a_nan_leave(name):
    """One NaN in the accelerometer: FAILED for that step, from nothing after it, never NaN under another status."""
    calls = calls_of(stream_of(duration_s=40.0), cut=500)

    def spoil(steps, meas):
        hit = np.abs(steps[:, at.U_T] - 20e9) < 11e6
        steps[hit, at.U_DVEL + 2] = math.nan
        return steps, meas

    t, rows = fly(name, calls, spoil=spoil)
    broken = rows[:, STATUS] == LaneStatus.FAILED
    assert 1 <= broken.sum() <= 2
    assert abs(t[broken][0] - 20.0) < 0.02
    told = np.isin(rows[:, STATUS], (LaneStatus.NAVIGATING, LaneStatus.DEAD_RECKONING))
    assert np.isfinite(rows[told][:, [POS_D, VEL_D]]).all()
    assert np.isnan(rows[~told][:, [POS_D, VEL_D]]).all()
    assert told[-1]


def survives_a_nan_of_the_barometer(name):
    """A baro height that is none is passed over: the rows are those of a stream without it."""
    calls = calls_of(stream_of(duration_s=20.0), cut=500)

    def at_15_s(meas):
        return (meas[:, at.M_KIND] == 3) & (np.abs(meas[:, at.M_T] - 15e9) < 1e6)

    def spoil(steps, meas):
        meas[at_15_s(meas), at.M_DATA + 1] = math.nan
        return steps, meas

    def refuse(steps, meas):
        meas[at_15_s(meas), at.M_STATUS] = 5.0
        return steps, meas

    spoiled, refused = fly(name, calls, spoil=spoil)[1], fly(name, calls, spoil=refuse)[1]
    np.testing.assert_array_equal(spoiled, refused)
    assert not np.array_equal(spoiled, fly(name, calls)[1], equal_nan=True)


def compares_a_late_barometer_with_its_own_time(name, better=2.0):
    """A barometer that is 0.3 s late costs less when the delay is told."""
    block = stream_of(baro_delay_s=0.3, noise=0.0)
    told = errors(*fly(name, calls_of(block, baro_delay_s=0.3)), after_s=30.0)[0]
    untold = errors(*fly(name, calls_of(block)), after_s=30.0)[0]
    assert told * better < untold


def carries_on_over_the_imus_delay(name, height_m):
    """An IMU that is 50 ms late, told so: the row is still valid at its stamp."""
    late, prompt = 0.05, stream_of(noise=0.0)
    shifted = stream_of(lambda t: climb(t - late), noise=0.0, baro_delay_s=-late)
    t, rows = fly(name, calls_of(shifted, imu_delay_s=late))
    t_prompt, as_if = fly(name, calls_of(prompt))
    moving = t > 30.0
    assert rms(rows[moving, POS_D] - np.interp(t[moving], t_prompt, as_if[:, POS_D])) < height_m
    assert rms(rows[moving, POS_D] + [climb(s - late)[0] for s in t[moving]]) > 0.03  # what ignoring it would show


def takes_a_parameter_without_losing_its_state(name, parameter, value):
    """Changed in the air at 30 s: until then the same bits, no jump at the change, other numbers after it."""
    calls = calls_of(stream_of(baro_error=lambda t: 0.3 if t > 35.0 else 0.0), cut=500)
    t, kept = fly(name, calls)
    changed = fly(name, calls, lambda now: {parameter: value} if now >= 30.0 else {})[1]
    before, after = t < 29.0, t > 31.0
    np.testing.assert_array_equal(kept[before], changed[before])
    assert not np.array_equal(kept[after], changed[after])
    assert np.abs(np.diff(changed[(t > 29.0) & (t < 34.0), POS_D])).max() < 0.15
    assert np.abs(changed[after, POS_D] - kept[after, POS_D]).max() < 0.5


def scores_in_s3s_flight(name, aggressive):
    """Return (height, speed) RMS errors in the 40 s of S3's aggressive flight."""
    t, rows = fly(name, calls_of(stream_of(aggressive, duration_s=62.0, baro_error=airflow)))
    return errors(t, rows, 20.0, aggressive)


def on_the_recorded_flight(name, shared_data, tmp_path):
    """Return (height less median, speed down) RMS errors against the simulator's truth."""
    from server.replay.run import replay

    log = shared_data / "ardupilot_sitl" / "mission.tlog"
    summary = replay(log, tmp_path / "out", lanes=[name, "reference"])
    settled = summary.lanes[name].settled
    return settled.vertical_less_median_m.rms, settled.vel_d_m_s.rms
