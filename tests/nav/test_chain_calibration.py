"""Another calibration while it flies: nothing jumps, biases are carried over, a turned body starts the lanes anew."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.applied import Calibration
from server.nav.engine import NavEngine
from server.nav.types import LANE_COLUMNS, EngineSettings, Kind, LaneStatus, SampleBlock
from server.rows import merged

from .synthetic import circle, field_model

GYRO, ACCEL = LANE_COLUMNS.index("gyro_bias_x_rad_s"), LANE_COLUMNS.index("accel_bias_x_m_s2")
OFFSETS = Calibration(
    gyro_offset=np.array([0.02, -0.01, 0.015]), accel_offset=np.array([0.1, -0.05, 0.08]),
    mag_offset=np.array([0.02, 0.01, -0.015]), baro_bias_m=4.0,
)  # fmt: skip


def halves(block, at_s=30.03, into=2):
    """Cut in the middle of an open step."""
    k = int(np.searchsorted(block.t_ns, at_s * 1e9))
    names = ("kind", "t_ns", "t_rx_ns", "data")
    edges = (0, k, len(block.kind))
    return [SampleBlock(**{n: getattr(block, n)[a:b] for n in names}) for a, b in pairwise(edges)]


def fly(block, change=None, lanes=("ins_ekf",), **told):
    engine = NavEngine(EngineSettings(lanes=lanes, **told), field_model)
    first, second = halves(block)
    results = [engine.step(first)]
    if change is not None:
        engine.set_calibration(change)
    results.append(engine.step(second))
    result = merged(results)
    return next(rows for rows in result.lanes if rows.lane == lanes[0]), result, engine


@pytest.mark.parametrize("chain", [{}, {"gyro": {"butterworth_hz": 15.0}, "accel": {"window_samples": 4.0}}])
def test_new_offsets_move_the_biases_and_nothing_else(chain):
    """A flight whose calibration changes in the middle of a step is, in every state but the biases, the same flight.

    Not to the last bit: increments of a step are turned by the rate as it is given, bias and all, so a calibrated gyro
    serves the filter a little better from then on. What differs stays far inside σ; at the change itself nothing does.
    """
    block = circle(duration_s=45.0, gnss_delay_s=0.1)[0].block()
    told = {"chain": chain, "gnss_delay_s": 0.1, "mag_delay_s": 0.0, "imu_delay_s": 0.0, "baro_delay_s": 0.0}
    plain, _, _ = fly(block, **told)
    changed, result, engine = fly(block, OFFSETS, **told)
    before = plain.t_ns < 30.02e9
    np.testing.assert_array_equal(plain.data[before], changed.data[before])
    first = int(before.sum()) + 1
    apart = np.abs(plain.data - changed.data)
    assert apart[first, :4].max() < 1e-8
    assert apart[first, 4:7].max() < 3e-4
    assert apart[first, 26:29].max() < 1e-5
    after = slice(first, None)
    assert (apart[after, 1:4] < 0.2 * plain.data[after, 10:13]).all()
    assert (apart[after, 4:7] < 0.2 * plain.data[after, 13:16]).all()
    assert (apart[after, 26:29] < 0.2 * plain.data[after, 16:19]).all()
    moved = (plain.data - changed.data)[first]
    np.testing.assert_allclose(moved[GYRO : GYRO + 3], OFFSETS.gyro_offset, atol=1e-7)
    np.testing.assert_allclose(moved[ACCEL : ACCEL + 3], OFFSETS.accel_offset, atol=1e-6)
    (event,) = [event for event in result.events if event.code == "calibration-applied"]
    assert dict(event.values)["gyro_offset_x_rad_s"] == 0.02
    assert engine.calibration is OFFSETS


def test_without_the_carrying_over_the_same_change_would_throw_the_solution_off(monkeypatch):
    from server.nav.lanes.ins_ekf import InsEkf

    block = circle(duration_s=45.0)[0].block()
    plain, _, _ = fly(block)
    monkeypatch.setattr(InsEkf, "rebase", lambda self, change: None)
    changed, _, _ = fly(block, OFFSETS)
    after = plain.t_ns > 30.1e9
    assert np.abs(plain.data - changed.data)[after, 4:7].max() > 0.05


def test_the_field_in_gauss_and_the_raw_rows_are_as_the_board_sent_them():
    block = circle(duration_s=31.0)[0].block()
    _, result, _ = fly(block, OFFSETS)
    np.testing.assert_array_equal(result.block.data, block.data)
    t_ns, rows = next((r.t_ns, r.data) for r in result.stages if r.sensor == "mag")
    raw = block.data[(block.kind == Kind.MAG) & (block.t_ns >= t_ns[0])]
    np.testing.assert_allclose(rows[:, :3], raw[:, :3] - OFFSETS.mag_offset, atol=1e-12)


def test_a_calibration_that_is_there_from_the_start_is_the_one_that_comes_before_the_first_sample():
    block = circle(duration_s=20.0)[0].block()
    engines = [NavEngine(EngineSettings(calibration=c), field_model) for c in (OFFSETS, None)]
    engines[1].set_calibration(OFFSETS)
    one, other = (engine.step(block) for engine in engines)
    for a, b in zip(one.lanes, other.lanes, strict=True):
        np.testing.assert_array_equal(a.data, b.data)
    assert "calibration-applied" in [event.code for event in other.events]


def test_a_stretched_sensor_is_the_same_vehicle_once_it_is_calibrated():
    """Physics: the raw data of a worse sensor, calibrated, navigate like the good one's."""
    block = circle(duration_s=30.0)[0].block()
    M = np.array([[1.02, 0.01, 0.0], [-0.01, 0.97, 0.0], [0.0, 0.02, 1.01]])
    truth = Calibration(
        gyro_matrix=M, gyro_offset=np.array([0.05, 0.02, -0.03]), accel_matrix=M.T, mag_matrix=M.T @ M,
        accel_offset=np.array([0.3, -0.2, 0.5]), mag_offset=np.array([0.3, 0.1, -0.2]),
    )  # fmt: skip
    data = block.data.copy()
    imu, mag = block.kind == Kind.IMU, block.kind == Kind.MAG
    for rows, columns, matrix, offset in (
        (imu, slice(0, 3), truth.gyro_matrix, truth.gyro_offset),
        (imu, slice(3, 6), truth.accel_matrix, truth.accel_offset),
        (mag, slice(0, 3), truth.mag_matrix, truth.mag_offset),
    ):
        data[rows, columns] = data[rows, columns] @ np.linalg.inv(matrix).T + offset
    spoiled = SampleBlock(kind=block.kind, t_ns=block.t_ns, t_rx_ns=block.t_rx_ns, data=data)
    lanes = {"lanes": ("ins_ekf",)}
    good = NavEngine(EngineSettings(**lanes), field_model).step(block).lanes[0]
    calibrated = NavEngine(EngineSettings(calibration=truth, **lanes), field_model).step(spoiled).lanes[0]
    np.testing.assert_allclose(calibrated.data[-1, :10], good.data[-1, :10], rtol=1e-6, atol=1e-6)


