"""Filters and calibration in a replay: what they do to the lanes, what the stages show, and what the summary says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.calibrate import command as calibrate
from server.calibrate.told import Told
from server.calibration.exchange.native import native_text
from server.calibration.records import CalibrationSet
from server.magnetic import wmm_field
from server.nav.calibration.types import CalKind, Sensor
from server.nav.engine import NavEngine
from server.nav.types import STAGE_COLUMNS
from server.replay.errors import ReplayError
from server.replay.options import merged
from server.replay.run import replay
from server.replay.source import load
from tests.replay.sensor_folders import HEADERS, read_csv, stamps_ns, static_board, write_csv

M_GYRO = np.diag([1.02, 0.97, 1.01])
B_GYRO = np.array([0.01, -0.02, 0.005])
M_ACCEL = np.array([[1.01, 0.002, -0.003], [0.001, 0.99, 0.004], [0.0, -0.002, 1.02]])
O_ACCEL = np.array([0.1, -0.2, 0.15])
M_MAG = np.array([[1.05, 0.02, 0.01], [0.02, 0.95, -0.03], [0.01, -0.03, 1.1]])
O_MAG = np.array([0.08, -0.05, 0.03])
BARO_M = 12.5


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return static_board(tmp_path_factory.mktemp("static"), duration_s=20.0, yaw_rad=0.6)


def summary(out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def numbers(path: Path, skip_last: bool = False) -> np.ndarray:
    _, rows = read_csv(path)
    cells = [row[:-1] if skip_last else row for row in rows]
    return np.array([[float(cell) if cell else np.nan for cell in row] for row in cells])


def kept(sensor: Sensor, **parameters: Any) -> CalibrationSet:
    return CalibrationSet(board_id="b", sensor=sensor, kind="import", id=f"id-{sensor}", parameters=parameters)


def exported(path: Path, *sets: CalibrationSet) -> Path:
    text = native_text(sets, board_id="b", software_version="0", exported_utc="2026-11-22T00:00:00Z")
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board's export with four sensors in it."""
    return exported(
        tmp_path_factory.mktemp("calibration") / "board.json",
        kept(Sensor.GYRO, scale=np.diag(M_GYRO), bias=B_GYRO),
        kept(Sensor.ACCEL, matrix=M_ACCEL, offset=O_ACCEL),
        kept(Sensor.MAG, matrix=M_MAG, offset=O_MAG),
        kept(Sensor.BARO, bias=BARO_M),
    )


def calibrated_by_hand(board: Path, folder: Path) -> Path:
    """Return the log as it would be, had the board calibrated its sensors itself."""
    folder.mkdir()
    for file in board.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    for stem, parts in (
        ("imu", ((slice(1, 4), M_GYRO, B_GYRO), (slice(4, 7), M_ACCEL, O_ACCEL))),
        ("mag", ((slice(1, 4), M_MAG, O_MAG),)),
    ):
        _, cells = read_csv(board / f"{stem}.csv")
        rows = np.array([[float(cell) for cell in row] for row in cells])
        for columns, matrix, offset in parts:
            rows[:, columns] = (rows[:, columns] - offset) @ matrix.T
        stamps = [row[0] for row in cells]
        write_csv(folder, stem, [(t, *row[1:]) for t, row in zip(stamps, rows.tolist(), strict=True)])
    _, cells = read_csv(board / "baro.csv")
    write_csv(folder, "baro", [(row[0], None, float(row[2]) - BARO_M) for row in cells])
    return folder


def test_a_calibrated_replay_equals_that_of_a_log_calibrated_beforehand(
    board: Path, whole: Path, tmp_path: Path
) -> None:
    lanes = ["ins_ekf", "complementary", "vqf", "altitude_kalman"]
    replay(board, tmp_path / "raw", lanes=lanes)
    replay(board, tmp_path / "ours", lanes=lanes, calibrations=[whole])
    replay(calibrated_by_hand(board, tmp_path / "folder"), tmp_path / "theirs", lanes=lanes)
    for lane in lanes:
        ours, theirs, raw = (numbers(tmp_path / name / f"{lane}.csv", True) for name in ("ours", "theirs", "raw"))
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9, err_msg=lane)
        assert np.nanmax(np.abs(ours[-1, 1:] - raw[-1, 1:])) > 1e-3, lane


