from __future__ import annotations

import asyncio
import itertools
import os
import time
from pathlib import Path

import pytest

from server.link import LinkState, open_link
from tests.link.support import listening
from tests.link.tlogs import frames, tlog


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight log.tlog"
    path.write_bytes(tlog(frames(300), step_us=1000))
    return path


@pytest.mark.parametrize("speed", ["0", "1", "30"])
async def test_a_tlog_arrives_without_its_stamps_and_ends(log: Path, speed: str) -> None:
    url = "file://" + str(log).replace(" ", "%20") + f"?speed={speed}"
    async with listening(open_link(url)) as heard:
        await heard.until(lambda: heard.ended)
        assert heard.link.status.code == "file-ended"
        assert heard.link.status.state is LinkState.ENDED
    assert heard.data == b"".join(frames(300))
    assert heard.chunks[0].new_session


async def test_a_frame_never_comes_before_its_time(log: Path) -> None:
    begin_ns = time.monotonic_ns()
    async with listening(open_link(f"file://{log}?speed=3")) as heard:
        await heard.until(lambda: heard.ended)
    ends = itertools.accumulate(len(chunk.data) for chunk in heard.chunks)
    size = len(frames(1)[0])
    for chunk, end in zip(heard.chunks, ends, strict=True):
        due_ns = (end // size - 1) * 1_000_000 / 3
        assert chunk.t_rx_ns - begin_ns >= due_ns


async def test_a_loop_begins_a_new_session_at_each_pass(log: Path) -> None:
    whole = b"".join(frames(300))
    async with listening(open_link(f"file://{log}?speed=0&loop=1")) as heard:
        await heard.until(lambda: len(heard.data) >= 3 * len(whole))
    assert heard.data.startswith(whole * 3)
    starts = [
        end - len(chunk.data)
        for chunk, end in zip(heard.chunks, itertools.accumulate(len(c.data) for c in heard.chunks), strict=True)
        if chunk.new_session
    ]
    assert starts == [k * len(whole) for k in range(len(starts))]


async def test_other_files_are_played_as_raw_bytes(tmp_path: Path) -> None:
    dump = bytes(range(256)) * 20
    (tmp_path / "dump.bin").write_bytes(dump)
    async with listening(open_link(f"file://{tmp_path}/dump.bin?bytes_per_s=50000")) as heard:
        await heard.until(lambda: heard.ended)
    assert heard.data == dump
    assert heard.chunks[-1].t_rx_ns - heard.chunks[0].t_rx_ns >= 0.8 * 5120 / 50_000 * 1e9


async def test_a_missing_file_is_waited_for(tmp_path: Path, log: Path) -> None:
    async with listening(open_link(f"file://{tmp_path}/later.tlog?speed=0")) as heard:
        await heard.until_code("file-missing")
        assert "later.tlog" in heard.link.status.cause
        os.link(log, tmp_path / "later.tlog")
        await heard.until(lambda: heard.ended)


@pytest.mark.parametrize(("name", "content"), [("text.tlog", b"no log at all, only words"), ("empty.bin", b"")])
async def test_what_cannot_be_played_says_why(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    async with listening(open_link(f"file://{tmp_path}/{name}")) as heard:
        await heard.until_code("file-unreadable")
        assert heard.link.status.state is LinkState.FAILED
        assert name in heard.link.status.cause


async def test_closing_in_a_long_pause_of_the_log_ends_at_once(tmp_path: Path) -> None:
    (tmp_path / "pause.tlog").write_bytes(tlog(frames(2), step_us=3_600_000_000))
    async with listening(open_link(f"file://{tmp_path}/pause.tlog")) as heard:
        await heard.until_data(frames(1)[0])
        await asyncio.sleep(0.02)
    assert heard.ended
