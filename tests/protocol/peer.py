"""What pymavlink makes of the same bytes: the peer of the differential tests, and a writer of frames."""

import functools
import random
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as dialect

from server.nav.types import SAMPLE_COLUMNS, Kind, SampleBlock
from server.protocol.mavlink import FrameScanner, MavlinkProtocol
from server.protocol.mavlink.scanner import (
    C_FRAME_BYTES,
    C_JUNK_BYTES,
    F_COMPONENT,
    F_ID,
    F_INDEX,
    F_LENGTH,
    F_OFFSET,
    F_SEQ,
    F_SYSTEM,
    F_VERSION,
)

Frame = tuple[int, int, int, int, int, bool, bytes]
"""id, system, component, seq, version, known id, all bytes of the frame."""


@functools.lru_cache(maxsize=2)
def records(path: Path) -> list[tuple[int, bytes]]:
    """(stamp in µs, frame) of a `.tlog` that is known to be whole."""
    data, found, at = path.read_bytes(), [], 0
    while at < len(data):
        length = data[at + 9] + 12
        found.append((struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + 8 + length]))
        at += 8 + length
    return found


def frame_list(path: Path) -> list[bytes]:
    return [frame for _, frame in records(path)]


def pymavlink_messages(data: bytes, module: Any = dialect) -> tuple[list[Any], list[Any], int]:
    """Messages (unknown ids included), bad data, and the bytes still waiting."""
    parser = module.MAVLink(None)
    parser.robust_parsing = True
    messages = parser.parse_buffer(data) or []
    bad = [m for m in messages if m.get_type() == "BAD_DATA"]
    return [m for m in messages if m.get_type() != "BAD_DATA"], bad, parser.buf_len()


def described(message: Any) -> Frame:
    raw = bytes(message.data) if message.get_type().startswith("UNKNOWN_") else bytes(message.get_msgbuf())
    version = 2 if raw[0] == 0xFD else 1
    head = 4 if version == 2 else 2
    message_id = int.from_bytes(raw[7:10], "little") if version == 2 else raw[5]
    known = not message.get_type().startswith("UNKNOWN_")
    return (message_id, raw[head + 1], raw[head + 2], raw[head], version, known, raw)


def pymavlink_frames(data: bytes, module: Any = dialect) -> list[Frame]:
    return [described(message) for message in pymavlink_messages(data, module)[0]]


def our_frames(chunks: Iterable[bytes], scanner: FrameScanner | None = None) -> list[Frame]:
    """The same from our scanner; after every chunk the bytes must add up."""
    scanner = scanner or FrameScanner()
    found: list[Frame] = []
    given = 0
    for chunk in chunks:
        given += len(chunk)
        scanner.push(chunk)
        while len(table := scanner.next_frames()):
            for row in table:
                raw = scanner.data[row[F_OFFSET] : row[F_OFFSET] + row[F_LENGTH]].tobytes()
                columns = (F_ID, F_SYSTEM, F_COMPONENT, F_SEQ, F_VERSION)
                found.append((*(int(row[c]) for c in columns), bool(row[F_INDEX] >= 0), raw))  # type: ignore[arg-type]
        assert given == scanner.counters[C_FRAME_BYTES] + scanner.counters[C_JUNK_BYTES] + scanner.pending
    return found


def random_cuts(data: bytes, seed: int, longest: int) -> list[bytes]:
    generator = random.Random(seed)
    chunks, at = [], 0
    while at < len(data):
        size = generator.randint(0, longest)
        chunks.append(data[at : at + size])
        at += size
    return chunks


@dataclass
class Writer:
    """Frames of any sender, written by pymavlink, with running sequence numbers."""

    system: int = 1
    component: int = 1
    version: int = 2
    seq: int = 0
    link: Any = field(init=False)

    def __post_init__(self) -> None:
        self.link = dialect.MAVLink(None, srcSystem=self.system, srcComponent=self.component)

    def __call__(self, name: str, **fields: Any) -> bytes:
        kind = getattr(dialect, f"MAVLink_{name.lower()}_message")
        message = kind(**{key: fields.get(key, default(kind, key)) for key in kind.fieldnames})
        self.link.seq = self.seq
        self.seq = (self.seq + 1) & 255
        return bytes(message.pack(self.link, force_mavlink1=self.version == 1))


def default(kind: Any, name: str) -> Any:
    place = kind.fieldnames.index(name)
    length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
    if kind.fieldtypes[place] == "char":
        return b"" if length else b"\0"
    return [0] * length if length else 0


def feed_all(protocol: MavlinkProtocol, chunks: Iterable[bytes], t_rx_ns: int = 0) -> list[SampleBlock]:
    return [block for chunk in chunks for block in protocol.feed(chunk, t_rx_ns).blocks]


Row = dict[str, float]


def rows_of(blocks: Iterable[SampleBlock], kind: Kind) -> list[Row]:
    """The rows of one kind as dictionaries, with t_ns and boot_id."""
    found = []
    for block in blocks:
        for k in range(len(block.kind)):
            if block.kind[k] == kind:
                names = SAMPLE_COLUMNS[kind]
                row = {name: float(value) for name, value in zip(names, block.data[k], strict=False)}
                found.append({"t_ns": int(block.t_ns[k]), "boot_id": block.boot_id, **row})
    return found


def decoded(data: bytes, **options: Any) -> list[SampleBlock]:
    return feed_all(MavlinkProtocol(talk=False, **options), [data])
