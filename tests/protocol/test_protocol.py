"""The protocol as a whole: accounts to the byte, names, rates, texts, and no dependence on cuts or on the host."""

import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.nav.types import SampleBlock
from server.protocol.base import BoardProtocol, ProtocolStats
from server.protocol.mavlink import MavlinkProtocol, warm
from tests.protocol.peer import Writer, feed_all, frame_list, pymavlink_messages, random_cuts
from tests.protocol.test_scanner import damaged_stream
from tests.protocol.test_sources import Board


def adds_up(stats: ProtocolStats) -> bool:
    return stats.bytes_in == stats.bytes_frames + stats.bytes_junk + stats.bytes_pending


def same(a: list[SampleBlock], b: list[SampleBlock]) -> bool:
    def joined(blocks: list[SampleBlock]) -> tuple[bytes, ...]:
        boots = [np.full(len(x.t_ns), x.boot_id) for x in blocks]
        parts = [x.kind for x in blocks], [x.t_ns for x in blocks], [x.data for x in blocks], boots
        return tuple(np.concatenate(part).tobytes() if part else b"" for part in parts)

    return joined(a) == joined(b)


@pytest.fixture(scope="module")
def mission(shared_data: Path) -> list[bytes]:
    return frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")


def test_it_is_a_board_protocol() -> None:
    protocol: BoardProtocol = MavlinkProtocol()
    assert protocol.stats.protocol == "mavlink"
    warm()


def test_counts_and_rates_of_the_mission_are_the_recorded_ones(mission: list[bytes]) -> None:
    protocol = MavlinkProtocol(talk=False)
    feed_all(protocol, random_cuts(b"".join(mission), 1, 60_000))
    stats = protocol.stats
    assert adds_up(stats)
    assert (stats.bytes_junk, stats.bytes_pending, stats.crc_errors) == (0, 0, 0)
    assert stats.frames == len(mission)
    assert stats.board == "ArduPilot quadrotor, system 1"
    ids = Counter(int.from_bytes(frame[7:10], "little") for frame in mission if frame[5] == 1)
    rates = {name: rate for name, _, rate in stats.messages}
    assert sorted(count for _, count, _ in stats.messages) == sorted(ids.values())
    assert rates["HIGHRES_IMU"] == pytest.approx(333.3, abs=2.0)
    assert rates["GPS_RAW_INT"] == pytest.approx(10.0, abs=0.3)
    board, station = stats.senders
    assert (board.system, board.component, board.lost) == (1, 1, 0)
    assert (station.system, station.component) == (255, 190)
    assert stats.filtered_frames == station.frames == 182


def test_samples_of_a_damaged_mission_do_not_depend_on_the_cuts(mission: list[bytes]) -> None:
    stream, damaged = damaged_stream(mission[:20_000], 8, seed=11)
    assert damaged > 2_000
    whole = MavlinkProtocol(talk=False)
    expected = feed_all(whole, [stream])
    for longest in (64, 700, 5_000):
        pieces = MavlinkProtocol(talk=False)
        assert same(feed_all(pieces, random_cuts(stream, longest, longest)), expected)
        ours, theirs = pieces.stats, whole.stats
        assert adds_up(ours)
        assert (ours.frames, ours.bytes_junk, ours.senders) == (theirs.frames, theirs.bytes_junk, theirs.senders)


def test_host_time_and_talking_change_no_sample(mission: list[bytes]) -> None:
    chunks = random_cuts(b"".join(mission[:5_000]), 2, 600)
    quiet = feed_all(MavlinkProtocol(talk=False), chunks)
    talking, blocks = MavlinkProtocol(), []
    talking.connected(0)
    for k, chunk in enumerate(chunks):
        blocks += talking.feed(chunk, 10**15 + 7_000_000 * k).blocks
        talking.outgoing(10**15 + 7_000_000 * k)
    assert same(blocks, quiet)
    assert {int(t) for b in blocks for t in b.t_rx_ns} <= {10**15 + 7_000_000 * k for k in range(len(chunks))}