def test_a_turned_body_starts_every_lane_anew_and_says_so():
    block = circle(duration_s=60.0, rest_s=58.0)[0].block()
    level = Rotation.from_euler("ZYX", [0.0, math.radians(-6.0), math.radians(4.0)]).as_matrix()
    rows, result, engine = fly(block, Calibration(level=level), lanes=("ins_ekf", "complementary"))
    assert [e.code for e in result.events if "calibration" in e.code] == [
        "calibration-level-changed", "calibration-applied",
    ]  # fmt: skip
    status = rows.data[:, LANE_COLUMNS.index("status")]
    change = int(np.searchsorted(rows.t_ns, 30.03e9))
    assert status[change - 1] == LaneStatus.NAVIGATING
    assert status[change] == LaneStatus.ALIGNING or status[change] == LaneStatus.ATTITUDE
    assert status[-100] == LaneStatus.NAVIGATING
    R_nb = Rotation.from_quat(rows.data[-100, :4], scalar_first=True)
    down_b = R_nb.inv().apply([0.0, 0.0, 1.0])  # the board lies level, so the vehicle is tilted by the level's inverse
    np.testing.assert_allclose(down_b, level @ [0.0, 0.0, 1.0], atol=0.01)
    assert engine.snapshot().lanes[0].failure == ""


def test_taking_a_calibration_off_again_brings_the_old_flight_back():
    block = circle(duration_s=40.0)[0].block()
    plain, _, _ = fly(block)
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",)), field_model)
    first, second = halves(block)
    one, three = halves(second, at_s=33.01)
    results = [engine.step(first)]
    for part, calibration in ((one, OFFSETS), (three, Calibration())):
        engine.set_calibration(calibration)
        results.append(engine.step(part))
    back = merged(results).lanes[0]
    apart = np.abs(back.data - plain.data)[-1]
    assert (apart[4:7] < 0.1 * plain.data[-1, 13:16]).all()
    assert (apart[GYRO : ACCEL + 3] < 1e-4).all()
    assert not any(info.active for info in engine.chain())


@pytest.mark.parametrize(
    "broken",
    [Calibration(gyro_offset=np.array([0.0, math.nan, 0.0])), Calibration(mag_matrix=np.diag([1.0, 1.0, 0.0]))],
)
def test_a_calibration_that_is_no_calibration_is_refused_and_the_old_one_stays(broken):
    engine = NavEngine(EngineSettings(calibration=OFFSETS), field_model)
    with pytest.raises(ValueError, match=r"finite|stretches"):
        engine.set_calibration(broken)
    assert engine.calibration is OFFSETS
    with pytest.raises(ValueError, match=r"finite|stretches"):
        NavEngine(EngineSettings(calibration=broken), field_model)
