"""The compiled scanner against pymavlink's parser: the same frames from the same bytes, damaged and cut anywhere."""

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect
from pymavlink.dialects.v20 import ardupilotmega, common, development

from server.protocol.mavlink import FrameScanner
from server.protocol.mavlink.scanner import C_CRC_ERRORS, C_JUNK_BYTES, C_UNKNOWN, CRC_TABLE, crc_x25
from server.protocol.mavlink.table import message_table
from tests.protocol.peer import (
    Writer,
    frame_list,
    our_frames,
    pymavlink_frames,
    pymavlink_messages,
    random_cuts,
)

Damage = Callable[[bytes, random.Random], bytes]


def flip_bits(frame: bytes, generator: random.Random) -> bytes:
    damaged = bytearray(frame)
    for _ in range(generator.randint(1, 3)):
        damaged[generator.randrange(len(frame))] ^= 1 << generator.randrange(8)
    return bytes(damaged)


def flip_header_bit(frame: bytes, generator: random.Random) -> bytes:
    """Length, flags, sequence, sender or id: the id becomes unknown, or the length swallows what follows."""
    damaged = bytearray(frame)
    damaged[generator.randrange(10)] ^= 1 << generator.randrange(8)
    return bytes(damaged)


def delete_bytes(frame: bytes, generator: random.Random) -> bytes:
    at = generator.randrange(len(frame))
    return frame[:at] + frame[at + generator.randint(1, 8) :]


def insert_bytes(frame: bytes, generator: random.Random) -> bytes:
    at = generator.randrange(len(frame))
    return frame[:at] + generator.randbytes(generator.randint(1, 8)) + frame[at:]


def truncate(frame: bytes, generator: random.Random) -> bytes:
    return frame[: generator.randrange(len(frame))]


def garbage_before(frame: bytes, generator: random.Random) -> bytes:
    return generator.randbytes(generator.randint(1, 40)) + frame


def false_magic(frame: bytes, generator: random.Random) -> bytes:
    """Start bytes in the payload and before the frame."""
    damaged = bytearray(frame)
    damaged[generator.randrange(10, len(frame))] = generator.choice((0xFD, 0xFE))
    return bytes((generator.choice((0xFD, 0xFE)),)) * generator.randint(0, 2) + bytes(damaged)


def unknown_id(frame: bytes, generator: random.Random) -> bytes:
    return frame[:7] + generator.randrange(1 << 24).to_bytes(3, "little") + frame[10:]


def strange_flags(frame: bytes, generator: random.Random) -> bytes:
    return frame[:2] + bytes((generator.randrange(256),)) + frame[3:]


DAMAGES: tuple[Damage, ...] = (
    flip_bits,
    flip_header_bit,
    delete_bytes,
    insert_bytes,
    truncate,
    garbage_before,
    false_magic,
    unknown_id,
    strange_flags,
)


def damaged_stream(
    frames: list[bytes], every: int, seed: int, damages: tuple[Damage, ...] = DAMAGES
) -> tuple[bytes, int]:
    """Damage one frame in `every` on average; return the stream and how many were damaged."""
    generator = random.Random(seed)
    parts, count = [], 0
    for frame in frames:
        hit = generator.randrange(every) == 0
        count += hit
        parts.append(generator.choice(damages)(frame, generator) if hit else frame)
    return b"".join(parts), count


@pytest.fixture(scope="module")
def mission(shared_data: Path) -> list[bytes]:
    return frame_list(shared_data / "ardupilot_sitl" / "mission.tlog")


def test_the_recorded_mission_is_read_whole(mission: list[bytes]) -> None:
    stream = b"".join(mission)
    found = our_frames([stream])
    assert [frame[-1] for frame in found] == mission
    assert all(frame[5] for frame in found)


def test_frames_of_the_clean_mission_equal_pymavlinks(mission: list[bytes]) -> None:
    stream = b"".join(mission[:20_000])
    assert our_frames(random_cuts(stream, 1, 4096)) == pymavlink_frames(stream)


def test_frames_of_a_damaged_mission_equal_pymavlinks_over_2000_damaged_frames(mission: list[bytes]) -> None:
    stream, damaged = damaged_stream(mission[:40_000], 15, seed=2)
    assert damaged >= 2_400
    theirs = pymavlink_frames(stream)
    assert 30_000 < len(theirs) < 40_000
    assert our_frames([stream]) == theirs
    assert our_frames(random_cuts(stream, 3, 700)) == theirs


@pytest.mark.parametrize("damage", DAMAGES)
def test_every_kind_of_damage_by_itself_gives_pymavlinks_frames_and_junk(mission: list[bytes], damage: Damage) -> None:
    stream, damaged = damaged_stream(mission[5_000:9_000], 8, seed=4, damages=(damage,))
    assert damaged > 300
    scanner = FrameScanner(capacity=64)
    ours = our_frames(random_cuts(stream, 5, 300), scanner)
    messages, bad, waiting = pymavlink_messages(stream)
    assert ours == pymavlink_frames(stream)
    assert scanner.pending == waiting
    assert scanner.counters[C_JUNK_BYTES] == sum(len(m.data) for m in bad)
    assert scanner.counters[C_UNKNOWN] == sum(m.get_type().startswith("UNKNOWN_") for m in messages)


