"""The bytes of a recorded board through a real pseudo-terminal: nothing is lost, and live is what replay says.

The pace does not matter to a byte, so these run as fast as they are read; `tests/bench/bench_live.py --only equal`
does the same with the whole program at the pace of the recording, up to the rows that a WebSocket client gets.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from server.link.find import Finder
from server.link.tlog import read_tlog
from server.nav.types import CSV_LANE_COLUMNS, LANE_COLUMNS, LaneStatus
from tests.live.boards import live_board, plugged, replayed

BOARD, STATION = 1, 255  # the station's own frames were recorded only in part: some of its numbers are missing
STATUS = LANE_COLUMNS.index("status")


@pytest.mark.parametrize("name", ["mission.tlog", "static.tlog"])
async def test_live_state_equals_replay_bit_for_bit_and_no_byte_is_lost(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    log = shared_data / "ardupilot_sitl" / name
    stream = read_tlog(log)
    t_ns, rows, summary = replayed(log, tmp_path / "replay")
    link = tmp_path / "board"
    with plugged(log, link, speed=0.0) as board:
        async with live_board(link, Finder(by_id=tmp_path)) as live:
            await live.until_bytes(len(stream.data))
            stats = live.board.view().stats
    assert board.emulator.stats.bytes_sent == stats.bytes_in == stats.bytes_frames == len(stream.data)
    assert (stats.frames, stats.bytes_junk, stats.bytes_pending, stats.crc_errors) == (len(stream), 0, 0, 0)
    lost = {sender.system: sender.lost for sender in stats.senders}
    assert lost == {BOARD: 0, STATION: summary.losses["frames_lost_of_others"]}
    assert summary.losses["frames_lost"] == 0
    live_t_ns, live_rows = live.rows("ins_ekf")
    np.testing.assert_array_equal(live_t_ns, t_ns)
    np.testing.assert_array_equal(live_rows[:, :CSV_LANE_COLUMNS], rows)
    assert live_rows[-1, STATUS] == LaneStatus.NAVIGATING
    assert len(live.results) > 100  # the stream came in many pieces, as it does live