def test_the_summary_names_each_file_with_its_sensors_and_numbers(board: Path, whole: Path, tmp_path: Path) -> None:
    replay(board, tmp_path / "out", lanes=["vqf"], calibrations=[whole])
    found = summary(tmp_path / "out")["settings"]["calibration"]
    assert [(one["file"], one["sensor"], one["kind"], one["set_id"]) for one in found] == [
        ("board.json", name, "import", f"id-{name}") for name in ("gyro", "accel", "mag", "baro")
    ]
    assert found[1]["parameters"] == {"matrix": M_ACCEL.tolist(), "offset": O_ACCEL.tolist()}
    assert found[3]["parameters"] == {"bias": BARO_M}


def test_stages_hold_the_calibrated_sample_and_what_every_lane_is_given(
    board: Path, whole: Path, tmp_path: Path
) -> None:
    replay(board, tmp_path / "out", lanes=["ins_ekf"], calibrations=[whole], nav_rate_hz=200.0)
    by_hand = calibrated_by_hand(board, tmp_path / "folder")
    _, imu = read_csv(board / "imu.csv")
    listed = summary(tmp_path / "out")["stages"]
    assert set(listed) == {f"{name}.stages" for name in ("gyro", "accel", "mag", "baro")}
    for name, stem, columns in (
        ("gyro", "imu", slice(1, 4)),
        ("accel", "imu", slice(4, 7)),
        ("mag", "mag", slice(1, 4)),
        ("baro", "baro", slice(2, 3)),
    ):
        file = tmp_path / "out" / f"{name}.stages.csv"
        rows, want = numbers(file), numbers(by_hand / f"{stem}.csv")[:, columns]
        assert read_csv(file)[0] == ["t_ns", *STAGE_COLUMNS[name]]
        assert listed[f"{name}.stages"] == {
            "file": file.name, "sensor": name, "boot_id": 0, "rows": len(want), "delay_s": 0.0
        }  # fmt: skip
        for stage in range(3):  # no filter is on
            width = want.shape[1]
            np.testing.assert_allclose(rows[:, 1 + stage * width :][:, :width], want, rtol=1e-12, atol=1e-12)
    assert [row[0] for row in read_csv(tmp_path / "out" / "gyro.stages.csv")[1]] == [row[0] for row in imu]