@pytest.mark.parametrize("module", [ardupilotmega, common])
def test_a_smaller_dialect_of_pymavlinks_finds_its_frames_at_the_same_places(
    mission: list[bytes], module: object
) -> None:
    """What pymavlink skips does not depend on which ids it knows, so neither does what we find of those it knows."""
    stream, _ = damaged_stream(mission[:8_000], 10, seed=6)
    theirs = [frame for frame in pymavlink_frames(stream, module) if frame[5]]
    known = {frame[0] for frame in theirs}
    assert [frame for frame in our_frames([stream]) if frame[0] in known and frame[5]] == theirs


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_cut_of_any_damage_gives_the_same_frames(data: st.DataObject) -> None:
    writer = Writer()
    generator = random.Random(data.draw(st.integers(0, 1 << 32)))
    frames = [
        writer("HIGHRES_IMU", time_usec=k, xacc=generator.random(), zmag=generator.random(), abs_pressure=1000.0)
        if generator.random() < 0.5
        else writer("HEARTBEAT", type=2, autopilot=3, custom_mode=0xFD)
        for k in range(30)
    ]
    stream, _ = damaged_stream(frames, 3, seed=generator.randrange(1 << 32))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=40)))
    chunks = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    assert our_frames(chunks) == pymavlink_frames(stream)


@settings(max_examples=200, deadline=None)
@given(noise=st.binary(max_size=900), size=st.integers(1, 100))
def test_noise_is_accounted_for_to_the_byte_and_read_as_pymavlink_reads_it(noise: bytes, size: int) -> None:
    chunks = [noise[k : k + size] for k in range(0, len(noise), size)]
    assert our_frames(chunks) == pymavlink_frames(noise)


def test_mavlink_1_and_2_and_signed_frames_mix() -> None:
    old, new, signed = Writer(system=3, version=1), Writer(system=4), Writer(system=5)
    signed.link.signing.secret_key = bytes(range(32))
    signed.link.signing.sign_outgoing = True
    frames = []
    for k in range(300):
        for writer in (old, new, signed):
            frames.append(writer("ATTITUDE", time_boot_ms=k, roll=0.1 * k))
            frames.append(writer("GPS_RAW_INT", time_usec=k, fix_type=3, satellites_visible=0xFE))
    stream, _ = damaged_stream(frames, 12, seed=7, damages=(flip_bits, truncate, garbage_before))
    clean = our_frames([b"".join(frames)])
    assert [frame[-1] for frame in clean] == frames
    assert {frame[4] for frame in clean} == {1, 2}
    assert our_frames(random_cuts(stream, 8, 90)) == pymavlink_frames(stream)


def test_every_message_of_the_dialect_is_recognised_at_its_full_length() -> None:
    writer = Writer()
    frames = [writer(kind.msgname) for kind in dialect.mavlink_map.values()]
    assert len(frames) > 340
    assert [(f[0], f[5]) for f in our_frames([b"".join(frames)])] == [(k, True) for k in dialect.mavlink_map]


def test_the_table_holds_every_message_of_the_dialects_boards_speak() -> None:
    table = message_table()
    for module in (ardupilotmega, common, development, dialect):
        for message_id, kind in module.mavlink_map.items():
            index = table.index_of_id[message_id]
            assert table.names[index] == kind.msgname
            assert table.crc_extra[index] == kind.crc_extra
            assert table.length[index] == kind.unpacker.size


def test_an_unknown_id_is_counted_and_takes_its_claimed_length() -> None:
    writer = Writer()
    stream = unknown_id(writer("ATTITUDE", roll=1.0), random.Random(1)) + writer("ATTITUDE", roll=2.0)
    scanner = FrameScanner()
    assert [frame[5] for frame in our_frames([stream], scanner)] == [False, True]
    assert scanner.counters[C_UNKNOWN] == 1
    assert scanner.counters[C_CRC_ERRORS] == 0


def test_a_table_smaller_than_the_chunk_loses_nothing(mission: list[bytes]) -> None:
    stream = b"".join(mission[:3_000])
    assert len(our_frames([stream], FrameScanner(capacity=7))) == 3_000


def test_half_a_frame_that_is_given_up_becomes_junk() -> None:
    frame = Writer()("ATTITUDE", roll=1.0)
    scanner = FrameScanner()
    assert our_frames([frame[:9]], scanner) == []
    scanner.forget()
    assert (scanner.pending, scanner.counters[C_JUNK_BYTES]) == (0, 9)
    scanner.push(frame)
    assert len(scanner.next_frames()) == 1


def test_the_check_sum_is_pymavlinks() -> None:
    generator = random.Random(9)
    for size in (0, 1, 2, 9, 255):
        data = generator.randbytes(size)
        extra = generator.randrange(256)
        ours = crc_x25(np.frombuffer(bytearray(data), np.uint8), 0, size, extra, CRC_TABLE)
        assert ours == dialect.x25crc(bytearray(data + bytes((extra,)))).crc
