"""Our scanner and decoder against pymavlink's parser on the recorded mission; both end with decoded high-rate messages.

Run by hand: python tests/bench/bench_scanner.py [chunk bytes]. Trust the ratios to pymavlink, not the times. The peer
gets its best case: `parse_buffer` on whole chunks, the C check sum (fastcrc), only the fields we decode are touched.
CPU time is counted, not the clock's: the machine may be busy.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

from server.protocol.mavlink import FrameScanner, MavlinkProtocol, warm

MISSION = Path(__file__).resolve().parents[3] / "shared" / "data" / "ardupilot_sitl" / "mission.tlog"
GOAL = 20.0
LIVE_CHUNK = 500
CHUNK = 4096
PEER_FRAMES = 40_000
ROUNDS = 3


def mission_frames() -> list[bytes]:
    data, frames, at = MISSION.read_bytes(), [], 0
    while at < len(data):
        end = at + 8 + data[at + 9] + 12
        frames.append(data[at + 8 : end])
        at = end
    return frames


def chunked(stream: bytes, size: int) -> list[bytes]:
    return [stream[at : at + size] for at in range(0, len(stream), size)]


TOUCH: dict[str, Callable[[Any], tuple[float, ...]]] = {
    "HIGHRES_IMU": lambda m: (m.time_usec, m.xacc, m.yacc, m.zacc, m.xgyro, m.ygyro, m.zgyro, m.xmag, m.abs_pressure),
    "GPS_RAW_INT": lambda m: (m.time_usec, m.lat, m.lon, m.alt, m.vel, m.cog, m.fix_type, m.h_acc, m.v_acc, m.vel_acc),
    "ATTITUDE_QUATERNION": lambda m: (m.time_boot_ms, m.q1, m.q2, m.q3, m.q4),
    "GLOBAL_POSITION_INT": lambda m: (m.time_boot_ms, m.lat, m.lon, m.alt, m.vx, m.vy, m.vz),
    "SIM_STATE": lambda m: (m.q1, m.q2, m.q3, m.q4, m.lat_int, m.lon_int, m.alt, m.vn, m.ve, m.vd),
}


def with_pymavlink(chunks: list[bytes]) -> int:
    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    count = 0
    for chunk in chunks:
        for message in parser.parse_buffer(chunk) or ():
            count += 1
            touch = TOUCH.get(message.get_type())
            if touch is not None:
                touch(message)
    return count


def with_scanner(chunks: list[bytes]) -> int:
    scanner = FrameScanner()
    count = 0
    for chunk in chunks:
        scanner.push(chunk)
        while found := len(scanner.next_frames()):
            count += found
    return count


def with_protocol(chunks: list[bytes]) -> int:
    protocol = MavlinkProtocol(talk=False)
    for k, chunk in enumerate(chunks):
        protocol.feed(chunk, k)
    return protocol.stats.frames


def us_per_frame(run: Callable[[list[bytes]], int], chunks: list[bytes], frames: int) -> float:
    best = float("inf")
    for _ in range(ROUNDS):
        start_ns = time.process_time_ns()
        if run(chunks) != frames:
            raise SystemExit(f"{run.__name__} did not find the {frames} frames")
        best = min(best, (time.process_time_ns() - start_ns) * 1e-3 / frames)
    return best


def main(args: list[str]) -> int:
    if not MISSION.exists():
        sys.stdout.write("bench_scanner: no recorded mission (../shared/data), nothing measured\n")
        return 0
    size = int(args[0]) if args else CHUNK
    warm()
    frames = mission_frames()
    stream, part = b"".join(frames), b"".join(frames[:PEER_FRAMES])
    peer = us_per_frame(with_pymavlink, chunked(part, size), PEER_FRAMES)
    rows = [("pymavlink parse_buffer + fields", size, peer)]
    for name, run in (("scanner alone", with_scanner), ("scanner + decoder + blocks (feed)", with_protocol)):
        rows += [
            (name, length, us_per_frame(run, chunked(stream, length), len(frames))) for length in (size, LIVE_CHUNK)
        ]
    rows.append(
        (
            "scanner + decoder + blocks (feed)",
            1 << 20,
            us_per_frame(with_protocol, chunked(stream, 1 << 20), len(frames)),
        )
    )
    sys.stdout.write(
        f"{'MAVLink, recorded mission':36} {'chunk B':>8} {'µs/frame':>9} {'MB/s':>8} {'× pymavlink':>12}\n"
    )
    mean = len(stream) / len(frames)
    for name, length, each in rows:
        sys.stdout.write(f"{name:36} {length:8d} {each:9.3f} {mean / each:8.1f} {peer / each:12.1f}\n")
    feed = rows[3][2]
    sys.stdout.write(
        f"goal ≥ {GOAL:.0f} × at {size} B: {peer / feed:.1f} × ({'met' if peer / feed >= GOAL else 'MISSED'})\n"
    )
    return 0 if peer / feed >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
