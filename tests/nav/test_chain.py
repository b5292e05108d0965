"""The chain inside the engine: nothing by default, in order, through holes, at any cut, told to the lanes."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from server.nav.calibration.applied import Calibration
from server.nav.ekf import layout as cols
from server.nav.engine import NavEngine
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess.conditioning import Conditioning
from server.nav.types import STAGE_COLUMNS, EngineSettings, Kind, SampleBlock
from server.rows import merged, row_topics
from server.settings import SettingsError, load_settings

from .synthetic import Stream, circle, field_model

CHAIN = {
    "gyro": {"butterworth_hz": 20.0},
    "accel": {"butterworth_hz": 8.0, "butterworth_order": 3.0},
    "mag": {"lowpass_hz": 5.0, "limit_gauss": 0.2},
    "baro": {"window_samples": 3.0},
}
NOT_SYMMETRIC = np.array([[1.01, 0.02, 0.0], [0.0, 0.98, 0.01], [0.005, 0.0, 1.0]])


def cut(block, begin, end):
    names = ("kind", "t_ns", "t_rx_ns", "data")
    return SampleBlock(**{name: getattr(block, name)[begin:end] for name in names}, boot_id=block.boot_id)


def fly(block, edges=(), lanes=("ins_ekf",), **told):
    engine = NavEngine(EngineSettings(lanes=lanes, **told), field_model)
    edges = [0, *sorted(edges), len(block.kind)]
    return merged([engine.step(cut(block, a, b)) for a, b in pairwise(edges) if b > a]), engine


def rows_of(result, lane="ins_ekf"):
    return next(rows for rows in result.lanes if rows.lane == lane)


def imu_block(t_s, values, kind=Kind.IMU):
    data = np.full((len(t_s), 14), np.nan)
    data[:, : values.shape[1]] = values
    t_ns = np.round(np.asarray(t_s) * 1e9).astype(np.int64)
    return SampleBlock(kind=np.full(len(t_s), int(kind), dtype=np.uint8), t_ns=t_ns, t_rx_ns=t_ns, data=data)


def conditioned(block, chain, calibration=None):
    conditioning = Conditioning(chain, calibration)
    begin, stages = 0, []
    while begin < len(block.kind):
        got = conditioning.run(block, begin, len(block.kind), int(block.t_ns[0]), 50.0)
        conditioning.take_changed()
        begin = got.end
        stages += list(got.stages)
    return conditioning, stages


def stage(stages, sensor):
    found = [rows for rows in stages if rows.sensor == sensor]
    return np.concatenate([r.t_ns for r in found]), np.concatenate([r.data for r in found])


def test_without_calibration_and_filters_nothing_changes_bit_for_bit():
    block = circle(duration_s=20.0)[0].block()
    plain, engine = fly(block)
    neutral, _ = fly(block, calibration=Calibration(), chain={"gyro": {"window_samples": 1.0}})
    np.testing.assert_array_equal(rows_of(plain).data, rows_of(neutral).data)
    np.testing.assert_array_equal(plain.filtered.data, neutral.filtered.data)
    assert plain.stages == neutral.stages == ()
    assert engine.snapshot().filter_delays == ()
    assert [info.active for info in engine.chain()] == [False] * 5


def test_a_chain_that_is_on_and_does_nothing_changes_nothing():
    """A limit that is never reached: the samples go the whole way and come out as they went in."""
    block = circle(duration_s=20.0)[0].block()
    plain, _ = fly(block)
    limits = {"gyro": {"limit_rad_s": 99.0}, "mag": {"limit_gauss": 99.0}, "baro": {"limit_m": 9999.0}}
    through, engine = fly(block, chain=limits)
    np.testing.assert_array_equal(rows_of(plain).data, rows_of(through).data)
    assert [info.name for info in engine.chain() if info.active] == ["gyro", "accel", "mag", "baro"]
    for rows in through.stages:
        n = rows.data.shape[1] // 3
        np.testing.assert_array_equal(rows.data[:, :n], rows.data[:, 2 * n :])


@given(st.lists(st.integers(1, 6000), max_size=6))
@settings(max_examples=12, deadline=None)
def test_filters_do_not_depend_on_the_cuts(cuts):
    block = circle(duration_s=22.0)[0].block()
    told = {"chain": CHAIN, "calibration": Calibration(gyro_offset=np.array([0.01, 0.0, 0.0]))}
    whole, _ = fly(block, **told)
    pieces, _ = fly(block, [c for c in cuts if c < len(block.kind)], **told)
    np.testing.assert_array_equal(rows_of(whole).data, rows_of(pieces).data)
    for one, other in zip(whole.stages, pieces.stages, strict=True):
        assert one.sensor == other.sensor
        np.testing.assert_array_equal(one.data, other.data)


def test_every_stage_is_there_and_the_last_one_is_scipys():
    rng = np.random.default_rng(5)
    t_s = np.arange(400) / 100.0
    values = rng.normal(size=(400, 6)) * 0.1 + [0, 0, 0, 0, 0, -9.8]
    _, stages = conditioned(imu_block(t_s, values), {"gyro": {"butterworth_hz": 12.0}})
    t_ns, gyro = stage(stages, "gyro")
    assert t_ns.tolist() == np.round(t_s * 1e9).astype(int).tolist()
    np.testing.assert_array_equal(gyro[:, :3], values[:, :3])
    sos = signal.butter(2, 12.0, fs=100.0, output="sos")
    start = signal.sosfilt_zi(sos)[:, :, None] * values[0, :3]
    expected, _ = signal.sosfilt(sos, values[:, :3], axis=0, zi=start)
    np.testing.assert_allclose(gyro[60:, 6:], expected[60:], atol=2e-3)  # the first interval designs it: 1st sample
    np.testing.assert_allclose(gyro[200:, 6:], expected[200:], atol=1e-9)
    assert set(STAGE_COLUMNS) == {"gyro", "accel", "mag", "baro", "airspeed"}
    for sensor, columns in STAGE_COLUMNS.items():
        assert row_topics(("ins_ekf",))[f"stages/{sensor}"].columns == columns


def test_bad_and_repeated_samples_never_reach_a_filter():
    rng = np.random.default_rng(6)
    t_s = np.arange(300) / 100.0
    values = rng.normal(size=(300, 6)) * 0.01 + [0, 0, 0, 0, 0, -9.8]
    chain = {"gyro": {"butterworth_hz": 10.0, "window_samples": 3.0}}
    _, clean = conditioned(imu_block(np.delete(t_s, [50, 60, 70]), np.delete(values, [50, 60, 70], axis=0)), chain)
    spoiled, stamps = values.copy(), t_s.copy()
    spoiled[50, 0], spoiled[60, 4] = np.nan, 1e9
    stamps[70] = stamps[69]
    conditioning, dirty = conditioned(imu_block(stamps, spoiled), chain)
    for one, other in zip(stage(clean, "gyro"), stage(dirty, "gyro"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.isfinite(conditioning.chain.array[at.K_BLOCKS :]).all()


def test_a_hole_ends_what_the_filter_remembers():
    t_s = np.concatenate((np.arange(100) * 0.01, 5.0 + np.arange(100) * 0.01))
    values = np.zeros((200, 6))
    values[:, 5] = -9.8
    values[:100, 0], values[100:, 0] = 1.0, -1.0
    _, stages = conditioned(imu_block(t_s, values), {"gyro": {"butterworth_hz": 1.0, "lowpass_hz": 1.0}})
    np.testing.assert_allclose(stage(stages, "gyro")[1][:, 6], values[:, 0], atol=1e-12)


def test_the_filter_follows_the_measured_rate_without_a_step():
    """200 Hz, then 100 Hz: the cut-off stays where it was, and a constant stays a constant."""
    t_s = np.concatenate((np.arange(1000) / 200.0, 5.0 + np.arange(2000) / 100.0))
    sine = np.sin(2 * np.pi * 5.0 * t_s)
    values = np.stack([sine, 0 * sine + 3.0, 0 * sine, 0 * sine, 0 * sine, 0 * sine - 9.8], axis=1)
    both = {"butterworth_hz": 5.0}
    conditioning, stages = conditioned(imu_block(t_s, values), {"gyro": both, "accel": both})
    filtered = stage(stages, "gyro")[1][:, 6:]
    for begin, end in ((600, 1000), (2200, 3000)):
        assert np.ptp(filtered[begin:end, 0]) / 2 == pytest.approx(math.sqrt(0.5), rel=0.03)
    np.testing.assert_allclose(filtered[:, 1], 3.0, atol=1e-9)
    assert conditioning.imu_delay_s == pytest.approx(math.sqrt(2) / (2 * math.pi * 5.0), rel=0.02)


def test_the_quicker_of_gyro_and_accelerometer_waits_for_the_slower():
    """One pulse on all axes: the middle of what comes out lies at the same time on both sensors."""
    t_s = np.arange(400) / 200.0
    values = np.zeros((400, 6))
    values[:, 5] = -9.8
    values[200:210, [0, 3]] = 1.0
    conditioning, stages = conditioned(imu_block(t_s, values), {"accel": {"butterworth_hz": 5.0}})
    middle = [float(t_s @ y / y.sum()) for y in (stage(stages, one)[1][:, 6] for one in ("gyro", "accel"))]
    assert abs(middle[1] - middle[0]) < 0.5 / 200.0 + 1e-4
    assert middle[0] - t_s[200:210].mean() == pytest.approx(conditioning.imu_delay_s, abs=0.5 / 200.0)


@pytest.mark.parametrize("sensor", ["mag", "baro"])
def test_what_is_filtered_is_valid_earlier_by_the_filters_delay(sensor):
    t_s = np.arange(100) * 0.05
    kind, row = (Kind.MAG, [0.2, 0.0, 0.4]) if sensor == "mag" else (Kind.BARO, [np.nan, 100.0])
    block = imu_block(t_s, np.tile(row, (100, 1)), kind)
    conditioning = Conditioning({sensor: {"window_samples": 5.0}}, None)
    seen = conditioning.run(block, 0, 100, 0, 50.0).seen
    late_s = t_s - seen[:, cols.M_T] * 1e-9
    np.testing.assert_allclose(late_s[2:], 0.1, atol=1e-9)
    (told,) = conditioning.delays()
    assert (told.name, told.source) == (sensor, "filter")
    assert told.delay_s == pytest.approx(0.1)


def test_counts_and_mounting_become_si_in_the_body():
    rng = np.random.default_rng(8)
    body = rng.normal(size=(200, 6)) * 0.1 + [0, 0, 0, 0, 0, -9.8]
    mount = np.diag([1.0, -1.0, -1.0])
    counts = np.hstack([body[:, :3] @ mount / 0.001 + 7.0, body[:, 3:] @ mount])
    units = {"gyro": {"rad_s_per_count": 0.001, "roll_deg": 180.0} | {f"zero_{a}_counts": 7.0 for a in "xyz"}}
    units["accel"] = {"roll_deg": 180.0}
    block = imu_block(np.arange(200) / 100.0, counts)
    conditioning, stages = conditioned(block, units)
    np.testing.assert_allclose(stage(stages, "gyro")[1][:, :3], body[:, :3], atol=1e-12)
    np.testing.assert_allclose(stage(stages, "accel")[1][:, :3], body[:, 3:], atol=1e-12)
    np.testing.assert_allclose(conditioning.chain.converted(Kind.IMU, block.data)[:, :6], body, atol=1e-12)
    np.testing.assert_array_equal(block.data[:, :6], counts)


def test_the_calibration_in_force_is_what_its_own_rows_say():
    """The kernel against the NumPy form that the jobs use, temperature included."""
    rng = np.random.default_rng(9)
    calibration = Calibration(
        gyro_matrix=NOT_SYMMETRIC, gyro_offset=np.array([0.01, -0.02, 0.03]), accel_matrix=NOT_SYMMETRIC.T,
        accel_offset=np.array([0.1, 0.2, -0.3]), gyro_per_k=np.array([1e-3, 0, 0]), accel_per_k=np.array([0, 1e-2, 0]),
        level=np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), mag_matrix=NOT_SYMMETRIC,
        mag_offset=np.array([0.05, 0.0, -0.02]), baro_bias_m=3.0, diff_pressure_bias_pa=12.0,
    )  # fmt: skip
    values = np.hstack([rng.normal(size=(50, 6)), np.full((50, 1), 40.0)])
    values[25:, 6] = np.nan
    block = imu_block(np.arange(50) * 0.01, values)
    _, stages = conditioned(block, {}, calibration)
    expected = calibration.rows(Kind.IMU, block.data)
    np.testing.assert_allclose(stage(stages, "gyro")[1][:, :3], expected[:, :3], atol=1e-12)
    np.testing.assert_allclose(stage(stages, "accel")[1][:, :3], expected[:, 3:6], atol=1e-12)
    for kind, sensor, column, row in (
        (Kind.MAG, "mag", slice(0, 3), [0.2, 0.1, 0.4]),
        (Kind.BARO, "baro", slice(1, 2), [np.nan, 100.0, np.nan]),
        (Kind.AIRSPEED, "airspeed", slice(0, 1), [80.0, np.nan, np.nan]),
    ):
        block = imu_block(np.arange(20) * 0.05, np.tile(row, (20, 1)), kind)
        _, stages = conditioned(block, {}, calibration)
        n = column.stop - column.start
        np.testing.assert_allclose(
            stage(stages, sensor)[1][:, :n], calibration.rows(kind, block.data)[:, column], atol=1e-12
        )


def test_a_field_that_only_the_calibration_makes_plausible_is_believed():
    """Hard iron of a gauss: raw the strength is no Earth field, calibrated it is; the unit stays the board's."""
    offset = np.array([0.7, -0.4, 0.3])
    block = imu_block(np.arange(40) * 0.05, np.tile(np.array([0.2, 0.0, 0.4]) + offset, (40, 1)), Kind.MAG)
    for calibration, fused in ((None, 0.0), (Calibration(mag_offset=offset), 40.0)):
        conditioning = Conditioning({}, calibration)
        seen = conditioning.run(block, 0, 40, 0, 50.0).seen
        assert (seen[:, cols.M_STATUS] == 0.0).sum() == fused
    np.testing.assert_allclose(seen[:, cols.M_DATA : cols.M_DATA + 3], np.tile([0.2, 0.0, 0.4], (40, 1)), atol=1e-12)


