"""A log reaches the collectors as live does: same samples, same unit of the field, same site."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from server.calibrate.errors import CalibrateError
from server.calibrate.logs import is_log, mag_scale, read_log
from server.calibration.samples import SampleFile
from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.types import ROW_WIDTH, EngineSettings, Kind, SampleBlock
from server.replay.source import BLOCK_ROWS, load
from tests.replay.sensor_folders import ALT_M, FIELD_N_GAUSS, LAT_DEG, LON_DEG, static_board


def field_block(norms: list[float]) -> SampleBlock:
    data = np.full((len(norms), ROW_WIDTH), np.nan)
    data[:, :3] = np.array(norms)[:, None] * [0.6, 0.0, 0.8]
    t_ns = np.arange(len(norms), dtype=np.int64) * 100_000_000
    return SampleBlock(kind=np.full(len(norms), Kind.MAG, np.uint8), t_ns=t_ns, t_rx_ns=t_ns, data=data)


def live_scale(blocks: list[SampleBlock]) -> float:
    engine = NavEngine(EngineSettings(lanes=("complementary_1",)), wmm_field)
    for block in blocks:
        engine.step(block)
    return next(one.scale for one in engine.snapshot().sensors if one.name == "mag")


@pytest.mark.parametrize(
    "norms",
    [
        [0.5] * 30,
        [500.0] * 30,
        [48000.0] * 30,
        [0.02] + [500.0] * 60,
        [500.0] * 60 + [0.5] * 60,
        [0.5] * 30 + [500.0] * 30,
        [float("nan"), 50.0, 51.0],
    ],
    ids=["gauss", "milligauss", "nanotesla", "first-odd", "proven-stays", "unproven-changes", "nan-first"],
)
def test_the_unit_of_the_field_is_the_one_the_live_engine_finds(norms: list[float]) -> None:
    blocks = [field_block(norms)]
    assert mag_scale(blocks) == pytest.approx(live_scale(blocks))


def test_a_folder_gives_its_raw_samples_and_its_site(tmp_path: Path) -> None:
    folder = static_board(tmp_path, duration_s=3.0, imu_hz=50.0)
    log = read_log(folder)
    assert {piece.kind for piece in log.pieces} == {Kind.IMU, Kind.MAG, Kind.BARO}
    assert sum(len(piece.t_ns) for piece in log.pieces if piece.kind is Kind.IMU) == 150
    assert log.site is not None
    assert (log.site.lat_deg, log.site.lon_deg) == pytest.approx((LAT_DEG, LON_DEG), abs=1e-5)
    assert log.site.decimal_year == pytest.approx(2026.89, abs=0.01)
    assert log.site.field_n_gauss == pytest.approx(wmm_field(LAT_DEG, LON_DEG, ALT_M, 2026.89)[0], abs=2e-4)
    field = np.concatenate([piece.rows[:, :3] for piece in log.pieces if piece.kind is Kind.MAG])
    np.testing.assert_allclose(field.mean(axis=0), FIELD_N_GAUSS, atol=1e-3)


def test_a_job_s_kept_samples_come_back_bit_for_bit(tmp_path: Path) -> None:
    """The kept folder is the job's: gauss already, though a magnet lay beside the board at first; temperatures too."""
    rng = np.random.default_rng(9)
    t_ns = np.arange(200, dtype=np.int64) * 10_000_001
    imu, mag = np.full((200, ROW_WIDTH), np.nan), np.full((200, ROW_WIDTH), np.nan)
    imu[:, :7] = rng.normal(0.0, 1.0, (200, 7))
    mag[:, :3] = rng.normal([0.3, 0.2, 0.4], 0.01, (200, 3))
    mag[:5, :3] *= 4.0
    kept = SampleFile(tmp_path / "job")
    for k in range(0, 200, 50):
        kept.add(Kind.MAG, t_ns[k : k + 50], mag[k : k + 50])
        kept.add(Kind.IMU, t_ns[k : k + 50], imu[k : k + 50])
    kept.close()
    log = read_log(tmp_path / "job")
    for kind, rows in ((Kind.IMU, imu), (Kind.MAG, mag)):
        mine = [piece for piece in log.pieces if piece.kind is kind]
        np.testing.assert_array_equal(np.concatenate([piece.rows for piece in mine]), rows)
        np.testing.assert_array_equal(np.concatenate([piece.t_ns for piece in mine]), t_ns)
    assert log.notes == ()


def test_a_folder_in_another_unit_than_its_name_says_is_scaled(tmp_path: Path) -> None:
    folder = static_board(tmp_path, duration_s=3.0, imu_hz=50.0)
    lines = (folder / "mag.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines[1:]]
    scaled = [",".join([t, *(repr(float(v) * 1e3) for v in values)]) for t, *values in cells]
    (folder / "mag.csv").write_text("\n".join([lines[0], *scaled]) + "\n")
    log = read_log(folder)
    field = np.concatenate([piece.rows[:, :3] for piece in log.pieces if piece.kind is Kind.MAG])
    np.testing.assert_allclose(field.mean(axis=0), FIELD_N_GAUSS, atol=1e-3)
    assert any("multiplied by 0.001" in note for note in log.notes)


def test_a_tlog_s_field_comes_out_in_gauss_and_its_site_is_the_engine_s(shared_data: Path) -> None:
    path = shared_data / "ardupilot_sitl" / "mission.tlog"
    log, blocks = read_log(path), list(load(path).blocks(BLOCK_ROWS))
    engine = NavEngine(EngineSettings(lanes=("complementary_1",)), wmm_field)
    for block in blocks:
        engine.step(block)
    seen = engine.snapshot()
    assert log.site is not None
    assert seen.site is not None
    assert log.site.field_n_gauss == pytest.approx(seen.site.field_n_gauss, rel=1e-5)
    assert any("multiplied by 1e-06" in note for note in log.notes)
    field = np.concatenate([piece.rows[:, :3] for piece in log.pieces if piece.kind is Kind.MAG])
    norm = float(np.median(np.linalg.norm(field, axis=1)))
    assert norm == pytest.approx(float(np.linalg.norm(log.site.field_n_gauss)), rel=0.1)


def test_what_is_no_log_says_so(tmp_path: Path) -> None:
    assert is_log(tmp_path)
    assert is_log(Path("a.TLOG"))
    assert not is_log(Path("a.csv"))
    with pytest.raises(CalibrateError, match=r"holds none of mag\.csv"):
        read_log(tmp_path)
    with pytest.raises(CalibrateError, match=r"does not exist"):
        read_log(tmp_path / "none.tlog")
