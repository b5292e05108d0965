"""The in-flight job: any cut of the stream, any unit, what it refuses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.registry import collector_for
from server.nav.calibration.types import CalKind, Options
from server.nav.types import ROW_WIDTH, Kind
from tests.calibration.mag_learning_simulation import FIELD_N

OFFSET = np.array([0.12, -0.07, 0.2])


def recording(duration_s=60.0, turning=True, start_ns=5_000_000_000, gauss=1.0, seed=4):
    """Return (kind, stamps, rows) of a board that turns every way, IMU 100 Hz, magnetometer 25 Hz, in order."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration_s * 100)) * 0.01

    def pose(t_s):
        angles = [0.7 * t_s, 1.2 * np.sin(0.9 * t_s), 1.5 * np.sin(0.63 * t_s)]
        return Rotation.from_euler("ZYX", np.stack(angles, axis=1) * (1.0 if turning else 0.0))

    rate = (pose(t - 1e-3).inv() * pose(t + 1e-3)).as_rotvec() / 2e-3
    imu = np.full((len(t), ROW_WIDTH), np.nan)
    imu[:, :3] = rate + 0.003 * rng.standard_normal((len(t), 3))
    imu[:, 3:6] = pose(t).apply([0.0, 0.0, -9.8], inverse=True) + 0.02 * rng.standard_normal((len(t), 3))
    mag = np.full((len(t[::4]), ROW_WIDTH), np.nan)
    mag[:, :3] = pose(t[::4]).apply(FIELD_N, inverse=True) + OFFSET + 0.005 * rng.standard_normal((len(t[::4]), 3))
    mag[:, :3] *= gauss
    kind = np.concatenate([np.full(len(t), Kind.IMU), np.full(len(mag), Kind.MAG)])
    stamps = start_ns + np.round(np.concatenate([t, t[::4]]) * 1e9).astype(np.int64)
    order = np.lexsort((kind, stamps))
    return kind[order], stamps[order], np.concatenate([imu, mag])[order]


def collected(samples, chunk=500, options=None, collector=None):
    kind, t_ns, rows = samples
    collector = collector or collector_for(CalKind.MAG_IN_FLIGHT, options or Options())
    for begin in range(0, len(kind), chunk):
        part = slice(begin, begin + chunk)
        for one in (Kind.IMU, Kind.MAG):
            mine = kind[part] == one
            if mine.any():
                collector.feed(one, t_ns[part][mine], rows[part][mine])
    return collector


def test_the_offset_comes_with_an_honest_sigma():
    fit = collected(recording()).fit()
    assert fit.ok
    assert np.abs(fit.parameters["offset"] - OFFSET).max() < 0.003
    assert (np.abs(fit.parameters["offset"] - OFFSET) < 3.0 * fit.sigma["offset"]).all()
    assert fit.grade == "good"
    assert fit.coverage > 0.99
    assert fit.residual_after.value < 0.2 * fit.residual_before.value
    assert fit.details["changes"] == 0.0


@pytest.mark.parametrize("chunk", [1, 37, 100_000])
def test_how_the_stream_is_cut_changes_nothing(chunk):
    samples = recording(20.0)
    one, other = collected(samples), collected(samples, chunk)
    np.testing.assert_array_equal(one.fit().parameters["offset"], other.fit().parameters["offset"])
    np.testing.assert_array_equal(one.history.rows(), other.history.rows())
    np.testing.assert_array_equal(one.progress().points, other.progress().points)


def test_counts_give_the_same_in_counts():
    gauss, counts = collected(recording()).fit(), collected(recording(gauss=1090.0), options=Options(unit="raw")).fit()
    np.testing.assert_allclose(counts.parameters["offset"] / 1090.0, gauss.parameters["offset"], atol=0.002)
    assert counts.residual_after.unit == ""


def test_the_history_is_ten_rows_a_second_and_ends_at_the_result():
    collector = collected(recording())
    fit, rows = collector.fit(), collector.history.rows()
    assert np.median(np.diff(rows[:, 0])) == pytest.approx(1e8)
    assert len(rows) == pytest.approx(600, abs=2)
    np.testing.assert_allclose(rows[-1, 1:4], fit.parameters["offset"], atol=1e-4)
    assert rows[0, 0] > 5e9


def test_nothing_at_all_is_no_data_and_neither_is_one_sensor_alone():
    kind, t_ns, rows = recording(5.0)
    assert collector_for(CalKind.MAG_IN_FLIGHT, Options()).fit().failure.code == "no-data"
    for one in (Kind.IMU, Kind.MAG):
        mine = kind == one
        assert collected((kind[mine], t_ns[mine], rows[mine])).fit().failure.code == "no-data"


def test_a_board_at_rest_is_refused_with_what_is_missing():
    failure = collected(recording(turning=False)).fit().failure
    assert failure.code == "not-settled"
    assert failure.measured > failure.limit == 0.015
    assert failure.unit == "gauss"


def test_progress_asks_for_turning_until_it_is_sure():
    samples = recording()
    collector = collector_for(CalKind.MAG_IN_FLIGHT, Options())
    assert collector.progress().phase == "waiting"
    early = collected(tuple(part[:300] for part in samples), collector=collector).progress()
    assert early.instruction == "rotate-all-ways"
    assert not early.is_enough
    late = collected(tuple(part[300:] for part in samples), collector=collector).progress()
    assert late.is_complete
    assert late.fraction == 1.0
    np.testing.assert_allclose(late.offset, OFFSET, atol=0.003)


def test_fresh_samples_tell_a_right_offset_from_a_wrong_one():
    fresh = collected(recording(seed=8))
    right = fresh.check({"offset": OFFSET})
    assert right.ok
    assert right.residual.value < 0.01
    assert not fresh.check({"offset": OFFSET + np.array([0.1, 0.0, 0.0])}).ok
    assert collector_for(CalKind.MAG_IN_FLIGHT, Options()).check({"offset": OFFSET}).failure.code == "too-few-samples"


def test_a_reboot_in_the_middle_keeps_what_was_learned():
    collector = collected(recording(30.0))
    before = collector.fit().sigma["offset"]
    collected(recording(30.0, start_ns=1_000_000_000, seed=5), collector=collector)
    fit = collector.fit()
    np.testing.assert_allclose(fit.parameters["offset"], OFFSET, atol=0.003)
    assert fit.sigma["offset"].max() < before.max()
    assert fit.details["changes"] == 0.0


def test_samples_that_are_no_numbers_are_passed_over():
    kind, t_ns, rows = recording()
    rows = rows.copy()
    rows[::11, :6] = np.nan
    fit = collected((kind, t_ns, rows)).fit()
    np.testing.assert_allclose(fit.parameters["offset"], OFFSET, atol=0.004)
