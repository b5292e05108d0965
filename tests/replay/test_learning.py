"""The magnetic offset learned in flight, as a replay writes it down."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.replay.run import replay
from tests.replay.sensor_folders import read_csv, static_board
from tests.sets import broad
from tests.sets.folder import HALF_TURN_ABOUT_X

HEADER = (
    "t_ns,offset_x_gauss,offset_y_gauss,offset_z_gauss,sigma_x_gauss,sigma_y_gauss,sigma_z_gauss,"
    "excitation_x,excitation_y,excitation_z,converged,frozen"
)
TOLERANCE_GAUSS = 0.02  # 2 µT
MAGNET_ON_S, MAGNET_OFF_S, END_S = 46.1, 104.0, 136.0


def summary(out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def table(path: Path) -> np.ndarray:
    header, rows = read_csv(path)
    assert ",".join(header) == HEADER
    return np.array(rows, dtype=np.float64)


@pytest.fixture(scope="module")
def trial(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return broad.write(shared_data, tmp_path_factory.mktemp("broad33"), 33)


@pytest.fixture(scope="module")
def watched(trial: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("watched")
    replay(trial, out, lanes=["ins_ekf"], mag_learning="run")
    return out


def offset_by_the_cameras(shared_data: Path, begin_s: float, end_s: float) -> np.ndarray:
    """Return b of m = Rᵀ f + b by least squares with the optical attitude."""
    recorded = broad.load(shared_data, 33)
    t_s = broad.stamps_ns(recorded) * 1e-9
    used = np.isfinite(recorded["opt_quat"]).all(axis=1) & (t_s > begin_s) & (t_s < end_s)
    field = recorded["imu_mag"][used] * HALF_TURN_ABOUT_X * broad.GAUSS_PER_MICROTESLA
    R_bn = Rotation.from_quat(broad.quat_nb(recorded["opt_quat"][used]), scalar_first=True).inv().as_matrix()
    A = np.concatenate([R_bn, np.broadcast_to(np.eye(3), R_bn.shape)], axis=2).reshape(-1, 6)
    return np.linalg.lstsq(A, field.ravel(), rcond=None)[0][3:]


def test_a_magnet_is_followed_on_and_off_within_30_s(shared_data: Path, watched: Path) -> None:
    rows = table(watched / "mag_learning.csv")
    t_s = rows[:, 0] * 1e-9
    for begin_s, end_s, since_s in ((MAGNET_ON_S, 92.0, 30.0), (MAGNET_OFF_S, END_S, 26.0)):
        truth = offset_by_the_cameras(shared_data, begin_s + 1.0, end_s)
        late = rows[(t_s >= begin_s + since_s) & (t_s <= end_s)]
        assert len(late) > 50
        assert np.abs(late[:, 1:4] - truth).max() < TOLERANCE_GAUSS
        assert late[:, 10].all()  # and it is sure of it
    on, off = (offset_by_the_cameras(shared_data, *span) for span in ((47.1, 92.0), (105.0, END_S)))
    assert np.abs(on - off).max() > 5 * TOLERANCE_GAUSS


def test_nothing_is_learned_at_rest_and_the_rows_say_so(watched: Path) -> None:
    rows = table(watched / "mag_learning.csv")
    resting = rows[(rows[:, 0] > 2e9) & (rows[:, 0] < 20e9)]
    assert (resting[:, 1:4] == 0.0).all()
    assert (resting[:, 10] == 0.0).all()
    assert (resting[:, 11] == 1.0).all()


def test_there_are_ten_rows_a_second_of_board_time_and_one_at_the_end(watched: Path) -> None:
    rows = table(watched / "mag_learning.csv")
    duration_s = summary(watched)["log"]["duration_s"]
    assert len(rows) == pytest.approx(10 * duration_s, abs=2)
    assert all(0.0 < b - a < 0.13e9 for a, b in pairwise(rows[:, 0]))
    newest = read_csv(watched / "ins_ekf.csv")[1][-1][0]
    assert read_csv(watched / "mag_learning.csv")[1][-1][0] == newest


def test_the_summary_has_the_last_row_as_its_state(watched: Path) -> None:
    found = summary(watched)["mag_learning"]
    last = table(watched / "mag_learning.csv")[-1]
    state = found["state"]
    assert (found["run"], found["apply"]) == (True, False)
    assert [state["t_ns"], *state["offset_gauss"], *state["sigma_gauss"], *state["excitation"]] == last[:10].tolist()
    assert (state["converged"], state["frozen"]) == (bool(last[10]), bool(last[11]))
    assert (state["reason"], state["changes"], state["applied_gauss"]) == ("rest", 1, [0.0, 0.0, 0.0])
    assert state["t_changed_ns"] * 1e-9 == pytest.approx(MAGNET_OFF_S - 4.0, abs=4.0)
    assert found["power_ups"] == [
        {"file": "mag_learning.csv", "boot_id": 0, "rows": len(table(watched / "mag_learning.csv")), "state": state}
    ]


def test_watching_changes_no_lane_and_applying_takes_the_offset_off(trial: Path, watched: Path, tmp_path: Path) -> None:
    lanes = ["ins_ekf", "vqf"]
    replay(trial, tmp_path / "plain", lanes=lanes)
    replay(trial, tmp_path / "applied", lanes=lanes, mag_learning="apply")
    assert (watched / "ins_ekf.csv").read_bytes() == (tmp_path / "plain" / "ins_ekf.csv").read_bytes()
    before, after = (summary(tmp_path / name)["lanes"]["vqf"]["whole"] for name in ("plain", "applied"))
    assert after["heading_rad"]["rms"] < 0.7 * before["heading_rad"]["rms"]
    found = summary(tmp_path / "applied")
    assert found["mag_learning"]["apply"]
    applied, learned = (np.array(found["mag_learning"]["state"][name]) for name in ("applied_gauss", "offset_gauss"))
    assert np.linalg.norm(applied - learned) < 0.002  # smaller moves are not made
    assert applied.any()
    assert 0 < found["stages"]["mag.stages"]["rows"] < found["samples"]["mag"]  # from the first offset taken off


def test_rows_do_not_depend_on_where_the_stream_is_cut(trial: Path, watched: Path, tmp_path: Path) -> None:
    replay(trial, tmp_path, lanes=["ins_ekf"], mag_learning="run", block_rows=997)
    assert (tmp_path / "mag_learning.csv").read_bytes() == (watched / "mag_learning.csv").read_bytes()


def test_a_log_without_a_magnetometer_learns_nothing(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=5.0)
    (folder / "mag.csv").unlink()
    replay(folder, tmp_path / "out", lanes=["ins_ekf"], mag_learning="run")
    found = summary(tmp_path / "out")["mag_learning"]
    assert found["state"]["offset_gauss"] == [0.0, 0.0, 0.0]
    assert not found["state"]["converged"]
    assert (table(tmp_path / "out" / "mag_learning.csv")[:, 1:4] == 0.0).all()


def test_a_log_without_an_imu_has_no_state(tmp_path: Path) -> None:
    folder = static_board(tmp_path / "folder", duration_s=5.0)
    (folder / "imu.csv").unlink()
    replay(folder, tmp_path / "out", lanes=["ins_ekf"], mag_learning="apply")
    assert summary(tmp_path / "out")["mag_learning"]["state"] is None
    assert (tmp_path / "out" / "mag_learning.csv").read_text() == HEADER + "\n"
