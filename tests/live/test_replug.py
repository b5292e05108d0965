"""The board is pulled out in flight and plugged in again: the state goes on where the board is now."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from server.link import LinkState
from server.link.find import Finder
from server.link.tlog import read_tlog
from server.nav.types import LANE_COLUMNS, LaneStatus
from tests.live.boards import live_board, plugged

STATUS, LAT, LON = (LANE_COLUMNS.index(name) for name in ("status", "lat_deg", "lon_deg"))
M_PER_DEG = 111_320.0
PULLED_AFTER_BYTES = 6_000_000  # about 95 s into the recording, in flight
AWAY_S, AFTER_S = 3.0, 20.0


def cut(log: Path, out: Path, begin_bytes: int, away_s: float, length_s: float) -> int:
    """Write what the board says for a while, beginning some time after a place of the stream; return its bytes."""
    stream = read_tlog(log)
    times_s = (stream.stamps_us - stream.stamps_us[0]) * 1e-6
    begin_s = times_s[np.searchsorted(stream.offsets, begin_bytes)] + away_s
    first, last = np.searchsorted(times_s, [begin_s, begin_s + length_s]).tolist()
    frames = [stream.data[stream.offsets[k] : stream.offsets[k + 1]] for k in range(first, last)]
    stamps = stream.stamps_us[first:last].tolist()
    out.write_bytes(b"".join(us.to_bytes(8, "big") + frame for us, frame in zip(stamps, frames, strict=True)))
    return sum(map(len, frames))


async def test_navigation_resumes_after_the_board_was_pulled_in_flight(shared_data: Path, tmp_path: Path) -> None:
    mission, after = shared_data / "ardupilot_sitl" / "mission.tlog", tmp_path / "after.tlog"
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    link = by_id / "usb-ArduPilot_Board_1-if00"
    async with live_board(link, Finder(by_id=by_id)) as live:
        with plugged(mission, link, speed=0.0):
            await live.until_bytes(PULLED_AFTER_BYTES)
        await live.until("lost", lambda: live.board.view().link.state is LinkState.LOST)
        pulled, known = live.board.view(), len(live.results)
        size = cut(mission, after, pulled.stats.bytes_in, AWAY_S, AFTER_S)
        with plugged(after, link, speed=0.0):
            plugged_s = time.monotonic()
            await live.until_open()
            opened_s = time.monotonic() - plugged_s
            await live.until_bytes(pulled.stats.bytes_in + size)
        resumed = live.board.view()
    assert opened_s < 2.0
    assert (resumed.link.reconnects, resumed.state) == (1, "running")
    stats = resumed.stats
    assert stats.bytes_in == pulled.stats.bytes_in + size == stats.bytes_frames + stats.bytes_junk + stats.bytes_pending
    assert stats.bytes_junk == pulled.stats.bytes_pending  # the frame that was torn, nothing else
    assert stats.boot_id == 0
    t_ns, rows = live.rows("ins_ekf", known)
    assert pulled.t_ns < t_ns[0]
    assert (np.diff(t_ns) > 0).all()
    assert rows[-1, STATUS] == LaneStatus.NAVIGATING
    t_truth_ns, truth = live.rows("reference", known)
    last = t_ns < t_truth_ns[-1]
    nearest = truth[np.searchsorted(t_truth_ns, t_ns[last][-100:])]
    north_m = (rows[last][-100:, LAT] - nearest[:, LAT]) * M_PER_DEG
    east_m = (rows[last][-100:, LON] - nearest[:, LON]) * M_PER_DEG * np.cos(np.radians(nearest[:, LAT]))
    assert np.hypot(north_m, east_m).max() < 0.5