def test_differential_pressure_becomes_airspeed_with_the_density_that_baro_and_temperature_tell():
    stream = Stream()
    for k in range(40):
        stream.add(Kind.BARO, k * 0.1, [54019.9, np.nan, np.nan])
        stream.add(Kind.AIRSPEED, k * 0.1 + 0.01, [61.25 if k < 30 else -5.0, 3.0, -17.5])
    conditioning = Conditioning({"airspeed": {"convert": 1.0}}, None)
    seen = conditioning.run(stream.block(), 0, 80, 0, 50.0).seen
    speed = seen[seen[:, cols.M_KIND] == Kind.AIRSPEED, cols.M_DATA + 1]
    np.testing.assert_allclose(speed[:30], 10.0 * math.sqrt(1.225 / 0.7361), rtol=1e-3)
    np.testing.assert_array_equal(speed[30:], 0.0)


def test_clipped_samples_are_counted_and_shown():
    rng = np.random.default_rng(10)
    values = rng.normal(size=(500, 6)) * 0.05 + [0, 0, 0, 0, 0, -9.8]
    values[:, 3] += 40.0 * np.sin(np.arange(500) / 20.0)
    quiet = int((np.abs(values[:, 3]) >= 39.2).sum())
    values[:, 3] = values[:, 3].clip(-39.2, 39.2)  # ±4 g
    _, engine = fly(imu_block(np.arange(500) / 100.0, values))
    (imu,) = engine.snapshot().sensors
    assert quiet > 30
    assert quiet - 10 <= imu.clipped <= quiet  # the first of each run is only the largest so far
    assert imu.note == "imu-clipped"
    _, engine = fly(imu_block(np.arange(500) / 100.0, values), chain={"accel": {"full_scale_m_s2": 39.2}})
    assert engine.snapshot().sensors[0].clipped == (np.abs(values[:, 3]) >= 0.998 * 39.2).sum()


