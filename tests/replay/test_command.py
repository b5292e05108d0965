"""`navdeck replay` as a function: text in, text out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from server.cli import app
from server.replay.command import replay_command
from server.replay.errors import ReplayError
from tests.replay.sensor_folders import static_board


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return static_board(tmp_path_factory.mktemp("board"), duration_s=36.0, imu_hz=100.0)


def test_the_report_says_how_fast_how_many_and_how_good(board: Path, tmp_path: Path) -> None:
    text = replay_command(board, tmp_path / "out", lanes="ins_ekf", gnss_outage=["20:22"])
    assert "× real time" in text
    assert "ins_ekf: 1," in text
    assert "RMS from 30 s after the first fix: attitude" in text
    assert "GNSS withheld 20:22 s: horizontal error at most" in text
    assert text.endswith(f"written to {tmp_path / 'out'}")
    found = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert found["settings"]["gnss_outages_s"] == [[20.0, 22.0]]


def test_without_a_terminal_nothing_is_drawn(board: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert replay_command(board, tmp_path / "out", nav_rate_hz=25.0, quiet=True) == ""
    replay_command(board, tmp_path / "out")
    assert capfd.readouterr() == ("", "")


def test_the_report_says_what_filters_delay_and_what_was_learned(board: Path, tmp_path: Path) -> None:
    text = replay_command(board, tmp_path / "out", lanes="vqf", preprocess=["mag.window_samples=5"], mag_learning="run")
    assert "stages of mag: 720 rows, its filters delay 100.0 ms" in text  # half of five samples at 20 Hz
    assert "magnetic offset learned: 0.0 ± 500.0, 0.0 ± 500.0, 0.0 ± 500.0 mG (not converged)" in text


def test_the_command_line_takes_preprocessing_calibration_and_learning(board: Path, tmp_path: Path) -> None:
    result = {"ok": True, "kind": "baro_reference", "parameters": {"bias": 2.5}, "sigma": {"bias": 0.1}}
    (tmp_path / "baro.json").write_text(json.dumps(result))
    options = ["--preprocess", "imu.lowpass_hz=30", "--preprocess", "mag.window_samples=3"]
    options += ["--calibration", str(tmp_path / "baro.json"), "--mag-learning", "apply", "--lanes", "vqf"]
    done = CliRunner().invoke(app, ["replay", str(board), "--out", str(tmp_path / "out"), *options])
    assert (done.exit_code, done.stderr) == (0, "")
    found = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert found["settings"]["preprocess"] == {
        "gyro": {"lowpass_hz": 30.0}, "accel": {"lowpass_hz": 30.0}, "mag": {"window_samples": 3.0}
    }  # fmt: skip
    assert [part["parameters"] for part in found["settings"]["calibration"]] == [{"bias": 2.5}]
    assert found["mag_learning"]["apply"]
    wrong = CliRunner().invoke(app, ["replay", str(board), "--out", str(tmp_path / "no"), "--mag-learning", "maybe"])
    assert (wrong.exit_code, wrong.stderr.startswith("navdeck: --mag-learning 'maybe' is not known")) == (2, True)


def test_a_mistake_in_the_options_is_found_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="--gnss-outage"):
        replay_command(tmp_path / "nothing", tmp_path / "out", gnss_outage=["soon"])
    with pytest.raises(ReplayError, match="no lane called x"):
        replay_command(tmp_path / "nothing", tmp_path / "out", lane_values=["x.y=1"])
    with pytest.raises(ReplayError, match="no chain of x"):
        replay_command(tmp_path / "nothing", tmp_path / "out", preprocess=["x.y=1"])
    with pytest.raises(ReplayError, match="--mag-learning"):
        replay_command(tmp_path / "nothing", tmp_path / "out", mag_learning="x")
    with pytest.raises(ReplayError, match="Known: ins_ekf"):
        replay_command(tmp_path / "nothing", tmp_path / "out", lanes="x")
