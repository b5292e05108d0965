"""The raw samples of a job read back to the same numbers, within bounds."""

import numpy as np

from server.calibration.samples import FILES, SampleFile
from server.nav.types import ROW_WIDTH, SAMPLE_COLUMNS, Kind
from server.replay.csv_in import read_table
from server.replay.folder import FolderLog
from server.replay.tables import TABLES, Table


def rows_of(kind, count, seed=0):
    """Numbers of every size, NaN where a sensor is silent; the stamps need all of int64."""
    rng = np.random.default_rng(seed)
    data = np.full((count, ROW_WIDTH), np.nan)
    columns = len(SAMPLE_COLUMNS[kind])
    data[:, :columns] = rng.normal(size=(count, columns)) * 10.0 ** rng.integers(-300, 300, (count, columns))
    data[::7, columns - 1] = np.nan
    t_ns = 2**61 + np.cumsum(rng.integers(1, 10**7, count))
    return t_ns, data


def whole_table(kind):
    columns = SAMPLE_COLUMNS[kind]
    return Table(stem=FILES[kind][:-4], kind=kind, columns=columns, needed=(), meaning="")


def test_every_number_reads_back_bit_for_bit(tmp_path):
    file = SampleFile(tmp_path / "job")
    for kind in FILES:
        t_ns, rows = rows_of(kind, 500)
        file.add(kind, t_ns[:200], rows[:200])
        file.flush()
        file.add(kind, t_ns[200:], rows[200:])
    assert file.close().rows == 2000
    for kind, name in FILES.items():
        t_ns, rows = rows_of(kind, 500)
        back = read_table(tmp_path / "job" / name, whole_table(kind))
        columns = len(SAMPLE_COLUMNS[kind])
        assert np.array_equal(back.t_ns, t_ns)
        np.testing.assert_array_equal(back.data[:, :columns], rows[:, :columns])


def test_a_job_is_a_sensor_folder_that_replay_opens(tmp_path):
    file = SampleFile(tmp_path)
    for kind in FILES:
        t_ns = np.arange(1, 4, dtype=np.int64) * 10**9
        rows = np.full((3, ROW_WIDTH), 0.5)
        file.add(kind, t_ns, rows)
    file.close()
    log = FolderLog(tmp_path)
    kinds = np.concatenate([block.kind for block in log.blocks(100)])
    assert sorted(kinds.tolist()) == sorted(3 * [int(kind) for kind in FILES])
    assert {table.file for table in TABLES} >= set(FILES.values())


def test_kinds_that_no_calibration_needs_are_not_kept(tmp_path):
    file = SampleFile(tmp_path)
    file.add(Kind.GNSS, np.arange(3), np.zeros((3, ROW_WIDTH)))
    assert (file.close().rows, list(tmp_path.iterdir())) == (0, [])


def test_the_caller_may_reuse_its_arrays(tmp_path):
    file = SampleFile(tmp_path)
    t_ns, rows = np.array([5]), np.full((1, ROW_WIDTH), 1.25)
    file.add(Kind.MAG, t_ns, rows)
    t_ns[:], rows[:] = 0, 0.0
    file.close()
    assert (tmp_path / "mag.csv").read_text().splitlines()[1] == "5,1.25,1.25,1.25"


def test_past_its_limit_it_ends_without_a_hole_and_says_so(tmp_path):
    file = SampleFile(tmp_path, max_bytes=3000)
    for k in range(20):
        file.add(Kind.MAG, np.array([k]) * 10, np.full((1, ROW_WIDTH), 0.5))
        file.flush()
        if k == 5:
            file.add(Kind.MAG, *(np.arange(1000), np.full((1000, ROW_WIDTH), 0.5)))
    kept = file.close()
    assert kept.rows == 6
    assert "limit" in kept.stopped
    assert (tmp_path / "mag.csv").stat().st_size == kept.size_bytes <= 3000
    assert len((tmp_path / "mag.csv").read_text().splitlines()) == 7


def test_what_no_disk_takes_is_bounded_in_memory(tmp_path):
    file = SampleFile(tmp_path, max_pending_rows=100)
    for _ in range(30):
        file.add(Kind.IMU, np.arange(10), np.zeros((10, ROW_WIDTH)))
    assert "too slow" in file.flush().stopped
    assert file.close().rows == 100


def test_a_disk_that_fails_ends_the_record_and_not_the_job(tmp_path):
    (tmp_path / "imu.csv").mkdir()
    file = SampleFile(tmp_path)
    file.add(Kind.IMU, np.arange(3), np.zeros((3, ROW_WIDTH)))
    assert "could not be written" in file.flush().stopped
    assert file.close().rows == 0


def test_a_closed_record_takes_nothing_more(tmp_path):
    file = SampleFile(tmp_path)
    file.close()
    file.add(Kind.IMU, np.arange(3), np.zeros((3, ROW_WIDTH)))
    assert (file.close().rows, file.kept.stopped) == (0, "closed")