def test_a_board_at_rest_in_coarse_counts_is_not_clipped():
    values = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, -9.75], (500, 1))
    values[::3, 5] = -9.8
    _, engine = fly(imu_block(np.arange(500) / 100.0, values))
    assert engine.snapshot().sensors[0].clipped == 0


def test_what_does_not_exist_or_is_out_of_range_is_refused_and_changes_nothing():
    engine = NavEngine(EngineSettings(), field_model)
    for sensor, values in (
        ("lidar", {}), ("gyro", {"nope": 1.0}), ("gyro", {"butterworth_order": 5.0}), ("baro", {"roll_deg": 90.0}),
        ("gyro", {"butterworth_hz": 10.0, "window_samples": 2.5}), ("gyro", {"lowpass_hz": math.nan}),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"gyro|baro|lidar"):
            engine.set_chain(sensor, values)
        with pytest.raises(ValueError, match=r"gyro|baro|lidar"):
            NavEngine(EngineSettings(chain={sensor: values or {"x": 1.0}}), field_model)
    assert not any(info.active for info in engine.chain())


def test_a_filter_set_while_it_runs_tells_its_delay_and_says_so():
    block = circle(duration_s=20.0)[0].block()
    half = len(block.kind) // 2
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",)), field_model)
    engine.step(cut(block, 0, half))
    engine.set_chain("gyro", {"butterworth_hz": 20.0})
    result = engine.step(cut(block, half, len(block.kind)))
    assert [event.code for event in result.events if "chain" in event.code] == ["chain-changed"]
    (told,) = engine.snapshot().filter_delays
    assert told.delay_s == pytest.approx(math.sqrt(2) / (2 * math.pi * 20.0), abs=0.5 / 200.0)
    engine.set_chain("gyro", {"butterworth_hz": 0.0})
    assert engine.snapshot().filter_delays == ()


def test_the_setting_reaches_the_engine_from_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    texts = ["imu.butterworth_hz=40", "baro.window_samples=3"]
    told = load_settings({"preprocess": texts}).settings.engine_settings().chain
    assert told == {
        "gyro": {"butterworth_hz": 40.0},
        "accel": {"butterworth_hz": 40.0},
        "baro": {"window_samples": 3.0},
    }
    assert [info.name for info in NavEngine(EngineSettings(chain=told), field_model).chain() if info.active] == [
        "gyro", "accel", "baro",
    ]  # fmt: skip
    with pytest.raises(SettingsError):
        load_settings({"preprocess": ["gyro=3"]})
