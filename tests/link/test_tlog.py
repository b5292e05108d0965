from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from server.link.tlog import TlogBytes, read_tlog, schedule_s, split_tlog
from tests.link.tlogs import START_US, frame, frames, tlog


def split(raw: bytes) -> TlogBytes:
    return split_tlog(np.frombuffer(raw, np.uint8))


def records(log: TlogBytes) -> list[bytes]:
    return [log.data[a:b] for a, b in zip(log.offsets[:-1], log.offsets[1:], strict=True)]


MIXED = [
    frame(0, version=1),
    frame(1, signed=True),
    frame(2, payload=0),
    frame(3, payload=255, signed=True),
    frame(4, payload=255, version=1),
    frame(5, payload=1),
]


def test_both_versions_and_signed_frames_are_cut_at_their_ends() -> None:
    log = split(tlog(MIXED, step_us=2500))
    assert records(log) == MIXED
    np.testing.assert_array_equal(log.stamps_us, START_US + 2500 * np.arange(6))
    assert log.damaged == 0


def test_stamps_that_look_like_frames_do_not_mislead() -> None:
    parts = [b"\xfd\x05\x00\x00" + b"\xfe\xfd" * 6 + b"\x00", frame(1), frame(2)]
    assert records(split(tlog(parts, step_us=1))) == parts


@pytest.mark.parametrize("cut", range(1, 41))
def test_a_tail_cut_anywhere_keeps_what_was_written(cut: int) -> None:
    parts = frames(4)
    raw = tlog(parts, step_us=1000)
    log = split(raw[:-cut])
    assert records(log)[:3] == parts[:3]
    assert log.data == b"".join(parts)[: 3 * 32 + max(0, 32 - cut)]


def test_damage_costs_the_frame_it_hits_and_no_other() -> None:
    rng = random.Random(4)
    parts = [frame(k, payload=rng.randrange(256), version=rng.choice([1, 2])) for k in range(60)]
    raw = tlog(parts, step_us=3000)
    for _ in range(400):
        place, value = rng.randrange(len(raw)), rng.randrange(256)
        damaged = raw[:place] + bytes([value]) + raw[place + 1 :]
        log = split(damaged)
        kept = sum(part in log.data for part in parts)
        assert kept >= 59
        if log.damaged == 0:
            assert len(log) == 60


def test_lost_and_added_bytes_are_passed_over() -> None:
    parts = frames(30)
    raw = tlog(parts, step_us=1000)
    for begin, end in ((100, 103), (410, 499), (0, 5)):
        log = split(raw[:begin] + raw[end:])
        assert sum(part in log.data for part in parts) >= 30 - 4
    log = split(raw[:400] + bytes(777) + raw[400:])
    assert sum(part in records(log) for part in parts) >= 28


def test_logs_of_different_days_joined_are_one_stream() -> None:
    parts = frames(5)
    later = bytearray(tlog(parts, step_us=1000))
    for k in range(5):
        at = k * 40
        stamp = int.from_bytes(later[at : at + 8], "big") + 40 * 86_400_000_000
        later[at : at + 8] = stamp.to_bytes(8, "big")
    log = split(tlog(parts, step_us=1000) + bytes(later))
    assert records(log) == parts * 2
    assert log.damaged == 0


@pytest.mark.parametrize("raw", [b"", b"\xfd", b"a text that is not a log, however long it may be" * 9, bytes(4000)])
def test_what_is_no_tlog_is_refused_with_a_remedy(raw: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.tlog").write_bytes(raw)
    with pytest.raises(ValueError, match=r"x\.tlog is not a \.tlog .* Use the telemetry log"):
        read_tlog(tmp_path / "x.tlog")


def test_noise_never_raises_anything_else() -> None:
    rng = random.Random(9)
    for size in range(0, 400, 3):
        raw = bytes(rng.choice([0xFD, 0xFE, 0, 255, rng.randrange(256)]) for _ in range(size))
        try:
            log = split(raw)
        except ValueError:
            continue
        assert log.offsets[-1] == len(log.data) <= size


def test_the_schedule_never_runs_backwards_and_ignores_one_wild_stamp() -> None:
    stamps = START_US + np.array([0, 1000, 2000, 3_600_000_000, 4000, 5000, 0, 7000], np.int64)
    due_s = schedule_s(stamps)
    np.testing.assert_allclose(due_s, [0, 1e-3, 2e-3, 2e-3, 4e-3, 5e-3, 5e-3, 7e-3], atol=1e-12)


def test_a_clock_set_back_takes_no_time() -> None:
    stamps = START_US + np.array([0, 1000, 2000, -500_000, -499_000], np.int64)
    due_s = schedule_s(stamps)
    assert np.all(np.diff(due_s) >= 0)
    assert due_s[-1] == pytest.approx(3e-3)


@pytest.mark.parametrize(("name", "duration_s"), [("mission", 182.155), ("static", 76.344)])
def test_a_recorded_flight_is_cut_as_a_plain_reader_does(shared_data: Path, name: str, duration_s: float) -> None:
    path = shared_data / "ardupilot_sitl" / f"{name}.tlog"
    raw, at, parts = path.read_bytes(), 0, []
    while at < len(raw):
        size = 12 + raw[at + 9] + 13 * (raw[at + 10] & 1)
        assert raw[at + 8] == 0xFD
        parts.append(raw[at + 8 : at + 8 + size])
        at += 8 + size
    log = read_tlog(path)
    assert log.data == b"".join(parts)
    np.testing.assert_array_equal(np.diff(log.offsets), [len(part) for part in parts])
    assert log.damaged == 0
    assert schedule_s(log.stamps_us)[-1] == pytest.approx(duration_s, abs=1e-3)