def test_the_last_stage_is_what_the_preprocessed_rows_average(board: Path, tmp_path: Path) -> None:
    chain = {"gyro": {"butterworth_hz": 30.0}, "mag": {"window_samples": 3.0}, "baro": {"lowpass_hz": 2.0}}
    replay(board, tmp_path / "out", lanes=["ins_ekf"], chain=chain, nav_rate_hz=200.0)
    source = load(board)
    engine = NavEngine(merged(source.overrides, {"chain": chain, "nav_rate_hz": 200.0}), wmm_field)
    found = [engine.step(block).filtered for block in source.blocks(500)]
    t_ns, data = (np.concatenate([getattr(rows, name) for rows in found]) for name in ("t_ns", "data"))
    at_imu = [numbers(tmp_path / "out" / f"{name}.stages.csv") for name in ("gyro", "accel")]
    one_sample = data[:, 13] == 1.0  # a step of one sample is that sample
    assert one_sample.sum() > 3900
    for rows, first in zip(at_imu, (0, 3), strict=True):
        place = np.searchsorted(rows[:, 0], t_ns[one_sample])
        np.testing.assert_allclose(rows[place, 7:10], data[one_sample, first : first + 3], rtol=1e-12, atol=1e-15)
    gyro = at_imu[0]
    assert np.abs(gyro[:, 1:4] - gyro[:, 7:10]).max() > 1e-3  # and the filter is not idle
    for name, columns in (("mag", slice(6, 9)), ("baro", slice(9, 10))):  # the newest sample is held
        rows = numbers(tmp_path / "out" / f"{name}.stages.csv")
        newest = np.searchsorted(rows[:, 0], t_ns, side="right") - 1
        known = newest >= 0
        np.testing.assert_allclose(rows[newest[known], -(rows.shape[1] - 1) // 3 :], data[known, columns], rtol=1e-12)


def test_a_filter_reports_its_delay_and_the_summary_has_what_was_set(board: Path, tmp_path: Path) -> None:
    told = {"mag": {"window_samples": 5.0, "limit_count": 5.0}, "gyro": {"butterworth_hz": 20.0}}
    replay(board, tmp_path / "out", lanes=["ins_ekf"], chain=told)
    found = summary(tmp_path / "out")
    assert found["settings"]["preprocess"] == {"mag": {"window_samples": 5.0}, "gyro": {"butterworth_hz": 20.0}}
    assert found["stages"]["mag.stages"]["delay_s"] == pytest.approx(2 / 20.0)  # half of five samples at 20 Hz
    second_order_s = np.sqrt(2.0) / (2.0 * np.pi * 20.0)  # of an analogue Butterworth at low frequency
    assert found["stages"]["gyro.stages"]["delay_s"] == pytest.approx(second_order_s, rel=0.25)
    assert found["stages"]["accel.stages"]["delay_s"] == found["stages"]["gyro.stages"]["delay_s"]


def test_without_the_options_nothing_else_is_written(board: Path, tmp_path: Path) -> None:
    replay(board, tmp_path / "plain", lanes=["ins_ekf"])
    replay(board, tmp_path / "defaults", lanes=["ins_ekf"], chain={"gyro": {"butterworth_hz": 0.0}})
    plain, same = summary(tmp_path / "plain"), summary(tmp_path / "defaults")
    for found in (plain, same):
        assert (found["stages"], found["mag_learning"]) == ({}, None)
        assert (found["settings"]["preprocess"], found["settings"]["calibration"]) == ({}, [])
    assert {path.name for path in (tmp_path / "plain").iterdir()} == {"ins_ekf.csv", "summary.json"}
    assert (tmp_path / "plain" / "ins_ekf.csv").read_bytes() == (tmp_path / "defaults" / "ins_ekf.csv").read_bytes()


def test_a_replay_without_filters_removes_the_stages_of_the_one_before(board: Path, tmp_path: Path) -> None:
    replay(board, tmp_path, lanes=["vqf"], chain={"mag": {"window_samples": 2.0}}, mag_learning="run")
    assert {"mag.stages.csv", "mag_learning.csv"} <= {path.name for path in tmp_path.iterdir()}
    replay(board, tmp_path, lanes=["vqf"])
    assert {path.name for path in tmp_path.iterdir()} == {"vqf.csv", "summary.json"}


def test_what_is_set_of_a_sensor_the_log_does_not_have_is_noted(board: Path, tmp_path: Path) -> None:
    replay(board, tmp_path, lanes=["vqf"], chain={"airspeed": {"convert": 1.0}})
    assert (
        "--preprocess airspeed.…: the log has no airspeed samples, so nothing comes of it."
        in summary(tmp_path)["notes"]
    )
    assert summary(tmp_path)["stages"] == {}


def test_stages_of_a_board_do_not_depend_on_where_the_stream_is_cut(board: Path, whole: Path, tmp_path: Path) -> None:
    for rows in (7, 100_000):
        replay(board, tmp_path / str(rows), lanes=["vqf"], calibrations=[whole], mag_learning="apply", block_rows=rows)
    for file in (tmp_path / "7").glob("*.csv"):
        assert file.read_bytes() == (tmp_path / "100000" / file.name).read_bytes(), file.name


def at_rest(folder: Path, seconds: float = 12.0) -> Path:
    rng = np.random.default_rng(3)
    rows = [(t, *(B_GYRO + rng.normal(0, 1e-3, 3)).tolist(), 0.0, 0.0, -9.8062) for t in stamps_ns(seconds, 100.0)]
    write_csv(folder, "imu", rows, HEADERS["imu"])
    return folder / "imu.csv"


def test_a_result_of_calibrate_is_taken_and_keeps_what_the_file_before_it_says(
    board: Path, whole: Path, tmp_path: Path
) -> None:
    told = Told(kind=CalKind.GYRO_BIAS, files=(at_rest(tmp_path / "rest"),))
    assert calibrate.run(told, out=tmp_path / "bias.json").status == 0
    bias = json.loads((tmp_path / "bias.json").read_text())["parameters"]["bias"]
    assert bias == pytest.approx(B_GYRO, abs=3e-4)
    replay(board, tmp_path / "out", lanes=["vqf"], calibrations=[whole, tmp_path / "bias.json"])
    *_, last = summary(tmp_path / "out")["settings"]["calibration"]
    assert (last["file"], last["sensor"], last["kind"]) == ("bias.json", "gyro", "gyro_bias")
    assert last["parameters"] == {"scale": np.diag(M_GYRO).tolist(), "bias": bias}
    raw = numbers(board / "imu.csv")[:, 1:4]
    rows = numbers(tmp_path / "out" / "gyro.stages.csv")
    np.testing.assert_allclose(rows[:, 1:4], np.diag(M_GYRO) * (raw - bias), rtol=1e-12, atol=1e-15)


def test_a_refused_calibration_is_not_applied(board: Path, tmp_path: Path) -> None:
    told = Told(kind=CalKind.GYRO_BIAS, files=(at_rest(tmp_path / "rest", seconds=0.05),))
    assert calibrate.run(told, out=tmp_path / "bias.json").status == 3
    with pytest.raises(ReplayError, match=r"bias\.json is a refused calibration. Give one that was fitted"):
        replay(board, tmp_path / "out", calibrations=[tmp_path / "bias.json"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("COMPASS_OFS_X,12", "is not JSON: .* Give what a board exports as JSON"),
        ("[]", "is not a calibration of navdeck"),
        ('{"format": "navdeck.calibration/9", "sets": []}', "A newer navdeck wrote it"),
        ('{"format": "navdeck.calibration/1", "sets": []}', "holds no set"),
        ('{"ok": true, "kind": "mag_spin", "parameters": {}, "sigma": {}}', "not a result of navdeck calibrate"),
        ('{"ok": true, "kind": "mag_ellipsoid"}', "not a result of navdeck calibrate"),
        ('{"ok": true, "kind": "accel_six_position", "parameters": 3, "sigma": {}}', "not a result"),
        (
            '{"ok": true, "kind": "mag_ellipsoid", "parameters": {"offset": [1, null, 1]}, "sigma": {}}',
            "mag: the calibration holds a number that is not finite.*Calibrate again",
        ),
        (
            '{"ok": true, "kind": "mag_ellipsoid", "sigma": {}, "parameters":'
            ' {"matrix": [[1e-5, 0, 0], [0, 1e-5, 0], [0, 0, 1e-5]], "offset": [0, 0, 0]}}',
            r"it must stay between 0\.001 and 1000",
        ),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_with_what_to_give(
    board: Path, tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "file.json").write_text(text)
    with pytest.raises(ReplayError, match=rf"--calibration .*file\.json.*{says}"):
        replay(board, tmp_path / "out", calibrations=[tmp_path / "file.json"])


def test_a_calibration_that_is_not_there_is_named(board: Path, tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match=r"--calibration .*none\.json cannot be read: No such file"):
        replay(board, tmp_path / "out", calibrations=[tmp_path / "none.json"])


def test_an_airspeed_sensor_shows_its_pressures_and_the_speed_made_of_them(board: Path, tmp_path: Path) -> None:
    folder = calibrated_by_hand(board, tmp_path / "folder")
    raw_pa = [150.0 + 40.0 * np.sin(0.1 * k) for k in range(200)]
    write_csv(folder, "airspeed", [(t, pa, None) for t, pa in zip(stamps_ns(20, 10), raw_pa, strict=True)])
    (folder / "baro.csv").unlink()
    bias = exported(tmp_path / "bias.json", kept(Sensor.AIRSPEED, bias=10.0))
    replay(folder, tmp_path / "out", lanes=["vqf"], calibrations=[bias], chain={"airspeed": {"convert": 1.0}})
    header, _ = read_csv(tmp_path / "out" / "airspeed.stages.csv")
    assert header == ["t_ns", "calibrated_pa", "limited_pa", "filtered_pa", "airspeed_m_s"]
    rows = numbers(tmp_path / "out" / "airspeed.stages.csv")
    for stage in (1, 2, 3):
        np.testing.assert_allclose(rows[:, stage], np.array(raw_pa) - 10.0, rtol=1e-12)
    np.testing.assert_allclose(rows[:, 4] ** 2, 2.0 * rows[:, 3] / 1.225, rtol=1e-3)  # no pressure known: sea level


def test_the_stages_of_each_power_up_have_their_own_file(shared_data: Path, tmp_path: Path) -> None:
    log = (shared_data / "ardupilot_sitl" / "mission.tlog").read_bytes()
    twice = tmp_path / "twice.tlog"
    twice.write_bytes(log[:6_000_000] + log[:900_000])
    replay(twice, tmp_path / "out", lanes=["vqf"], chain={"gyro": {"lowpass_hz": 30.0}}, mag_learning="run")
    found = summary(tmp_path / "out")
    assert found["log"]["boots"] == 2
    assert set(found["stages"]) == {f"{name}.stages{boot}" for name in ("gyro", "accel") for boot in ("", ".boot1")}
    for listed in found["stages"].values():
        rows = numbers(tmp_path / "out" / listed["file"])
        assert len(rows) == listed["rows"] > 1000
        assert listed["delay_s"] > 0.0
        assert (np.diff(rows[:, 0]) > 0).all()
    files = [(each["file"], each["boot_id"]) for each in found["mag_learning"]["power_ups"]]
    assert files == [("mag_learning.csv", 0), ("mag_learning.boot1.csv", 1)]
    first, second = (numbers(tmp_path / "out" / file) for file, _ in files)
    assert first[-1, 4:7].max() < 0.1  # it had learned something, of which the second power-up has nothing
    np.testing.assert_array_equal(second[0, 1:], first[0, 1:])
    assert second[0, 0] < first[-1, 0]
    assert found["mag_learning"]["state"]["t_ns"] == second[-1, 0]
