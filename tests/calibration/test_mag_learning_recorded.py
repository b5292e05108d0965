"""The learning on recorded motion, against what the cameras' attitude says and what an autopilot logged."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.in_flight import MagInFlight
from server.nav.calibration.types import Options
from server.nav.ekf.attitude import layout as attitude
from server.nav.ekf.attitude.block import run_block
from server.nav.ekf.attitude.parameters import default_parameters
from server.nav.preprocess.check import decade_scale
from server.nav.types import ROW_WIDTH, Kind
from server.replay.source import load
from tests.sets import broad, inertialnav_x8
from tests.sets.folder import GAUSS_PER_MILLIGAUSS, HALF_TURN_ABOUT_X

MOVED_S = {1: (34, 159), 6: (38, 160), 10: (37, 158), 15: (41, 146), 21: (36, 154), 28: (46, 135)}
TOLERANCE_GAUSS = 0.02  # 2 µT


def rows_of(*columns):
    rows = np.full((len(columns[0]), ROW_WIDTH), np.nan)
    values = np.concatenate(columns, axis=1)
    rows[:, : values.shape[1]] = values
    return rows


def flown(t_imu, gyro, accel, t_mag, mag, collector=None):
    """Feed everything, as `feed` gets it from a recording; return the collector."""
    collector = collector or MagInFlight(Options())
    collector.feed(Kind.IMU, t_imu, rows_of(gyro, accel))
    collector.feed(Kind.MAG, t_mag, rows_of(mag))
    collector.state()
    return collector


def trial(shared_data, number):
    """Return stamps, rates, forces, field in FRD and gauss, and the recording itself."""
    recorded = broad.load(shared_data, number)
    frd = [recorded[name] * HALF_TURN_ABOUT_X for name in ("imu_gyr", "imu_acc", "imu_mag")]
    return broad.stamps_ns(recorded), frd[0], frd[1], frd[2] * broad.GAUSS_PER_MICROTESLA, recorded


def by_the_cameras(shared_data, number, begin_s, end_s):
    """Return the offset by least squares with the optical attitude: m = Rᵀ f + b + τ ω × m."""
    t_ns, gyro, _, mag, recorded = trial(shared_data, number)
    used = np.isfinite(recorded["opt_quat"]).all(axis=1) & (t_ns > begin_s * 1e9) & (t_ns < end_s * 1e9)
    R_bn = Rotation.from_quat(broad.quat_nb(recorded["opt_quat"][used]), scalar_first=True).inv().as_matrix()
    late = np.cross(gyro[used], mag[used])[:, :, None]
    A = np.concatenate([R_bn, np.broadcast_to(np.eye(3), R_bn.shape), late], axis=2).reshape(-1, 7)
    return np.linalg.lstsq(A, mag[used].ravel(), rcond=None)[0][3:6]


def history_between(collector, begin_s, end_s):
    rows = collector.history.rows()
    return rows[(rows[:, 0] >= begin_s * 1e9) & (rows[:, 0] <= end_s * 1e9)]


@pytest.mark.parametrize(("number", "moves_s", "off_s", "end_s"), [(33, 46.1, 104.0, 136.0), (36, 43.6, 102.0, 130.0)])
def test_an_attached_magnet_is_followed_on_and_off_within_30_s(shared_data: Path, number, moves_s, off_s, end_s):
    t_ns, gyro, accel, mag, _ = trial(shared_data, number)
    collector = flown(t_ns, gyro, accel, t_ns, mag)
    attached = by_the_cameras(shared_data, number, moves_s + 1.0, 92.0)
    bare = by_the_cameras(shared_data, number, off_s, end_s)
    for begin, until, truth in ((moves_s + 30.0, 92.0, attached), (off_s + 26.0, end_s, bare)):
        rows = history_between(collector, begin, until)
        assert np.abs(rows[:, 1:4] - truth).max() < TOLERANCE_GAUSS
    assert collector.state().changes == 1  # the first was there before anything had been learned
    np.testing.assert_allclose(collector.state().t_changed_ns, (off_s - 4.0) * 1e9, atol=4e9)


@pytest.mark.parametrize("number", [33, 36])
def test_one_that_knew_the_bare_board_notices_the_magnet_and_learns_nothing_at_rest(shared_data: Path, number):
    t_ns, gyro, accel, mag, _ = trial(shared_data, number)
    bare = by_the_cameras(shared_data, number, 104.0, 130.0)
    collector = MagInFlight(Options())
    collector._learner.reset(tuple(bare), 0.01)
    flown(t_ns, gyro, accel, t_ns, mag, collector)
    resting = history_between(collector, 0.0, 30.0)[:, 1:4]
    np.testing.assert_array_equal(resting, np.broadcast_to(bare, resting.shape))
    attached = by_the_cameras(shared_data, number, 50.0, 92.0)
    assert np.abs(history_between(collector, 78.0, 92.0)[:, 1:4] - attached).max() < TOLERANCE_GAUSS
    assert collector.state().changes >= 1


@pytest.mark.parametrize("number", MOVED_S)
def test_without_a_magnet_nothing_wrong_is_learned(shared_data: Path, number):
    t_ns, gyro, accel, mag, _ = trial(shared_data, number)
    collector = flown(t_ns, gyro, accel, t_ns, mag)
    truth = by_the_cameras(shared_data, number, *MOVED_S[number])
    np.testing.assert_array_equal(history_between(collector, 0.0, 26.0)[:, 1:4], 0.0)
    settled = history_between(collector, MOVED_S[number][0] + 60.0, MOVED_S[number][1])
    error = np.abs(settled[:, 1:4] - truth)
    assert (error < TOLERANCE_GAUSS).all()
    # the cameras' own answer differs by 1 to 3 mG between quarters of a trial
    assert np.sqrt(np.mean(error**2 / (settled[:, 4:7] ** 2 + 0.002**2))) < 1.5
    assert collector.state().changes == 0


def test_a_magnet_that_stays_on_the_table_is_not_taken_for_the_boards(shared_data: Path):
    t_ns, gyro, accel, mag, _ = trial(shared_data, 28)
    moving = history_between(flown(t_ns, gyro, accel, t_ns, mag), 36.0, 146.0)
    assert np.abs(moving[:, 1:4]).max() < TOLERANCE_GAUSS


def test_the_attitude_filters_own_offset_agrees(shared_data: Path):
    t_ns, gyro, accel, mag, _ = trial(shared_data, 33)
    collector = flown(t_ns, gyro, accel, t_ns, mag)
    feed = MagInFlight(Options())._feed
    feed.take(Kind.IMU, t_ns, rows_of(gyro, accel))
    feed.take(Kind.MAG, t_ns, rows_of(mag))
    steps, meas = feed.steps(is_last=True)
    rows = np.empty((len(steps), attitude.O_SIZE))
    run_block(steps, meas, 0.0, attitude.new_memory(), default_parameters(), rows)
    for time_s in (92.0, 135.0):
        ours = history_between(collector, time_s, time_s + 0.1)[0]
        theirs = rows[np.searchsorted(steps[:, 0], time_s * 1e9)]
        apart = ours[1:4] - theirs[attitude.O_MAG_OFFSET : attitude.O_MAG_OFFSET + 3]
        assert np.abs(apart).max() < TOLERANCE_GAUSS


@pytest.fixture(scope="module")
def x8(shared_data: Path):
    columns = inertialnav_x8.load(shared_data)
    logged = inertialnav_x8.stack(columns, "MAG", "OfsX", "OfsY", "OfsZ")
    raw = inertialnav_x8.stack(columns, "MAG", "MagX", "MagY", "MagZ") - logged
    gyro = inertialnav_x8.stack(columns, "IMU", "GyrX", "GyrY", "GyrZ")
    accel = inertialnav_x8.stack(columns, "IMU", "AccX", "AccY", "AccZ")
    t_imu, t_mag = (inertialnav_x8.stamps_ns(columns[f"{name}.TimeMS"]) for name in ("IMU", "MAG"))
    return (t_imu, gyro, accel, t_mag, raw * GAUSS_PER_MILLIGAUSS), -logged * GAUSS_PER_MILLIGAUSS


@pytest.mark.parametrize("known", [False, True])
def test_a_flight_learns_what_the_autopilot_learned(x8, known):
    samples, logged = x8
    collector = MagInFlight(Options())
    if known:
        collector._learner.reset(tuple(logged[0]), 0.03)
    t_imu, gyro, accel, t_mag, field = samples
    flown(t_imu, gyro, accel, t_mag, field, collector)
    fit = collector.fit()
    assert fit.ok
    assert np.abs(fit.parameters["offset"] - logged[-1]).max() < 0.010
    assert fit.residual_after is not None
    assert fit.residual_before is not None
    assert fit.residual_after.value < 0.3 * fit.residual_before.value
    on_ground = history_between(collector, 20.0, 190.0)[:, 1:4]
    np.testing.assert_allclose(on_ground, np.broadcast_to(on_ground[0], on_ground.shape), atol=1e-3)


def test_an_autopilots_calibrated_compass_has_no_offset_left(shared_data: Path):
    log = load(shared_data / "ardupilot_sitl" / "mission.tlog")
    collector, scale = MagInFlight(Options()), 0.0
    for block in log.blocks(4096):
        for kind in (Kind.IMU, Kind.MAG):
            rows = block.data[block.kind == kind].copy()
            if kind is Kind.MAG and len(rows):
                scale = scale or decade_scale(float(np.linalg.norm(rows[0, :3])))
                rows[:, :3] *= scale
            collector.feed(kind, block.t_ns[block.kind == kind], rows)
    state = collector.state()
    assert state.excitation.min() > 0.9
    assert np.abs(state.offset_gauss).max() < 0.010
    assert (np.abs(state.offset_gauss) < 3.0 * state.sigma_gauss).all()