@settings(max_examples=150, deadline=None)
@given(st.lists(st.binary(max_size=600), max_size=8), st.integers(0, 2**62))
def test_no_bytes_make_it_raise(chunks: list[bytes], now_ns: int) -> None:
    protocol = MavlinkProtocol()
    for k, chunk in enumerate(chunks):
        protocol.feed(chunk, now_ns + k)
        assert pymavlink_messages(protocol.outgoing(now_ns + k))[1] == []
        assert adds_up(protocol.stats)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_no_fields_make_it_raise_or_write_an_infinite_stamp(data: st.DataObject) -> None:
    """Every decoded message with any payload at all, check sum right."""
    writer = Board()
    protocol = MavlinkProtocol(talk=False)
    protocol.feed(writer.stream, 0)
    generator = random.Random(data.draw(st.integers(0, 2**32)))
    names = ["HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ATTITUDE"]
    names += ["ATTITUDE_QUATERNION", "SCALED_PRESSURE", "SIM_STATE", "SYSTEM_TIME", "HEARTBEAT", "SYS_STATUS"]
    names += ["STATUSTEXT", "TIMESYNC", "COMMAND_ACK"]
    for _ in range(20):
        name = generator.choice(names)
        clean = writer(name)
        size = generator.randint(1, 60)
        message_id = int.from_bytes(clean[7:10], "little")
        encoder = protocol._encoder.__class__(1, 1)
        protocol.feed(encoder.frame(message_id, generator.randbytes(size)), 0)
    assert adds_up(protocol.stats)


def test_status_texts_are_handed_out_with_their_severity(mission: list[bytes]) -> None:
    protocol = MavlinkProtocol(talk=False)
    texts = [text for chunk in random_cuts(b"".join(mission), 3, 3_000) for text in protocol.feed(chunk, 0).texts]
    expected = [(m.severity, m.text) for m in pymavlink_messages(b"".join(f for f in mission if f[7] == 253))[0]]
    assert len(texts) == 43
    assert texts == expected


def test_a_text_in_chunks_is_one_text() -> None:
    board = Board()
    long = "EKF3 lane switch 1: " + "a long reason " * 6
    for chunk in range(3):
        board.say("STATUSTEXT", severity=4, text=long[50 * chunk : 50 * chunk + 50].encode(), id=7, chunk_seq=chunk)
    board.say("STATUSTEXT", severity=6, text=b"x" * 50)
    board.say("STATUSTEXT", severity=2, text=b"lost its end " * 4, id=8, chunk_seq=0)
    board.say("STATUSTEXT", severity=3, text=b"short")
    texts = MavlinkProtocol(talk=False).feed(board.stream, 0).texts
    assert texts == ((4, long.strip()), (6, "x" * 50), (2, ("lost its end " * 4)[:50].strip()), (3, "short"))


def test_texts_of_others_are_not_the_boards() -> None:
    board, other = Board(), Writer(system=9)
    stream = board.stream + other("STATUSTEXT", severity=1, text=b"mine")
    assert MavlinkProtocol(talk=False).feed(stream, 0).texts == ()


def test_unknown_messages_are_counted_apart_and_are_no_errors() -> None:
    board = Board()
    frame = board("ATTITUDE", roll=1.0)
    protocol = MavlinkProtocol(talk=False)
    protocol.feed(board.stream + frame[:7] + (60_999).to_bytes(3, "little") + frame[10:], 0)
    stats = protocol.stats
    assert (stats.unknown_messages, stats.crc_errors, stats.frames) == (1, 0, 1)
    assert adds_up(stats)


def test_an_empty_chunk_changes_nothing() -> None:
    protocol = MavlinkProtocol(talk=False)
    assert protocol.feed(b"", 0).blocks == ()
    assert protocol.stats.bytes_in == 0
