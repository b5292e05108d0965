"""`navdeck replay` as a function: text in, text out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

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


def test_a_mistake_in_the_options_is_found_before_anything_is_read(tmp_path: Path) -> None:
    with pytest.raises(ReplayError, match="--gnss-outage"):
        replay_command(tmp_path / "nothing", tmp_path / "out", gnss_outage=["soon"])
    with pytest.raises(ReplayError, match="no lane called x"):
        replay_command(tmp_path / "nothing", tmp_path / "out", lane_values=["x.y=1"])
    with pytest.raises(ReplayError, match="Known: ins_ekf"):
        replay_command(tmp_path / "nothing", tmp_path / "out", lanes="x")
