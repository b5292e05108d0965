"""A sensor folder as one stream: order, ties, cuts, and what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from server.nav.types import Kind, SampleBlock
from server.replay.errors import ReplayError
from server.replay.folder import FolderLog
from server.replay.source import load
from tests.replay.sensor_folders import HEADERS, write_csv

ZEROS = (0,) * 6


def whole(blocks: list[SampleBlock]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kind, t_ns, data = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("kind", "t_ns", "data"))
    return kind, t_ns, data


def test_equal_stamps_bring_every_aid_before_the_imu_sample(tmp_path: Path) -> None:
    write_csv(tmp_path, "imu", [(t, *ZEROS) for t in (10, 20, 30)])
    write_csv(tmp_path, "gnss", [(20, 47, 8, 500, 0, 0, 0, 1, 1, 1, 3)])
    write_csv(tmp_path, "baro", [(5, 101325, None), (20, None, 3)])
    write_csv(tmp_path, "mag", [(20, 0.2, 0, 0.4)])
    write_csv(tmp_path, "airspeed", [(20, 5, None)])
    write_csv(tmp_path, "reference", [(20, 1, 0, 0, 0, None, None, None, None, None, None)])
    kind, t_ns, data = whole(list(FolderLog(tmp_path).blocks(100)))
    want = [Kind.BARO, Kind.IMU, Kind.MAG, Kind.BARO, Kind.AIRSPEED, Kind.GNSS, Kind.REFERENCE, Kind.IMU, Kind.IMU]
    assert kind.tolist() == want
    assert t_ns.tolist() == [5, 10, 20, 20, 20, 20, 20, 20, 30]
    np.testing.assert_array_equal(data[kind == Kind.BARO][:, :3], [[101325, np.nan, np.nan], [np.nan, 3, np.nan]])


@pytest.mark.parametrize("rows", [1, 7, 4096])
def test_the_stream_does_not_depend_on_the_cut(tmp_path: Path, rows: int) -> None:
    write_csv(tmp_path, "imu", [(10 * k, *(k + j for j in range(6))) for k in range(100)])
    write_csv(tmp_path, "mag", [(30 * k + 1, k, k, k) for k in range(30)])
    log = FolderLog(tmp_path)
    blocks = list(log.blocks(rows))
    assert max(len(b.t_ns) for b in blocks) == min(rows, 130)
    for found, want in zip(whole(blocks), whole(list(FolderLog(tmp_path).blocks(1 << 20))), strict=True):
        np.testing.assert_array_equal(found, want)
    assert log.fraction() == 1.0


def test_rows_out_of_order_are_sorted_and_repeated_stamps_left_out_and_both_counted(tmp_path: Path) -> None:
    write_csv(tmp_path, "mag", [(t, k, 0, 0) for k, t in enumerate((10, 30, 20, 20, 40, 40))])
    log = FolderLog(tmp_path)
    _, t_ns, data = whole(list(log.blocks(100)))
    assert t_ns.tolist() == [10, 20, 30, 40]
    assert data[:, 0].tolist() == [0, 2, 1, 4]
    assert (log.account().losses["out_of_order"], log.account().losses["duplicate_t_ns"]) == (1, 2)
    assert "mag.csv: t_ns went backwards 1 times" in log.account().notes[0]


def test_the_origin_of_outages_is_the_earliest_stamp_of_any_file(tmp_path: Path) -> None:
    write_csv(tmp_path, "imu", [(1000, *ZEROS)])
    write_csv(tmp_path, "reference", [(400, 1, 0, 0, 0, 47, 8, 500, 0, 0, 0)])
    assert FolderLog(tmp_path).t_origin_ns == 400


def test_q30_quaternions_become_unit_and_floats_are_refused(tmp_path: Path) -> None:
    write_csv(tmp_path, "dmp", [(1, 759250125, 0, 0, -759250125), (2, 0, 0, 0, 0), (3, None, None, None, None)])
    log = FolderLog(tmp_path)
    data = whole(list(log.blocks(9)))[2]
    np.testing.assert_allclose(data[0, :4], [0.5**0.5, 0, 0, -(0.5**0.5)], atol=1e-9)
    assert np.isnan(data[1:, :4]).all()
    assert log.account().losses["bad_quaternions"] == 1
    write_csv(tmp_path, "dmp", [(1, 0.7071, 0, 0, 0.7071)])
    with pytest.raises(ReplayError, match=r"dmp\.csv: q_w, q_x, q_y, q_z must be int32 in Q30.*2\^30"):
        FolderLog(tmp_path)


def test_files_it_does_not_know_are_named_with_the_nearest_it_does(tmp_path: Path) -> None:
    write_csv(tmp_path, "imu", [(1, *ZEROS)])
    write_csv(tmp_path, "gps", [(1,)], header="t_ns")
    write_csv(tmp_path, "magn", [(1,)], header="t_ns")
    assert FolderLog(tmp_path).account().notes == (
        "gps.csv is not part of a sensor folder and is ignored (did you mean gnss.csv?).",
        "magn.csv is not part of a sensor folder and is ignored (did you mean mag.csv?).",
    )


def test_a_folder_with_headers_only_is_an_empty_log(tmp_path: Path) -> None:
    for stem in HEADERS:
        write_csv(tmp_path, stem, [])
    log = FolderLog(tmp_path)
    assert (list(log.blocks(10)), log.t_origin_ns) == ([], -1)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nothing.tlog", "does not exist"),
        ("empty", r"holds none of mag\.csv.*imu\.csv"),
        ("imu.csv", "Give the folder that holds it"),
        ("log.bin", "is neither a .tlog nor a sensor folder"),
        ("noise.tlog", "is not a .tlog"),
    ],
)
def test_what_is_no_log_is_refused_with_a_remedy(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "empty").mkdir()
    for file in ("imu.csv", "log.bin", "noise.tlog"):
        (tmp_path / file).write_bytes(b"not a log " * 100)
    with pytest.raises(ReplayError, match=says):
        load(tmp_path / name)


@pytest.mark.parametrize("fix", ["9", "7", "-1", "2.5", "inf"])
def test_a_fix_type_that_is_none_is_refused_with_its_stamp_and_the_known_ones(tmp_path: Path, fix: str) -> None:
    rows = [(t, *[None] * 9, kind) for t, kind in ((10, "3"), (20, ""), (30, fix), (40, "6"))]
    write_csv(tmp_path, "gnss", rows)
    with pytest.raises(ReplayError, match=rf"fix_type, at t_ns 30: {fix} is no kind of fix.*6 fixed"):
        FolderLog(tmp_path)


def test_every_kind_of_fix_and_an_unknown_one_are_read(tmp_path: Path) -> None:
    write_csv(tmp_path, "gnss", [(k, *[None] * 9, kind) for k, kind in enumerate(["", "nan", *range(7)])])
    assert sum(len(block.t_ns) for block in FolderLog(tmp_path).blocks(100)) == 9
